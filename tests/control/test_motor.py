"""Sparing the motor: what is not driven, what is counted, and whose wish finds a share of the budget."""

from __future__ import annotations

import itertools
import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import Home, Lock, Motor, Queue
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.head_state import HeadState
from ptzd.control.machine import Machine
from ptzd.control.motor import MINUTE_NS, MINUTES, Travel, share_of, spent
from ptzd.control.planning.ranges import RangeMap
from ptzd.control.ranks import Rank
from ptzd.control.states import State
from ptzd.control.work import Work
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.model import HeadLimits, HeadReading, Motion, Outcome

HOUR_NS = MINUTES * MINUTE_NS
LIMITS = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
REQUESTS = range(Rank.REQUEST, Rank.REQUEST + 10)


def at(pan: float, tilt: float = 0.0, zoom: float = 1.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom)


def resting(rig, config, reading: HeadReading) -> Work:
    head = HeadState(limits=LIMITS, reading=reading, motion=Motion.STABLE)
    return Work(rig=rig, config=config, head=head, ranges=RangeMap(), t_ns=HOUR_NS)


class TestDeadZone:
    @given(
        pan=st.floats(-0.3, 0.3), tilt=st.floats(-0.3, 0.3), zoom=st.floats(1, 9999),
        zone=st.floats(0, 5), tolerance=st.floats(0.01, 2),
    )  # fmt: skip
    def test_what_a_lock_would_correct_is_always_driven(self, rig, config, pan, tilt, zoom, zone, tolerance) -> None:
        changed = msgspec.structs.replace(config, motor=Motor(dead_zone_deg=zone), lock=Lock(tolerance_deg=tolerance))
        work = resting(rig, changed, at(10.0, 20.0, zoom))
        target = at(10.0 + pan, 20.0 + tilt, zoom)
        work.move(target)
        axes = [
            bearing(math.radians(pose.pan_deg), math.radians(pose.tilt_deg)) for pose in (target, work.head.reading)
        ]
        offset = float(angle_between(*axes))
        needed = min(math.radians(tolerance), 0.02 * rig.zoom.camera_at(zoom).hfov_rad)
        (done,) = work.out
        if offset > needed:
            assert isinstance(done, cmd.MoveHead)
        if isinstance(done, cmd.SpareMove):
            assert math.degrees(offset) <= zone + 1e-9

    @pytest.mark.parametrize(
        "change",
        [
            {"motion": Motion.MOVING}, {"motion": Motion.SETTLING}, {"motion": Motion.UNKNOWN}, {"going": 7},
            {"reading": None},
        ],
    )  # fmt: skip
    def test_a_head_that_is_not_known_to_rest_is_driven(self, rig, config, change) -> None:
        work = resting(rig, config, at(0.0))
        for name, value in change.items():
            setattr(work.head, name, value)
        work.move(at(0.001))
        assert isinstance(work.out[0], cmd.MoveHead)

    def test_without_a_zone_everything_is_driven(self, rig, config) -> None:
        work = resting(rig, msgspec.structs.replace(config, motor=Motor(dead_zone_deg=0.0)), at(0.0))
        work.move(at(0.0))
        assert isinstance(work.out[0], cmd.MoveHead)

    def test_a_request_whose_view_is_there_takes_its_picture_without_a_move(self, world) -> None:
        world.request("a", hold_s=0.0)
        first = world.of(cmd.MoveHead)[0].target
        world.run(until=State.LOCK)
        world.tell(ev.ControlReceived(token=5, verb=ev.Verb.STOP))
        world.run(1.0)
        world.reading = first
        world.tell(ev.HeadPolled(reading=first, motion=Motion.STABLE))
        driven = len(world.of(cmd.MoveHead))
        world.request("b", token=2, hold_s=0.0)
        assert len(world.of(cmd.MoveHead)) == driven
        assert world.of(cmd.SpareMove)[-1].target == first
        assert isinstance(world.of(cmd.GrabView)[-1], cmd.GrabView)
        world.run(until=State.IDLE)
        assert world.results()["b"][0].outcome is Outcome.LOCKED
        assert world.machine.travel.spared >= 1

    def test_the_way_home_from_home_is_over_at_once(self, make_world) -> None:
        world = make_world(home=Home(pan_deg=0.02))
        world.start()
        world.tell(ev.HeadPolled(reading=world.reading, motion=Motion.STABLE))
        world.tell(ev.ControlReceived(token=5, verb=ev.Verb.HOME))
        assert world.machine.state is State.IDLE
        assert not world.of(cmd.MoveHead)


