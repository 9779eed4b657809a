"""Locks teach the core where things are; the map orders its looks and never answers for it."""

import math
from dataclasses import replace

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.config import Ranges, Search
from ptzd.control import commands as cmd
from ptzd.control.events import CancelReceived, RangesAsked
from ptzd.control.machine import Machine
from ptzd.control.planning.decision import Prior, Thresholds, Verdict, decide
from ptzd.control.planning.ranges import RangeLock, RangeMap
from ptzd.geometry.sphere import bearing
from ptzd.model import Box, Candidate, Matcher, MatchResult, Outcome

BESIDE = Box(x=336, y=238, w=40, h=32)


def learned(world) -> list[RangeLock]:
    return world.machine.ranges.locks


def ended(world, name: str = "a") -> cmd.PublishResult:
    (result,) = world.results()[name]
    return result


def moves(world) -> list[cmd.MoveHead]:
    return world.of(cmd.MoveHead)


def test_a_confirmed_lock_teaches_its_range(world) -> None:
    world.request(hold_s=1.0)
    world.run(60)
    assert ended(world).outcome is Outcome.LOCKED
    (taught,) = learned(world)
    assert taught.id == "a"
    assert 1.0 / taught.inverse_range == pytest.approx(ended(world).range_m, rel=1e-3)
    assert 0.0 < taught.sigma < 0.1 * taught.inverse_range
    assert taught.t_ns < world.t_ns


@pytest.mark.parametrize("score", [0.1, 0.25])
def test_what_was_not_found_teaches_nothing(world, score: float) -> None:
    world.score = score
    world.request(hold_s=1.0)
    world.run(60)
    assert ended(world).outcome in {Outcome.NOT_FOUND, Outcome.AMBIGUOUS}
    assert learned(world) == []


def test_a_lock_that_is_cancelled_teaches_nothing(world) -> None:
    world.request(hold_s=20.0)
    world.run(8)
    world.tell(CancelReceived(token=99, id="a"))
    world.run(60)
    assert ended(world).outcome is Outcome.CANCELLED
    assert learned(world) == []


def test_a_lock_among_copies_teaches_nothing(world) -> None:
    """A closer look told two places apart that looked alike: that is good for an answer, not for a lesson."""
    see, closer = world.match, []

    def match(job: cmd.RunMatch) -> MatchResult:
        found = list(see(job).candidates)
        first_round = len(world.of(cmd.RunMatch)) == 1
        closer.append(not first_round)
        if first_round:
            copy = replace(found[0], pan_rad=found[0].pan_rad - 0.12, inverse_range=0.6, score=found[0].score - 0.01)
            found.append(copy)
        return replace(see(job), candidates=tuple(found))

    world.match = match
    world.request(hold_s=1.0)
    world.run(60)
    assert any(closer)
    assert ended(world).outcome is Outcome.LOCKED
    assert learned(world) == []


def test_the_next_request_beside_it_starts_where_the_first_one_was_found(make_world) -> None:
    world = make_world(search=Search(scan_hfov_deg=8.0))
    world.start()
    world.request("a", hold_s=1.0)
    world.run(60)
    looks_before = ended(world, "a").views
    world.frame(1)
    before = len(moves(world))
    world.request("b", box=BESIDE, hold_s=1.0)
    world.run(60)
    first = moves(world)[before].target
    pan, tilt = math.radians(ended(world, "b").pan_deg), math.radians(ended(world, "b").tilt_deg)
    pixel, valid = world.rig.project_to_view(bearing(pan, tilt), first)
    assert valid
    assert 0 <= pixel[0] < 640
    assert 0 <= pixel[1] < 480
    assert ended(world, "b").views <= looks_before
    told = {step.id: step.detail for step in world.of(cmd.PublishFeedback) if step.step == "plan"}
    assert "range_expected_m" not in told["a"]
    assert told["b"]["range_expected_m"] == pytest.approx(4.0, rel=0.02)
    assert ended(world, "b").outcome is Outcome.LOCKED


