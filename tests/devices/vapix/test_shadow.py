"""The imagined head: laws of its way, and beside the simulated camera that it never tells anything."""

from __future__ import annotations

import asyncio
import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import Limits, Ptz, Shadow
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.shadow import ShadowHead, Way
from ptzd.devices.vapix.speeds import SPEED_FORMS
from ptzd.errors import DeviceRefused
from ptzd.model import HeadReading, HeadSpeed
from ptzd.ports import MoveSuperseded, PictureMissed
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.head import MoveTo
from ptzd.sim.rig import SimRig
from ptzd.sim.scene import load_scene
from ptzd.sim.settings import SimSettings

SECOND_NS = 1_000_000_000
READINGS = st.builds(
    HeadReading, pan_deg=st.floats(-170, 170), tilt_deg=st.floats(-80, 80), zoom=st.floats(1, 9999)
)  # fmt: skip


def way(start: HeadReading, target: HeadReading) -> Way:
    return Way(
        start=start, target=target, t_ns=0, speed_deg_s=100.0, acceleration_deg_s2=400.0, zoom_units_s=3500.0
    )  # fmt: skip


@given(READINGS, READINGS)
def test_the_way_begins_and_ends_at_rest_and_is_never_faster_than_the_head(start, target) -> None:
    made = way(start, target)
    assert made.at(0).zoom == pytest.approx(start.zoom)
    assert made.at(0).pan_deg == pytest.approx(start.pan_deg)
    assert made.at(round(made.seconds * SECOND_NS) + 1) == target
    steps = [made.at(round(share / 40 * made.seconds * SECOND_NS)) for share in range(41)]
    step_s = made.seconds / 40
    for before, after in itertools.pairwise(steps):
        assert abs(after.pan_deg - before.pan_deg) <= 100.0 * step_s + 1e-4
        assert abs(after.tilt_deg - before.tilt_deg) <= 100.0 * step_s + 1e-4
        assert abs(after.zoom - before.zoom) <= 3500.0 * step_s + 1e-4
        low, high = sorted((start.pan_deg, target.pan_deg))
        assert low - 1e-6 <= after.pan_deg <= high + 1e-6


@given(st.floats(0.001, 300), st.floats(0.001, 300))
def test_a_longer_way_takes_longer(one, other) -> None:
    near, far = sorted((one, other))
    here = HeadReading(pan_deg=0, tilt_deg=0, zoom=1)
    seconds = [way(here, HeadReading(pan_deg=pan, tilt_deg=0, zoom=1)).seconds for pan in (near, far)]
    assert seconds[0] <= seconds[1] + 1e-9


@pytest.mark.parametrize(
    ("request_", "orders"),
    [
        (requests.absolute_move(1, HeadReading(pan_deg=0, tilt_deg=0, zoom=1)), True),
        *((stop, True) for stop in requests.stops(1)),
        *((requests.continuous_move(1, (5.0, 0.0, 0.0), form), True) for form in SPEED_FORMS),
        (requests.Request(path=requests.PTZ, params=(("gotoserverpresetname", "Gate"),), parse=str), True),
        (requests.Request(path=requests.PTZ, params=(("autofocus", "on"),), parse=str), True),
        (requests.Request(path="/axis-cgi/com/ptzconfig.cgi", params=(("setserverpresetname", "A"),), parse=str), True),
        (requests.Request(path="/axis-cgi/param.cgi", params=(("action", "update"),), parse=str), True),
        (requests.position(1), False),
        (requests.limits(1), False),
        (requests.speed(1), False),
        (requests.attributes(1), False),
        (requests.parameters("PTZ"), False),
        (requests.device_info(), False),
        (requests.system_ready(), False),
        (requests.event_session(), False),
        (requests.video(1, (640, 480), 15, 20), False),
    ],
)
def test_what_moves_or_changes_a_camera_is_known(request_, orders) -> None:
    assert request_.orders is orders


@pytest.fixture
async def stage(tmp_path):
    """A simulated camera, the client that only asks it, and the imagined head."""
    async with SimRig(SimSettings(), scene=load_scene("room")) as rig:
        (tmp_path / "password").write_text(rig.settings.password)
        settings = Ptz(
            url=rig.camera.url, user=rig.settings.user, password_file=str(tmp_path / "password"), size_px=(160, 120)
        )
        clock = SteadyClock()
        async with VapixHead(settings, Limits(), clock, jitter=lambda: 0.5, only_asks=True) as camera:
            head = ShadowHead(camera, settings, Shadow(enabled=True), clock)
            await head.describe()
            yield rig, camera, head


async def test_it_goes_and_arrives_and_the_camera_hears_of_nothing(stage) -> None:
    rig, camera, head = stage
    target = HeadReading(pan_deg=20.0, tilt_deg=10.0, zoom=500.0)
    loop = asyncio.get_running_loop()
    begun_s = loop.time()
    moving = asyncio.create_task(head.move(target))
    seen = []
    async for poll in head.polls():
        seen.append(poll)
        if moving.done():
            break
    assert await moving == target
    assert loop.time() - begun_s >= 0.5 + 20.0 / 100.0
    assert any(0 < poll.reading.pan_deg < 20 for poll in seen)
    assert all(abs(poll.camera.pan_deg) < 0.1 for poll in seen)
    with pytest.raises(PictureMissed, match=r"the camera stands at pan -?0\.00°.*not at pan 20\.00°"):
        await head.grab(0)
    turned = await head.steer(HeadSpeed(pan_deg_s=-10.0, zoom_rate=1.0), SteadyClock().now_ns() + SECOND_NS // 5)
    assert turned.pan_deg == pytest.approx(18.0, abs=0.1)
    assert turned.zoom > 1000.0
    first = asyncio.create_task(head.move(HeadReading(pan_deg=-20.0, tilt_deg=0.0, zoom=1.0)))
    await asyncio.sleep(0)
    await head.stop()
    with pytest.raises(MoveSuperseded):
        await first
    with pytest.raises(DeviceRefused, match="this daemon is a shadow and moves nothing"):
        await camera.move(target)
    assert not rig.camera.unit.orders
    assert not [asked for asked in rig.camera.asked if "ptz.cgi" in asked and "query=" not in asked]


async def test_a_picture_counts_where_the_camera_really_stands_there(stage) -> None:
    """Somebody else drives the camera to where the imagined head looks."""
    rig, _, head = stage
    target = HeadReading(pan_deg=8.0, tilt_deg=4.0, zoom=1.0)
    rig.camera.unit.force(MoveTo(pan=8.0, tilt=4.0, zoom=1), "somebody")
    await head.move(target)
    async with asyncio.timeout(20):
        while True:
            try:
                picture, view = await head.grab(0)
                break
            except PictureMissed:
                continue
    assert picture.jpeg
    assert view.reading.pan_deg == pytest.approx(8.0, abs=0.05)
    assert not any([poll async for poll in _few(head)])


async def _few(head: ShadowHead):
    polls = head.polls()
    for _ in range(3):
        yield (await anext(polls)).foreign