class TestTravel:
    @given(st.lists(st.tuples(st.floats(-170, 170), st.floats(-80, 80), st.integers(1, 9999)), min_size=2, max_size=30))
    def test_no_way_is_lost_and_none_is_made_up(self, places) -> None:
        travel, gone = Travel(), 0.0
        readings = [at(pan, tilt, zoom) for pan, tilt, zoom in places]
        for index, reading in enumerate(readings):
            travel.report(reading, index * MINUTE_NS // 10)
        for before, after in itertools.pairwise(readings):
            gone += abs(math.remainder(after.pan_deg - before.pan_deg, 360)) + abs(after.tilt_deg - before.tilt_deg)
        assert travel.pan_deg + travel.tilt_deg <= gone + 1e-6
        assert travel.pan_deg + travel.tilt_deg >= gone - 0.2 * len(places)
        assert travel.hour(len(places) * MINUTE_NS // 10)[1] == pytest.approx(travel.pan_deg + travel.tilt_deg)

    def test_a_trembling_encoder_goes_nowhere(self) -> None:
        travel = Travel()
        for index in range(100_000):
            travel.report(at(10 + 1 / 256 * (index % 3), zoom=500 + index % 4), index * 100_000_000)
        assert travel.pan_deg == travel.tilt_deg == travel.zoom_steps == 0

    def test_a_turn_over_the_back_is_the_short_way(self) -> None:
        travel = Travel()
        travel.report(at(179.0), 0)
        travel.report(at(-179.0), 1)
        assert travel.pan_deg == pytest.approx(2.0)

    @given(st.lists(st.integers(0, 3 * HOUR_NS), max_size=200))
    def test_an_hour_is_an_hour_and_what_is_kept_has_an_end(self, times) -> None:
        travel, now = Travel(), 3 * HOUR_NS
        for t_ns in sorted(times):
            travel.move(t_ns)
        lately = [t_ns for t_ns in times if t_ns > now - HOUR_NS + MINUTE_NS]
        ever = [t_ns for t_ns in times if t_ns > now - HOUR_NS - MINUTE_NS]
        assert len(lately) <= travel.hour(now)[0] <= len(ever)
        assert len(travel.minutes) <= MINUTES
        assert travel.moves == len(times)


class TestBudget:
    @given(st.floats(0, 0.5))
    def test_a_higher_rank_always_finds_at_least_what_a_lower_one_does(self, reserve) -> None:
        motor = Motor(reserve=reserve)
        shares = [share_of(rank, motor) for rank in range(Rank.HOME + 1, Rank.STOP + 1)]
        assert shares == sorted(shares)
        assert share_of(Rank.REQUEST + 9, motor) == 1.0
        assert share_of(Rank.REQUEST, motor) == pytest.approx(1 - reserve)
        assert all(math.isinf(share_of(rank, motor)) for rank in (Rank.HOME, Rank.LEASE, Rank.LEASE + 8, Rank.STOP))

    @given(st.lists(st.integers(0, HOUR_NS), max_size=60), st.integers(1, 40), st.sampled_from(REQUESTS))
    def test_it_frees_exactly_when_it_says(self, times, budget, rank) -> None:
        travel, motor = Travel(), Motor(moves_per_hour=budget)
        for t_ns in sorted(times):
            travel.move(t_ns)
        now = HOUR_NS
        found = spent(travel, motor, rank, now)
        used = travel.hour(now)[0]
        assert (found is not None) == (used >= share_of(rank, motor) * budget)
        if found is not None:
            assert now < found.frees_ns <= now + HOUR_NS
            assert spent(travel, motor, rank, found.frees_ns - 1) is not None
            assert spent(travel, motor, rank, found.frees_ns) is None
            assert "motor.moves_per_hour" in found.words


@pytest.fixture
def tired(make_world):
    """A rig that has moved as often as it may, but for the highest."""
    world = make_world(motor=Motor(moves_per_hour=10), queue=Queue(timeout_s=3 * 3600.0))
    world.start()
    for _ in range(9):
        world.machine.travel.move(world.t_ns)
    return world


def test_the_lower_rank_waits_until_there_is_some_again(tired) -> None:
    tired.request("low")
    assert tired.machine.state is State.IDLE
    (note,) = [told for told in tired.of(cmd.PublishFeedback) if told.id == "low" and told.step == "note"]
    assert "motor.moves_per_hour: 9 moves in the last hour, of 10 this rank may use 80%" in note.detail["text"]
    assert not tired.of(cmd.MoveHead)
    begun_ns = tired.t_ns
    tired.run(2 * 3600.0, until=State.SCAN)
    assert 59 * MINUTE_NS <= tired.t_ns - begun_ns <= 61 * MINUTE_NS
    tired.run(until=State.IDLE)
    assert tired.results()["low"][0].outcome is Outcome.LOCKED


def test_who_has_no_time_to_wait_is_refused_with_the_budget_and_when_it_frees(tired) -> None:
    tired.request("low", timeout_s=60.0)
    (refused,) = tired.of(cmd.ReplyRefused)
    assert refused.code == "budget"
    assert "motor.moves_per_hour: 9 moves in the last hour, of 10 this rank may use 80%" in refused.message
    assert "there is some again in 3" in refused.message
    assert not tired.of(cmd.MoveHead)


def test_the_highest_still_finds_some_and_goes_before_what_waits(tired) -> None:
    tired.request("low")
    tired.request("high", token=2, priority=9, hold_s=0.0)
    assert tired.machine.state is State.SCAN
    tired.run(until=State.IDLE)
    assert tired.results()["high"][0].outcome is Outcome.LOCKED
    assert tired.machine._memory.waiting[0].id == "low"
    tired.run(60.0, until=State.HOME)
    assert tired.machine.state is State.HOME, "the way home is never kept back"


def test_what_finds_none_takes_nobodys_place(tired) -> None:
    tired.request("first", priority=9, hold_s=600.0)
    tired.run(until=State.LOCK)
    for _ in range(30):
        tired.machine.travel.move(tired.t_ns)
    tired.tell(ev.ControlReceived(token=5, verb=ev.Verb.RELEASE))
    tired.request("second", token=2, priority=8)
    assert tired.machine._memory.task is None or tired.machine._memory.task.request.id == "first"


def test_a_person_a_stop_and_home_are_never_kept_back(tired) -> None:
    for _ in range(1000):
        tired.machine.travel.move(tired.t_ns)
    tired.tell(ev.ControlReceived(token=5, verb=ev.Verb.STOP))
    tired.run(1.0)
    assert tired.of(cmd.ReplyOutcome)[-1].outcome == "stopped"
    tired.reading = at(50.0)
    tired.tell(ev.HeadPolled(reading=tired.reading, motion=Motion.STABLE))
    tired.tell(ev.ControlReceived(token=6, verb=ev.Verb.HOME))
    assert tired.machine.state is State.HOME
    tired.run(3.0)
    tired.tell(ev.LeaseAsked(token=7, wish=ev.LeaseWish.TAKE, owner="desk"))
    assert tired.machine.state is State.MANUAL
    tired.request("mine", token=8, by="desk", hold_s=0.0)
    assert tired.machine.state is State.SCAN


def test_a_target_that_goes_on_and_on_is_followed_no_more(tired) -> None:
    tired.request("high", priority=9, hold_s=600.0)
    tired.run(until=State.LOCK)
    tired.run(10.0)
    for _ in range(30):
        tired.machine.travel.move(tired.t_ns)
    tired.frame(1)
    tired.tell(ev.UpdateReceived(token=4, id="high", box=tired.machine._memory.task.request.region.box))
    refused = tired.of(cmd.ReplyRefused)[-1]
    assert refused.code == "budget"
    assert tired.machine.state is State.LOCK


def test_waiting_for_it_ends_with_the_clients_time_and_says_so(tired) -> None:
    tired.request("low", timeout_s=3700.0)
    tired.tell(ev.ControlReceived(token=5, verb=ev.Verb.HOLD))
    tired.run(3800.0)
    assert tired.results()["low"][0].outcome is Outcome.TIMEOUT


def test_it_goes_on_from_a_snapshot(tired, rig) -> None:
    tired.request("low")
    twin = Machine.restored(rig, tired.machine.config, tired.machine.snapshot())
    assert twin.travel == tired.machine.travel
    assert twin.deadline_ns() == tired.machine.deadline_ns()