def test_switched_off_it_neither_learns_nor_uses(make_world) -> None:
    plain, off = make_world(ranges=Ranges(learn=False)), make_world(ranges=Ranges(learn=False))
    for world in (plain, off):
        world.start()
    learned(off).append(RangeLock(id="x", ray=(0.0, 0.0, 1.0), inverse_range=0.9, sigma=0.001, t_ns=off.t_ns))
    for world in (plain, off):
        world.request(hold_s=1.0)
        world.run(60)
    assert plain.done == off.done
    assert learned(plain) == []
    assert len(learned(off)) == 1


def test_a_snapshot_carries_the_map_and_goes_on_exactly(world) -> None:
    world.request("a", hold_s=1.0)
    world.run(60)
    snapshot, since, done = world.machine.snapshot(), len(world.told), len(world.done)
    body = msgspec.json.decode(msgspec.json.encode(snapshot.state))
    other = Machine.restored(world.rig, world.machine.config, replace(snapshot, state=body))
    assert other.ranges.locks == learned(world) != []
    world.frame(1)
    world.request("b", box=BESIDE, hold_s=1.0)
    world.run(60)
    assert world.replayed(other, since) == world.done[done:]
    assert other.ranges.locks == learned(world)
    assert len(learned(world)) == 2


def test_a_core_without_a_map_in_its_snapshot_begins_with_none(world) -> None:
    snapshot = world.machine.snapshot()
    state = {name: value for name, value in snapshot.state.items() if name != "ranges"}
    assert Machine.restored(world.rig, world.machine.config, replace(snapshot, state=state)).ranges == RangeMap()


def test_the_picture_overrules_the_map(make_world) -> None:
    """All locks say four metres; what is clearly seen at two is found there all the same."""
    world = make_world()
    world.start()
    for name in "abc":
        world.frame(ord(name))
        world.request(name, hold_s=0.5)
        world.run(40)
    world.inverse_range = 0.5
    world.frame(500)
    world.request("walker", hold_s=0.5)
    world.run(60)
    assert ended(world, "walker").outcome is Outcome.LOCKED
    assert ended(world, "walker").range_m == pytest.approx(2.0, rel=0.01)


def see_copies(world, *inverse_ranges: float) -> None:
    """Let the matcher see equal places at these inverse ranges, the first one by chance ahead."""
    see = world.match

    def match(job: cmd.RunMatch) -> MatchResult:
        found = []
        for order, world.inverse_range in enumerate(inverse_ranges):
            found += [replace(one, score=0.95 - 0.005 * order) for one in see(job).candidates]
        return replace(see(job), candidates=tuple(found))

    world.match = match


@given(
    surfaces=st.lists(st.floats(0.02, 0.49), min_size=1, max_size=6),
    copies=st.permutations([0.05, 0.25, 0.45]).map(lambda some: some[:2]),
)
@settings(max_examples=25)
def test_of_two_copies_none_is_found_whatever_the_map_says(new_world, surfaces, copies) -> None:
    """Without a map they are ambiguous: so they are with one that knows where the target stands."""
    world = new_world()
    world.start()
    ray = tuple(world.rig.fisheye.lift((350.0, 246.0))[0].tolist())
    world.machine.ranges.locks += [
        RangeLock(id=f"l{k}", ray=ray, inverse_range=s, sigma=0.001, t_ns=world.t_ns) for k, s in enumerate(surfaces)
    ]
    see_copies(world, *copies)
    world.request(range_m=(2.0, 100.0), hold_s=0.0)
    world.run(60)
    assert ended(world).outcome is Outcome.AMBIGUOUS
    assert len(learned(world)) == len(surfaces)


