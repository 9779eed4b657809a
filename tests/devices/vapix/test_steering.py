"""Continuous moves: as fast as asked for, and ended by the dead man whatever becomes of who steers."""

from __future__ import annotations

import asyncio
import contextlib
import math

import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import Limits
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.speeds import SPEED_FORMS, SpeedCurve
from ptzd.model import AUTOMATIC, HeadReading, HeadSpeed, Lens
from ptzd.ports import MoveSuperseded
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.head import Turn
from ptzd.sim.profile import PROFILES, Profile
from tests.devices.vapix.test_against_simulator import head_of, rig_of, scene  # noqa: F401

DEAD_MAN_NS = 300_000_000


def settings_of(profile: Profile) -> dict[str, object]:
    spaced = {"move_spacing_s": 1.0, "report_lag_s": 0.2} if profile.timing.serialise_s else {}
    top = (profile.pan.v_max, profile.tilt.v_max)
    return {"steer_top_deg_s": top, "steer_exponent": profile.continuous_exponent, **spaced}


async def steered(head: VapixHead, speed: HeadSpeed, words: int) -> asyncio.Task[HeadReading]:
    """Say a speed so many times, ten times a second; returns the last one under way."""
    clock, task = SteadyClock(), None
    for _ in range(words):
        if task is not None:
            task.cancel()
        task = asyncio.create_task(head.steer(speed, clock.now_ns() + DEAD_MAN_NS))
        await asyncio.sleep(0.1)
    return task


@pytest.mark.parametrize("name", sorted(PROFILES))
async def test_it_turns_as_fast_as_asked_and_rests_by_itself(rig_of, head_of, name) -> None:  # noqa: F811
    profile = PROFILES[name]
    rig = await rig_of(profile=name)
    head = await head_of(rig, **settings_of(profile))
    await head.describe()
    speed = HeadSpeed(pan_deg_s=7.0, tilt_deg_s=-3.0, zoom_rate=0.25)
    last = await steered(head, speed, 14 if profile.timing.serialise_s else 8)
    axes, now_s = rig.camera.unit.head.axes, rig.clock.now_s()
    assert axes["pan"].velocity(now_s) == pytest.approx(7.0, rel=0.02)
    assert axes["tilt"].velocity(now_s) == pytest.approx(-3.0, rel=0.02)
    assert axes["zoom"].velocity(now_s) == pytest.approx(0.25 * profile.zoom.v_max, rel=0.02)
    reading = await last
    now_s = rig.clock.now_s()
    assert not rig.camera.unit.head.moving(now_s)
    assert reading.pan_deg == pytest.approx(rig.camera.unit.head.reported(now_s).pan_deg, abs=0.05)


