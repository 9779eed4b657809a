"""Places that look alike: none of them is believed before each was looked at closely."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import HeadLimits, MatchResult, Outcome

LEAD = 0.005
"""What one copy of a place is ahead of the other by chance."""
RANGES_M = (0.9, 100.0)


def copies(world, *inverse_ranges: float) -> None:
    """Let the matcher see equal places at these inverse ranges, the first one by chance ahead."""
    see, score = world.match, world.score

    def match(job: cmd.RunMatch) -> MatchResult:
        found = []
        for order, world.inverse_range in enumerate(inverse_ranges):
            world.score = score - LEAD * order
            found += see(job).candidates
        return replace(see(job), candidates=tuple(found))

    world.match = match


def closer_round(world) -> bool:
    """Whether the request is in its second round."""
    return any(step.step == "plan" and step.detail["round"] == 2 for step in world.of(cmd.PublishFeedback))


def places_seen(world) -> int:
    """The most places that one picture showed."""
    return max((int(s.detail["candidates"]) for s in world.of(cmd.PublishFeedback) if s.step == "match"), default=0)


def failing(world, kind: type[cmd.Command], which: int, silent: bool) -> None:
    """Let one job of the closer round fail, or stay unanswered."""
    perform, count = world._perform, iter(range(100))

    def follow(command: cmd.Command) -> None:
        if not isinstance(command, kind) or not closer_round(world) or next(count) != which:
            perform(command)
        elif not silent and isinstance(command, cmd.RunMatch):
            answer = world._answer(0.03, ev.MatchFailed, match_id=command.match_id, reason="broken")
            world._matches.append(answer)
        elif not silent and isinstance(command, cmd.MoveHead):
            world._head_answer = world._answer(
                0.5, ev.HeadStalled, move_id=command.move_id, reading=world.reading, reason="blocked"
            )

    world._perform = follow


@given(first=st.floats(0.05, 1.0), second=st.floats(0.05, 1.0))
def test_what_is_seen_twice_is_never_locked(new_world, first: float, second: float) -> None:
    """Wherever the copies are, in one closer view or in two, and whichever is looked at first."""
    world = new_world()
    copies(world, first, second)
    world.start()
    world.request("a", range_m=RANGES_M)
    world.run()
    (result,) = world.results()["a"]
    if places_seen(world) >= 2:
        assert result.outcome is Outcome.AMBIGUOUS, result.reason
        assert result.probability < 0.5


@given(pan_deg=st.floats(-40.0, 0.0), first=st.floats(0.1, 0.5), second=st.floats(0.8, 1.8))
def test_a_copy_that_no_closer_view_shows_is_not_forgotten(rig, new_world, pan_deg, first, second) -> None:
    world = new_world()
    copies(world, first, second)
    world.limits = HeadLimits(pan_deg=(pan_deg, 170.0), tilt_deg=(-80.0, 80.0), zoom=(1.0, 9999.0))
    world.start()
    world.request("a", range_m=(0.5, 100.0))
    world.run()
    (result,) = world.results()["a"]
    if places_seen(world) >= 2:
        assert result.outcome is Outcome.AMBIGUOUS, result.reason
    if not closer_round(world) and result.outcome is Outcome.AMBIGUOUS:
        assert "closer look at the place at pan" in result.reason


@pytest.mark.parametrize("silent", [False, True])
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("kind", [cmd.RunMatch, cmd.MoveHead])
def test_a_closer_view_that_fails_proves_nothing_of_the_others(world, kind, which: int, silent: bool) -> None:
    copies(world, 0.25, 0.9)
    failing(world, kind, which, silent)
    world.request("a", range_m=RANGES_M, timeout_s=300.0)
    world.run(400.0)
    (result,) = world.results()["a"]
    assert closer_round(world)
    assert result.outcome is Outcome.AMBIGUOUS, result.reason
    assert "1 of 2 closer views could be used" in result.reason


def test_a_copy_that_is_none_from_near_leaves_the_other_found(world) -> None:
    """What a closer round is for."""
    copies(world, 0.25, 0.9)
    both, world.inverse_range = world.match, 0.25
    alone = type(world).match

    def match(job: cmd.RunMatch) -> MatchResult:
        if not closer_round(world):
            return both(job)
        world.inverse_range, world.score = 0.25, 0.95
        return alone(world, job)

    world.match = match
    world.request("a", range_m=RANGES_M)
    world.run()
    (result,) = world.results()["a"]
    assert closer_round(world)
    assert result.outcome is Outcome.LOCKED, result.reason
    assert result.range_m == pytest.approx(4.0, rel=0.01)
