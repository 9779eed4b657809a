"""An operator sends a running rig to named places, over real sockets and by the simulator's truth."""

from __future__ import annotations

import asyncio
import json
import sys

import numpy as np
import pytest
import yaml

from ptzd.app.loading import load
from ptzd.errors import RequestRefused
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.model import HeadReading

PLACES = {
    "left": {"azimuth_deg": -20.0, "elevation_deg": -5.0, "hfov_deg": 30.0},
    "right hand": {"azimuth_deg": 15.0, "elevation_deg": 3.0, "hfov_deg": 45.0},
    "behind": {"azimuth_deg": 180.0, "elevation_deg": 85.0, "hfov_deg": 45.0},
}


@pytest.fixture
async def placed(make_site):
    """A rig with a file of places beside its settings."""
    site = await make_site()
    (site.folder / "presets.yaml").write_text(yaml.safe_dump({"places": PLACES, "hold_s": 600.0}))
    site.change(limits={"tilt_deg": [-60.0, 60.0]})
    await site.start()
    return site


def off_deg(site, place: str) -> float:
    """How far the head looks past a place, by the truth of the simulator."""
    rig = load(site.config).rig
    truth = site.rig.camera.unit.head.optical(site.rig.clock.now_s())
    reading = HeadReading(pan_deg=truth.pan_deg, tilt_deg=truth.tilt_deg, zoom=truth.zoom)
    asked = PLACES[place]
    wanted = rig.head_from_fisheye_rotation @ bearing(
        np.radians(asked["azimuth_deg"]), np.radians(asked["elevation_deg"])
    )
    return float(np.degrees(angle_between(rig.head_from_camera(reading) @ np.array([0.0, 0.0, 1.0]), wanted)))


async def test_there_and_from_there_to_another_and_what_is_asked_meanwhile_waits(placed) -> None:
    reply = await placed.client.goto("left")
    assert not placed.moving
    assert off_deg(placed, "left") < 0.1
    assert reply.hfov_deg == pytest.approx(30.0, abs=0.1)
    await placed.until_state("GOTO")
    await placed.request("waits")
    await placed.until(lambda: placed.status.queue == ("waits",))
    assert placed.status.goto.place == "left"
    assert placed.status.goto.until_ns - placed.status.goto.there_ns == 600 * 10**9
    await placed.client.goto("right hand")
    assert off_deg(placed, "right hand") < 0.1
    assert (await placed.client.goto("left", hold_s=0.0)).place == "left"
    assert (await placed.end_of("waits")).outcome == "locked"
    assert (await placed.client.status()).goto is None


async def test_what_cannot_be_is_refused_and_the_head_stays(placed) -> None:
    orders = placed.orders
    for place, code, said in (
        ("lefd", "unknown_place", "no place 'lefd'; nearest: left"),
        ("behind", "unreachable", "behind lies at pan "),
        ("\x07", "invalid", "Expected `str` matching"),
    ):
        with pytest.raises(RequestRefused) as refused:
            await placed.client.goto(place)
        assert (refused.value.code, refused.value.message[: len(said)]) == (code, said)
    async with placed.client.lease("desk"):
        with pytest.raises(RequestRefused, match="desk has the head for himself") as refused:
            await placed.client.goto("left")
        assert refused.value.code == "leased"
        assert placed.orders <= orders + 1, "no more than the stop of the lease"
        assert (await placed.client.goto("left", by="desk")).place == "left"
        await placed.until_state("MANUAL")
    assert off_deg(placed, "left") < 0.1


async def test_a_stop_on_the_way_is_told_to_whoever_waits_for_the_arrival(placed) -> None:
    asked = asyncio.create_task(placed.client.goto("left"))
    await placed.until_state("GOTO")
    await placed.client.control("stop")
    with pytest.raises(RequestRefused, match="the operator asked for stop") as refused:
        await asked
    assert refused.value.code == "cancelled"
    assert not placed.moving


async def test_on_the_command_line(placed) -> None:
    async def ptzd(*arguments: str) -> tuple[int, str, str]:
        command = [sys.executable, "-m", "ptzd", *arguments, "--connect", placed.endpoint]
        pipe = asyncio.subprocess.PIPE
        running = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
        out, err = await running.communicate()
        return running.returncode, out.decode(), err.decode()

    code, said, _ = await ptzd("goto", "right hand")
    assert code == 0
    assert said.startswith("right hand: there: pan ")
    assert "goto      at right hand until " in (await ptzd("status"))[1]
    code, said, _ = await ptzd("goto", "left", "--hold", "0", "--json")
    assert (code, json.loads(said)["place"]) == (0, "left")
    code, said, error = await ptzd("goto", "rigth hand")
    assert (code, said) == (65, "")
    assert "no place 'rigth hand'; nearest: right hand" in error


async def test_how_long_the_head_is_left_where_it_is_changes_while_the_daemon_runs(placed) -> None:
    assert await placed.client.home_after("never") is None
    await placed.client.goto("left", hold_s=0.0)
    await placed.until(lambda: placed.state == "IDLE" and placed.status.goto is None)
    assert placed.status.home_after.after_s is None
    assert off_deg(placed, "left") < 0.1
    assert await placed.client.home_after(0.0) == 0.0
    await placed.until_state("HOME")
    assert await placed.client.home_after("settings") == 0.5
    assert (await placed.client.status()).home_after.after_s == 0.5