def test_a_closer_round_is_as_close_as_without_a_map(new_world) -> None:
    """A map that has zoomed the first look in makes no closer one than a picture can be told by."""

    def zooms(*known: float) -> list[float]:
        world = new_world()
        world.start()
        ray = tuple(world.rig.fisheye.lift((350.0, 246.0))[0].tolist())
        world.machine.ranges.locks += [
            RangeLock(id="l", ray=ray, inverse_range=s, sigma=0.001, t_ns=world.t_ns) for s in known
        ]
        see_copies(world, 0.05, 0.45)
        world.request(range_m=(2.0, 100.0), hold_s=0.0)
        world.run(60)
        return [move.target.zoom for move in moves(world)][: ended(world).views]

    plain, by_map = zooms(), zooms(0.25, 0.25)
    assert by_map[0] > plain[0]
    assert by_map[1:] == plain[1:]


@given(surfaces=st.lists(st.floats(0.0, 0.98), min_size=1, max_size=6), s=st.floats(0.02, 0.49))
@settings(max_examples=25)
def test_what_is_clearly_seen_is_found_whatever_the_map_says(new_world, surfaces, s: float) -> None:
    world = new_world()
    world.start()
    ray = tuple(world.rig.fisheye.lift((350.0, 246.0))[0].tolist())
    world.machine.ranges.locks += [
        RangeLock(id=f"l{k}", ray=ray, inverse_range=one, sigma=0.001, t_ns=world.t_ns)
        for k, one in enumerate(surfaces)
    ]
    world.inverse_range = s
    world.request(range_m=(2.0, 100.0), hold_s=0.0)
    world.run(60)
    assert ended(world).outcome is Outcome.LOCKED
    assert ended(world).range_m == pytest.approx(1.0 / s, rel=0.01)
    assert learned(world)[-1].id == "a"


# shown and taken back


def asked(world, **forget: object) -> cmd.ReplyRanges:
    (reply,) = world.tell(RangesAsked(token=77, **forget))
    assert isinstance(reply, cmd.ReplyRanges)
    return reply


@pytest.fixture
def taught(world):
    """A rig with three locks, the last one 150 px beside the others."""
    for name, box in (("a", BESIDE), ("b", BESIDE), ("c", replace(BESIDE, x=486))):
        world.frame(ord(name))
        world.request(name, box=box, hold_s=0.0)
        world.run(30)
    assert [one.id for one in learned(world)] == ["a", "b", "c"]
    return world


def test_it_is_told_where_each_lock_lies_and_what_it_counts(taught) -> None:
    told = asked(taught)
    assert (told.learning, told.forgotten) == (True, 0)
    assert [one.id for one in told.known] == ["a", "b", "c"]
    assert (told.known[2].x_px, told.known[2].y_px) == pytest.approx((506, 254), abs=0.1)
    assert all(one.range_m == pytest.approx(4.0, rel=1e-3) for one in told.known)
    assert all(0.99 < one.weight <= 1.0 for one in told.known)
    assert all(0.0 < one.sigma_share < 0.1 for one in told.known)


@pytest.mark.parametrize(
    ("forget", "left"),
    [
        ({"forget_last": 1}, ["a", "b"]),
        ({"forget_last": 2}, ["a"]),
        ({"forget_last": 50}, []),
        ({"forget_all": True}, []),
        ({"forget_box": Box(x=480, y=230, w=60, h=60)}, ["a", "b"]),
        ({"forget_box": Box(x=0, y=0, w=640, h=480)}, []),
        ({"forget_box": Box(x=0, y=0, w=20, h=20)}, ["a", "b", "c"]),
    ],
)
def test_what_is_forgotten_is_gone_and_the_rest_stays(taught, forget, left: list[str]) -> None:
    told = asked(taught, **forget)
    assert [one.id for one in told.known] == [one.id for one in learned(taught)] == left
    assert told.forgotten == 3 - len(left)


def test_forgetting_by_put_is_answered_nowhere(taught) -> None:
    assert taught.tell(RangesAsked(token=None, forget_all=True)) == []
    assert learned(taught) == []


