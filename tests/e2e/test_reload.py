"""`kill -HUP` and `systemctl reload`: other settings in a running daemon, and a log that replays across the change."""

from __future__ import annotations

import asyncio
import os
import signal


async def heard_again(site) -> str:
    """Let the settings be read again; what the daemon says of it."""
    site.process.send_signal(signal.SIGHUP)
    async with asyncio.timeout(40):
        async for line in site.process.stderr:
            if b"settings" in line:
                return line.decode()
    raise AssertionError("the daemon ended")


async def test_settings_change_while_it_runs_and_both_logs_replay(make_site) -> None:
    site = await make_site()
    await site.spawn()
    await site.lock("before")
    settings = site.config.read_text()
    site.change(search={"accept_probability": 1.0, "certain_probability": 1.0, "max_rounds": 1}, ptz={"poll_hz": 5.0})
    said = await heard_again(site)
    assert "changed search.accept_probability, search.certain_probability, search.max_rounds; needs a restart" in said
    assert "ptz.poll_hz" in said
    await site.request("strict")
    assert (await site.end_of("strict")).outcome != "locked"
    site.config.write_text("rig: [")
    assert "not taken" in await heard_again(site)
    site.config.write_text(settings)
    assert "changed search.accept_probability" in await heard_again(site)
    await site.lock("after")
    site.process.terminate()
    await site.process.communicate()
    await site.end()
    assert len(list((site.folder / "log").glob("*.mcap"))) == 3


async def test_a_terminal_that_closes_ends_the_daemon_in_order(make_site) -> None:
    site = await make_site()
    ours, theirs = os.openpty()
    await site.spawn(stdin=theirs)
    site.process.send_signal(signal.SIGHUP)
    _, errors = await site.process.communicate()
    assert site.process.returncode == 0
    assert b"settings" not in errors
    os.close(ours)
    os.close(theirs)
    await site.end()


async def test_settings_that_are_no_file_are_refused_and_neither_the_next_reload_nor_the_end_waits(make_site) -> None:
    site = await make_site()
    await site.spawn()
    kept = site.config.rename(site.folder / "kept.yaml")
    os.mkfifo(site.config)
    said = await heard_again(site)
    assert "not taken" in said
    assert "is no regular file" in said
    site.config.unlink()
    kept.rename(site.config)
    site.change(search={"accept_probability": 0.9})
    assert "changed search.accept_probability" in await heard_again(site)
    site.config.unlink()
    os.mkfifo(site.config)
    site.process.send_signal(signal.SIGHUP)
    site.process.terminate()
    await site.process.communicate()
    assert site.process.returncode == 0
    await site.end()