async def test_zoomed_in_it_is_as_fast(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of(profile="dome")
    head = await head_of(rig, **settings_of(PROFILES["dome"]))
    await head.describe()
    await head.move(HeadReading(pan_deg=0.0, tilt_deg=-10.0, zoom=9000.0))
    last = await steered(head, HeadSpeed(pan_deg_s=40.0), 6)
    assert rig.camera.unit.head.axes["pan"].velocity(rig.clock.now_s()) == pytest.approx(40.0, rel=0.02)
    await last


async def test_whoever_steers_may_vanish(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of()
    head = await head_of(rig, **settings_of(PROFILES["v5915"]))
    await head.describe()
    last = await steered(head, HeadSpeed(pan_deg_s=20.0), 4)
    last.cancel()
    count = 0
    while rig.camera.unit.head.busy(rig.clock.now_s()):
        async for _ in head.polls():
            count += 1
            break
        assert count < 100


async def test_a_move_takes_its_place_and_the_dead_man_lets_it_go_on(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of()
    head = await head_of(rig, **settings_of(PROFILES["v5915"]))
    await head.describe()
    last = await steered(head, HeadSpeed(pan_deg_s=30.0), 4)
    reading = await head.move(HeadReading(pan_deg=-60.0, tilt_deg=20.0, zoom=1.0))
    assert (reading.pan_deg, reading.tilt_deg) == pytest.approx((-60.0, 20.0), abs=0.05)
    with pytest.raises(MoveSuperseded):
        await last


async def test_no_speed_stops_at_once(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of()
    head = await head_of(rig, **settings_of(PROFILES["v5915"]))
    await head.describe()
    last = await steered(head, HeadSpeed(pan_deg_s=30.0), 3)
    last.cancel()
    far_ns = SteadyClock().now_ns() + 10**12
    await head.steer(HeadSpeed(), far_ns)
    assert not rig.camera.unit.head.busy(rig.clock.now_s())


async def test_what_turned_when_the_camera_was_lost_is_stopped_first(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of()
    head = await head_of(rig, **settings_of(PROFILES["v5915"]))
    await head.describe()
    clock = SteadyClock()
    task = asyncio.create_task(head.steer(HeadSpeed(pan_deg_s=5.0), clock.now_ns() + 10**12))
    polls = head.polls()
    while not rig.camera.unit.head.busy(rig.clock.now_s()):
        await anext(polls)
    await head.describe()
    assert not any(axis.continuous for axis in rig.camera.unit.head.axes.values())
    with contextlib.suppress(Exception):
        await task


async def test_a_camera_that_takes_only_the_oldest_form_is_asked_in_it(serve, settings_for, clock) -> None:
    from tests.devices.vapix.conftest import FakeCamera

    class Old(FakeCamera):
        def _ptz(self, query):
            speeds = query.get("continuouspantiltmove", "0,0")
            if "proportionalspeed" in query or "." in speeds:
                self.refused += 1
                return web.Response(text="Error:\r\nproportionalspeed: unknown argument\r\n")
            return super()._ptz(query)

    camera = await serve(Old())
    async with VapixHead(settings_for(camera, steer_top_deg_s=(90.0, 70.0)), Limits(), clock) as head:
        await head.describe()
        for speed in (7.0, 8.0):
            task = asyncio.create_task(head.steer(HeadSpeed(pan_deg_s=speed), clock.now_ns() + DEAD_MAN_NS))
            await task
    turned = [query["continuouspantiltmove"] for query in camera.commands if "continuouspantiltmove" in query]
    assert [text for text in turned if text != "0,0"] == ["8,0", "9,0"]
    assert camera.refused == 2, "the form is remembered"


@given(share=st.floats(-1, 1).filter(lambda share: abs(share) > 1e-6), top=st.floats(1, 300), exponent=st.floats(1, 4))
def test_the_curve_goes_both_ways(share: float, top: float, exponent: float) -> None:
    """``top · (percent / 100) ** exponent`` is the speed that was asked for."""
    curve = SpeedCurve(top_deg_s=(top, top / 2), exponent=exponent)
    pan, tilt, zoom = curve.percents(HeadSpeed(pan_deg_s=share * top, tilt_deg_s=-share * top / 2, zoom_rate=share))
    assert math.copysign(top * abs(pan / 100) ** exponent, pan) == pytest.approx(share * top, rel=1e-6)
    assert tilt == pytest.approx(-pan)
    assert zoom == pytest.approx(100 * share)


def test_a_speed_above_the_curve_is_never_sent() -> None:
    with pytest.raises(ValueError, match=r"91°/s is more than the 90°/s"):
        SpeedCurve(top_deg_s=(90.0, 70.0), exponent=1.0).percents(HeadSpeed(pan_deg_s=91.0))
    with pytest.raises(ValueError, match="more than the 0"):
        SpeedCurve(top_deg_s=None, exponent=1.0).percents(HeadSpeed(tilt_deg_s=1.0))


def test_the_smallest_speed_is_no_rest_in_any_form() -> None:
    texts = [dict(requests.continuous_move(1, (0.3, -0.3, 0.0), form).params) for form in SPEED_FORMS]
    assert [text["continuouspantiltmove"] for text in texts] == ["0.3,-0.3", "1,-1", "1,-1"]
    assert [text.get("proportionalspeed") for text in texts] == ["disabled", "disabled", None]
    assert {text["continuouszoommove"] for text in texts} == {"0"}


async def test_focus_by_hand_and_back_to_the_camera(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of(profile="v5915")
    head = await head_of(rig)
    limits = await head.describe()
    assert (limits.focus, limits.iris) == ((770.0, 9999.0), (1.0, 9999.0))
    unit = rig.camera.unit
    await head.set_lens(Lens(focus=1234, iris=77))
    assert (unit.switches["autofocus"], unit.switches["autoiris"]) == ("off", "off")
    assert (unit.levels["focus"], unit.levels["iris"]) == (1234, 77)
    await head.set_lens(Lens(focus=AUTOMATIC))
    assert (unit.switches["autofocus"], unit.switches["autoiris"]) == ("on", "off")


async def test_a_camera_without_focus_by_hand_says_so(rig_of, head_of) -> None:  # noqa: F811
    head = await head_of(await rig_of(profile="dome"))
    limits = await head.describe()
    assert (limits.focus, limits.iris) == (None, None)


async def test_what_a_killed_daemon_left_turning_is_stopped_by_the_next(rig_of, head_of) -> None:  # noqa: F811
    rig = await rig_of(profile="v5915")
    unit = rig.camera.unit
    unit.head.submit(rig.clock.now_s(), Turn(pan_percent=30.0, tilt_percent=0.0))
    onlooker = await head_of(rig)
    await onlooker.describe()
    assert unit.head.moving(rig.clock.now_s())
    assert not unit.orders, "whoever only looks leaves it alone"
    heir = await head_of(rig, takes_over=True)
    await heir.describe()
    assert Turn(pan_percent=0.0, tilt_percent=0.0) in [record.order for record in unit.orders]
