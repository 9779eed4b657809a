"""Which looks are compared: the one before, the one kept of the same place; and what a fault leaves of them."""

from __future__ import annotations

import asyncio

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import MatchError
from ptzd.model import FrameRef, HeadReading, Motion, Turn, Turned
from ptzd.ports import Picture
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.motor_watch import AGAIN_NS, RESTED_NS, UNCLEAR, MotorWatch

FRAME_NS = 66_000_000


def at(pan: float) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=0.0, zoom=1.0)


class Stage:
    def __init__(self) -> None:
        self.compared: list[tuple[float, float]] = []
        self.told: list[ev.ViewsCompared] = []
        self.verdict = Turn.AGREES
        self.wanted = True
        self.under_way = self.most = 0
        self.watch = MotorWatch(self.compare, self.told.append, FrameStore(4), lambda: self.wanted)
        self.t_ns = 0

    async def compare(self, before: bytes, at_: HeadReading, after: bytes, then: HeadReading) -> Turned:
        assert before
        assert after
        self.under_way += 1
        self.most = max(self.most, self.under_way)
        await asyncio.sleep(0)
        self.under_way -= 1
        self.compared.append((at_.pan_deg, then.pan_deg))
        if self.verdict is None:
            raise MatchError("no picture")
        return Turned(verdict=self.verdict, before=at_, after=then, turned=at_ != then)

    async def rest(self, pan: float, for_ns: int = 2 * RESTED_NS, motion: Motion = Motion.STABLE) -> None:
        end_ns = self.t_ns + for_ns
        while self.t_ns < end_ns:
            self.t_ns += FRAME_NS
            frame = FrameRef(seq=self.t_ns // FRAME_NS, t_capture_ns=self.t_ns)
            self.watch.shown(Picture(frame=frame, t_arrival_ns=self.t_ns, jpeg=b"jpeg"), at(pan), motion)
            for _ in range(4):
                await asyncio.sleep(0)

    async def home(self) -> None:
        await self.rest(50.0, FRAME_NS, Motion.MOVING)
        await self.rest(0.0)


@pytest.fixture
async def stage():
    made = Stage()
    running = asyncio.create_task(made.watch.run())
    yield made
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


async def test_a_rest_is_held_against_the_one_before_and_against_its_own_place(stage) -> None:
    await stage.rest(0.0)
    assert stage.compared == []
    await stage.rest(0.0, FRAME_NS, Motion.MOVING)
    await stage.rest(30.0)
    assert stage.compared == [(0.0, 30.0)]
    await stage.rest(30.0, FRAME_NS, Motion.MOVING)
    await stage.rest(0.0)
    assert stage.compared == [(0.0, 30.0), (30.0, 0.0), (0.0, 0.0)]
    assert [told.reference for told in stage.told] == [False, False, True]
    assert stage.most == 1


async def test_a_head_that_moves_or_rests_shortly_is_not_looked_at(stage) -> None:
    for pan in range(20):
        await stage.rest(float(pan), RESTED_NS // 2)
        await stage.rest(float(pan), FRAME_NS, Motion.MOVING)
    await stage.rest(0.0, 4 * RESTED_NS, Motion.MOVING)
    await stage.rest(0.0, 4 * RESTED_NS, Motion.SETTLING)
    assert stage.compared == []


async def test_a_long_rest_is_looked_at_again_and_a_doubtful_one_sooner(stage) -> None:
    await stage.rest(0.0, 4 * AGAIN_NS)
    assert 3 <= len(stage.compared) <= 4
    stage.verdict = Turn.SLIPPED
    before = len(stage.compared)
    await stage.rest(0.0, 2 * AGAIN_NS)
    assert len(stage.compared) - before > 10


async def test_after_a_fault_only_the_look_that_disproved_it_is_kept(stage) -> None:
    await stage.rest(0.0)
    await stage.rest(0.0, FRAME_NS, Motion.MOVING)
    await stage.rest(30.0)
    stage.watch._hear("lost its zero: …")
    await stage.rest(30.0, FRAME_NS, Motion.MOVING)
    await stage.rest(60.0)
    assert {round(key[0]) for key in stage.watch._places} == {0, 30}, "nothing is kept while it lasts"
    told = stage.told.append

    def heal(event: ev.ViewsCompared) -> None:
        told(event)
        if event.reference:
            stage.watch._hear("")

    stage.watch._tell = heal
    await stage.home()
    assert {round(key[0]) for key in stage.watch._places} == {0}


async def test_a_place_whose_light_has_changed_is_kept_anew(stage) -> None:
    await stage.rest(0.0)
    kept = next(iter(stage.watch._places.values()))
    stage.verdict = Turn.UNKNOWN
    for _ in range(UNCLEAR):
        assert next(iter(stage.watch._places.values())) is kept
        await stage.home()
    assert next(iter(stage.watch._places.values())) is not kept
    assert stage.told == []


async def test_a_camera_that_was_away_is_not_held_against_where_it_was(stage) -> None:
    await stage.rest(0.0)
    stage.watch.seen(1, ev.DeviceLost(device=ev.Device.PTZ, reason="cut"), [])
    await stage.rest(30.0)
    assert stage.compared == []


@pytest.mark.parametrize("cause", ["unreadable", "unwanted"])
async def test_nothing_is_told_of_pictures_that_cannot_be_read_nor_where_nobody_wants_it(stage, cause) -> None:
    stage.verdict = None if cause == "unreadable" else Turn.SLIPPED
    stage.wanted = cause != "unwanted"
    await stage.rest(0.0)
    await stage.home()
    await stage.home()
    assert stage.told == []


async def test_the_state_of_the_doubt_comes_with_the_status(stage) -> None:
    status = cmd.PublishStatus(
        state="IDLE", active=None, phase="", queue=(), fisheye="well", ptz="well", held=False, doubt="stuck: …"
    )
    stage.watch.seen(1, ev.DeadlinePassed(), [status])
    await stage.rest(0.0)
    assert not stage.watch._places
