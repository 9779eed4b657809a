"""A patrol on a running rig, over real sockets."""

from __future__ import annotations

import asyncio
import signal
import sys

import pytest
import yaml

from ptzd.errors import RequestRefused

PLACES = {
    "left": {"azimuth_deg": -20.0, "elevation_deg": -5.0, "hfov_deg": 30.0},
    "right": {"azimuth_deg": 15.0, "elevation_deg": 3.0, "hfov_deg": 45.0},
}
PATROLS = {"night": [{"place": "left", "dwell_s": 1.0}, {"place": "right", "dwell_s": 600.0}]}


@pytest.fixture
async def placed(make_site):
    site = await make_site()
    (site.folder / "presets.yaml").write_text(yaml.safe_dump({"places": PLACES, "patrols": PATROLS}))
    await site.start()
    return site


def at(site, place: str, phase: str = "there") -> bool:
    patrol = site.status.patrol
    return patrol is not None and (patrol.place, patrol.phase) == (place, phase)


async def test_interrupted_by_a_request_it_goes_on_where_it_was(placed) -> None:
    told = await placed.client.patrol("start", "night")
    assert (told.patrol, told.place, told.phase) == ("night", "left", "on the way")
    await placed.until(lambda: at(placed, "left"))
    await placed.until(lambda: at(placed, "right"))
    ends_ns, begun_ns = placed.status.patrol.until_ns, placed.status.t_ns
    await placed.lock("between")
    await placed.until(lambda: at(placed, "right") and placed.status.patrol.until_ns != ends_ns)
    assert 590 * 10**9 < placed.status.patrol.until_ns - placed.status.t_ns <= 600 * 10**9
    assert placed.status.t_ns > begun_ns
    assert (await placed.client.patrol("pause")).phase == "paused"
    await placed.lock("meanwhile")
    await placed.until_state("HOME")
    await placed.until_state("IDLE")
    assert (await placed.client.patrol("resume")).place == "right"
    await placed.until(lambda: at(placed, "right"))
    assert await placed.client.patrol("stop") is None
    await placed.until_state("HOME")


async def test_refused_in_a_sentence(placed) -> None:
    orders = placed.orders
    for wish, patrol, code in (
        ("start", "nigth", "unknown_patrol"),
        ("start", "", "unknown_patrol"),
        ("pause", "", "no_patrol"),
    ):
        with pytest.raises(RequestRefused) as refused:
            await placed.client.patrol(wish, patrol)
        assert refused.value.code == code
    assert placed.orders == orders


async def test_on_the_command_line(placed) -> None:
    async def ptzd(*arguments: str) -> tuple[int, str, str]:
        command = [sys.executable, "-m", "ptzd", *arguments, "--connect", placed.endpoint]
        pipe = asyncio.subprocess.PIPE
        running = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
        out, err = await running.communicate()
        return running.returncode, out.decode(), err.decode()

    assert (await ptzd("patrol", "start", "night"))[:2] == (0, "night: on the way to left\n")
    await placed.until(lambda: at(placed, "right"))
    assert "patrol    night: at right until " in (await ptzd("status"))[1]
    code, said, _ = await ptzd("patrol", "pause")
    assert (code, said) == (0, "night: paused (somebody paused it), goes on at right\n")
    assert (await ptzd("patrol", "stop"))[:2] == (0, "no patrol is under way\n")
    code, said, error = await ptzd("patrol", "stop")
    assert (code, said) == (65, "")
    assert "no patrol is under way; start one" in error


async def test_the_schedule_begins_it_and_other_settings_end_it(make_site) -> None:
    """By the clock of the machine, whatever it shows: the window is the whole day."""
    site = await make_site()
    window = {"patrol": "night", "from": "00:00", "until": "24:00"}
    presets = {"places": PLACES, "patrols": PATROLS, "time_zone": "Pacific/Auckland", "schedule": [window]}
    (site.folder / "presets.yaml").write_text(yaml.safe_dump(presets))
    await site.spawn(state="PATROL")
    await site.until(lambda: at(site, "right"))
    assert site.status.patrol.scheduled
    (site.folder / "presets.yaml").write_text(yaml.safe_dump({"places": PLACES, "patrols": PATROLS}))
    site.process.send_signal(signal.SIGHUP)
    await site.until(lambda: site.status.patrol is None)
    await site.until_state("HOME")
