"""A rig that learns how far away things are, over restarts of its daemon."""

from __future__ import annotations

import asyncio
import json
import sys

from ptzd.control import events as ev
from ptzd.log.reader import LogReader


async def ended(site) -> str:
    """End the daemon as the service manager does; what it said."""
    site.process.terminate()
    _, errors = await site.process.communicate()
    site._listening.cancel()
    await asyncio.gather(site._listening, return_exceptions=True)
    return errors.decode()


async def told(site, *arguments: str) -> str:
    """What `ptzd ranges` prints."""
    command = [sys.executable, "-m", "ptzd", "ranges", *arguments, "--connect", site.endpoint]
    asking = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    said, _ = await asking.communicate()
    assert asking.returncode == 0
    return said.decode()


def known_at_the_head(site) -> list[dict]:
    """The map in the newest log's first snapshot."""
    with LogReader(max((site.folder / "log").glob("*.mcap"))) as reader:
        first = next(iter(reader.decisions())).event
    assert isinstance(first, ev.Snapshot)
    return first.state["ranges"]["locks"]


async def test_what_a_lock_taught_is_known_after_a_restart_and_the_log_replays_alone(make_site) -> None:
    site = await make_site()
    await site.spawn()
    taught = await site.lock("first")
    await ended(site)
    assert known_at_the_head(site) == []
    (kept,) = (site.folder / "log").glob("*-ranges-*.json")
    (lock,) = json.loads(kept.read_text())["locks"]
    assert lock["id"] == "first"
    assert abs(lock["inverse_range"] * taught.range_m - 1.0) < 0.02

    await site.spawn()
    await site.lock("second")
    await site.client.log_files(rotate=True)
    assert f"1 lock(s) tell the scene's ranges ({kept})" in await ended(site)
    assert [one["id"] for one in known_at_the_head(site)] == ["first", "second"]
    assert len(json.loads(kept.read_text())["locks"]) == 2

    await site.spawn()
    assert "first" in await told(site)
    assert await told(site, "--forget-last", "1") == "1 forgotten, 1 left\n"
    assert [one.id for one in (await site.client.ranges()).known] == ["first"]
    await ended(site)
    assert [one["id"] for one in json.loads(kept.read_text())["locks"]] == ["first"]