def test_forgotten_the_next_request_goes_as_the_first_one_went(make_world) -> None:
    """Undone is as if it had never been."""
    worlds = [make_world(search=Search(scan_hfov_deg=8.0)) for _ in range(2)]
    for world in worlds:
        world.start()
    worlds[0].request("gone", hold_s=0.0)
    worlds[0].run(60)
    asked(worlds[0], forget_last=1)
    worlds[1].run(60)
    for world in worlds:
        world.frame(5)
        world.request("b", box=BESIDE, hold_s=0.0)
        world.run(60)
    first, second = ([move.target for move in moves(world)][-ended(world, "b").views :] for world in worlds)
    assert first == second
    assert ended(worlds[0], "b").views == ended(worlds[1], "b").views


def test_a_replay_forgets_the_same(taught) -> None:
    snapshot, since, done = taught.machine.snapshot(), len(taught.told), len(taught.done)
    other = Machine.restored(taught.rig, taught.machine.config, snapshot)
    asked(taught, forget_box=Box(x=480, y=230, w=60, h=60))
    assert taught.replayed(other, since) == taught.done[done:]
    assert other.ranges.locks == learned(taught)


# the decision


def place(score: float, s: float) -> Candidate:
    return Candidate(
        pan_rad=s, tilt_rad=0.0, inverse_range=s, offset_rad=0.0, score=score, sharpness=0.3, sigma_rad=4e-4,
        plane=(0.0, 0.0, s), box_px=((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0)),
    )  # fmt: skip


places = st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(1, 40)), max_size=5, unique_by=lambda pair: pair[1])
densities = st.lists(st.floats(0.25, 80.0), min_size=41, max_size=41)


@given(seen=places, known=densities, accept=st.floats(0.3, 0.95), of_place=st.booleans())
def test_a_map_never_makes_an_answer_found_nor_surer(seen, known, accept: float, of_place: bool) -> None:
    candidates = tuple(place(score, s / 40) for score, s in sorted(seen, reverse=True))
    result = MatchResult(
        matcher=Matcher.SWEEP, texture=9.0, candidates=candidates, coverage=(0.0, 1.0), seed=1, elapsed_ms=1.0
    )
    thresholds = Thresholds(accept_probability=accept)
    alone = decide([(0, result)], thresholds)
    with_map = decide([(0, result)], thresholds, Prior(density=lambda s: known[round(s * 40)], of_place=of_place))
    assert with_map.probability <= alone.probability
    assert with_map.best == alone.best
    assert with_map.rivals == alone.rivals
    if alone.outcome is not Verdict.FOUND:
        assert with_map == alone
    else:
        assert with_map.outcome in {Verdict.FOUND, Verdict.AMBIGUOUS}
        assert with_map.against_the_map == (with_map.outcome is Verdict.AMBIGUOUS)


@given(known=densities)
def test_a_clear_picture_is_believed_whatever_the_map_says(known) -> None:
    result = MatchResult(
        matcher=Matcher.SWEEP, texture=9.0, candidates=(place(0.97, 0.5), place(0.3, 0.1)), coverage=(0.0, 1.0), seed=1,
        elapsed_ms=1.0,
    )  # fmt: skip
    prior = Prior(density=lambda s: known[round(s * 40)], of_place=True)
    assert decide([(0, result)], Thresholds(), prior).outcome is Verdict.FOUND


def test_of_two_alike_the_one_where_nothing_stands_must_lead_clearly() -> None:
    def outcome(lead: float, of_place: bool) -> Verdict:
        seen = MatchResult(
            matcher=Matcher.SWEEP, texture=9.0, candidates=(place(0.93, 0.5), place(0.93 - lead, 0.1)),
            coverage=(0.0, 1.0), seed=1, elapsed_ms=1.0,
        )  # fmt: skip
        assert decide([(0, seen)], Thresholds()).outcome is Verdict.FOUND
        prior = Prior(density=lambda s: 20.0 if s == 0.1 else 0.25, of_place=of_place)
        return decide([(0, seen)], Thresholds(), prior).outcome

    assert [outcome(0.08, of_place) for of_place in (True, False)] == [Verdict.AMBIGUOUS] * 2
    assert [outcome(0.2, of_place) for of_place in (True, False)] == [Verdict.FOUND] * 2
