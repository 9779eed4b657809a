"""The client against the simulated AXIS camera: real HTTP, motion that takes time, stale reports, faults."""

from __future__ import annotations

import asyncio
import math
import random

import pytest

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceGarbled, DeviceLost, DeviceRefused
from ptzd.model import HeadReading, Motion
from ptzd.ports import MoveStalled
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.auth import Policy
from ptzd.sim.faults import Fault, FaultKind
from ptzd.sim.rig import SimRig
from ptzd.sim.scene import load_scene
from ptzd.sim.settings import SimSettings


@pytest.fixture(scope="module")
def scene():
    return load_scene("room")


@pytest.fixture
async def rig_of(scene):
    rigs = []

    async def make(**settings) -> SimRig:
        rig = SimRig(SimSettings(**settings), scene=scene)
        rigs.append(await rig.__aenter__())
        return rig

    yield make
    for rig in rigs:
        await rig.__aexit__(None, None, None)


@pytest.fixture
async def head_of(tmp_path):
    heads = []

    async def make(rig: SimRig, *, takes_over: bool = False, **changes) -> VapixHead:
        (tmp_path / "password").write_text(rig.settings.password)
        values = {
            "url": rig.camera.url, "user": rig.settings.user, "password_file": str(tmp_path / "password"),
            "size_px": (160, 120), "stall_s": 4.0,
        }  # fmt: skip
        head = VapixHead(Ptz(**(values | changes)), Limits(), SteadyClock(), jitter=lambda: 0.5, takes_over=takes_over)
        heads.append(await head.__aenter__())
        return head

    yield make
    for head in heads:
        await head.__aexit__(None, None, None)


def at(pan: float, tilt: float = 10.0, zoom: float = 1.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom)


def swing_deg(rig: SimRig) -> float:
    """How far the optics still are from where they will rest."""
    now_s, head = rig.clock.now_s(), rig.camera.unit.head
    now, later = head.optical(now_s), head.optical(max(now_s, head.rest_s(now_s)))
    return max(abs(math.remainder(now.pan_deg - later.pan_deg, 360)), abs(now.tilt_deg - later.tilt_deg))


SLOW = {"move_spacing_s": 1.0, "report_lag_s": 0.2}
"""Settings for cameras that buffer commands."""


async def test_arrival_is_never_declared_before_rest(rig_of, head_of):
    profiles = ("v5915", "dome", "inverted", "old214")
    await asyncio.gather(*(_moves(rig_of, head_of, name, SLOW if name == "old214" else {}) for name in profiles))


async def _moves(rig_of, head_of, profile, changes):
    rig = await rig_of(profile=profile)
    head = await head_of(rig, **changes)
    limits = await head.describe()
    sim, draw = rig.camera.unit.head, random.Random(7)
    quantum = rig.camera.unit.profile.quantum_deg
    for _ in range(2):
        target = at(draw.uniform(-60, 60), draw.uniform(*limits.tilt_deg) / 2, draw.randint(1, 2000))
        reading = await head.move(target)
        assert not sim.moving(rig.clock.now_s()), profile
        assert swing_deg(rig) <= max(quantum, 0.001), profile
        assert abs(reading.pan_deg - target.pan_deg) <= quantum, profile
        assert abs(reading.tilt_deg - target.tilt_deg) <= quantum, profile
        assert abs(reading.zoom - target.zoom) <= 2, profile


async def test_a_view_shows_the_pose_it_is_said_to_show(rig_of, head_of):
    rig = await rig_of()
    head = await head_of(rig, image_latency_s=0.07)
    await head.describe()
    asked_ns = SteadyClock().now_ns()
    moving = asyncio.create_task(head.move(at(30, 20)))
    await _under_way(rig)
    picture, view = await head.grab(asked_ns)
    truth = rig.camera.unit.head.optical(picture.frame.t_capture_ns / 1e9)
    assert abs(truth.pan_deg - view.reading.pan_deg) < 3 * view.sigma_deg
    assert abs(truth.tilt_deg - view.reading.tilt_deg) < 3 * view.sigma_deg
    assert view.reading.pan_deg == pytest.approx(30, abs=0.01)
    await moving


@pytest.mark.parametrize("policy", list(Policy))
async def test_every_policy_over_tls_with_a_pinned_certificate(rig_of, head_of, policy):
    rig = await rig_of(https=True, policy=policy)
    digest = rig.camera.certificate.sha256
    head = await head_of(rig, url=rig.camera.https_url, certificate_sha256=digest)
    await head.describe()
    other = await head_of(rig, url=rig.camera.https_url, certificate_sha256="ab" * 32)
    with pytest.raises(DeviceRefused, match=f"shows certificate {digest} instead of ptz.certificate_sha256"):
        await other.describe()
    unknown = await head_of(rig, url=rig.camera.https_url)
    with pytest.raises(DeviceRefused, match=r"certificate not trusted .*ptz\.certificate_sha256"):
        await unknown.describe()


async def test_nonces_that_expire_all_the_time(rig_of, head_of):
    rig = await rig_of(nonce_life_s=0.4)
    head = await head_of(rig)
    await head.describe()
    assert (await head.move(at(5))).pan_deg == pytest.approx(5, abs=0.01)


async def test_a_restart_is_survived_without_a_new_object(rig_of, head_of):
    rig = await rig_of(boot_s=0.3)
    head = await head_of(rig)
    await head.describe()
    await head.move(at(12))
    rig.camera.reboot()
    with pytest.raises(DeviceLost):
        async for _ in head.polls():
            pass
    await _back(head)
    assert (await head.move(at(-12))).pan_deg == pytest.approx(-12, abs=0.01)


async def test_another_user_is_recognised_and_not_fought(rig_of, head_of):
    rig = await rig_of()
    head = await head_of(rig)
    await head.describe()
    orders = len(rig.camera.unit.orders)
    polls = head.polls()
    while (await anext(polls)).motion is not Motion.STABLE:
        pass
    rig.camera.inject(Fault(kind=FaultKind.FOREIGN_MOVE, pan=20.0, tilt=0.0))
    while not (await anext(polls)).foreign:
        pass
    while (poll := await anext(polls)).foreign:
        pass
    assert poll.motion is Motion.STABLE
    assert poll.reading.pan_deg == pytest.approx(20, abs=0.01)
    assert len(rig.camera.unit.orders) == orders + 1


async def test_a_move_that_another_user_takes_over_is_stalled_there(rig_of, head_of):
    rig = await rig_of()
    head = await head_of(rig)
    await head.describe()
    move = asyncio.create_task(head.move(at(80)))
    await _under_way(rig)
    rig.camera.inject(Fault(kind=FaultKind.FOREIGN_MOVE, pan=-10.0, tilt=0.0))
    with pytest.raises(MoveStalled, match=r"rests at pan -10\.0"):
        await move


async def _under_way(rig):
    while not rig.camera.unit.head.moving(rig.clock.now_s()):  # noqa: ASYNC110
        await asyncio.sleep(0.005)


PTZ_PAGE = "*/ptz.cgi*query=position*"
FAULTS = [
    Fault(kind=FaultKind.HANG, path=PTZ_PAGE),
    Fault(kind=FaultKind.STATUS, path=PTZ_PAGE, status=503),
    Fault(kind=FaultKind.RESET, path=PTZ_PAGE),
    Fault(kind=FaultKind.HTML, path=PTZ_PAGE),
    Fault(kind=FaultKind.ERROR_TEXT, path=PTZ_PAGE),
    Fault(kind=FaultKind.GARBAGE, path=PTZ_PAGE),
    Fault(kind=FaultKind.EMPTY, path=PTZ_PAGE),
    Fault(kind=FaultKind.STALL),
]


async def test_every_lasting_fault_ends_in_a_loss_and_a_recovery(rig_of, head_of):
    ends = await asyncio.gather(*(_lost_and_back(rig_of, head_of, fault) for fault in FAULTS), return_exceptions=True)
    assert [(fault.kind, end) for fault, end in zip(FAULTS, ends, strict=True) if end is not None] == []


async def _lost_and_back(rig_of, head_of, fault):
    rig = await rig_of()
    head = await head_of(rig)
    await head.describe()
    lost = pytest.raises((DeviceLost, DeviceRefused, DeviceGarbled))
    with rig.camera.faults.during(fault, rig.clock.now_s()), lost:
        await head.grab(2**62)
    await _back(head)


async def _back(head):
    """Until it works again."""
    async with asyncio.timeout(100):
        while True:
            try:
                await head.describe()
                await head.grab(0)
                return
            except DeviceLost:
                await asyncio.sleep(0.1)


async def test_a_few_damaged_pictures_are_no_loss(rig_of, head_of):
    rig = await rig_of()
    head = await head_of(rig)
    await head.describe()
    for kind in (FaultKind.TRUNCATE, FaultKind.SHORT, FaultKind.CUT):
        asked_ns = SteadyClock().now_ns()
        rig.camera.inject(Fault(kind=kind, count=2))
        picture, _ = await head.grab(asked_ns + 300_000_000)
        assert picture.jpeg.endswith(b"\xff\xd9")
