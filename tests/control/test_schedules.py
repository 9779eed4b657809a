"""The schedule begins and ends patrols; the last word counts, a person's or its own."""

from __future__ import annotations

from ptzd.control import commands as cmd
from ptzd.control.states import State
from tests.control.patrolling import WAY_S, ask, due, refused, shown, start, went_to


def test_the_schedule_begins_and_ends_it(world) -> None:
    due(world, "night", "2026-03-01T21:00:00Z")
    assert world.machine.state is State.PATROL
    assert shown(world).scheduled
    moves = len(world.of(cmd.MoveHead))
    due(world, "night", "2026-03-01T21:00:00Z")
    assert len(world.of(cmd.MoveHead)) == moves
    world.run(WAY_S + 1.0)
    due(world, "", "")
    assert shown(world) is None
    world.run(until=State.HOME)


def test_windows_that_adjoin_are_one_patrol(world) -> None:
    due(world, "night", "2026-03-01T00:00:00Z")
    world.run(WAY_S + 4.0)
    until_ns = shown(world).until_ns
    due(world, "night", "2026-03-02T00:00:00Z")
    assert shown(world).until_ns == until_ns
    due(world, "", "")
    assert shown(world) is None


def test_ended_by_a_person_it_stays_ended_until_the_next_window(world) -> None:
    due(world, "night", "2026-03-01T21:00:00Z")
    ask(world, "stop")
    due(world, "night", "2026-03-01T21:00:00Z")
    assert shown(world) is None
    due(world, "", "")
    due(world, "night", "2026-03-02T21:00:00Z")
    assert shown(world).patrol == "night"


def test_begun_by_a_person_it_does_not_end_with_a_window(world) -> None:
    due(world, "night", "2026-03-01T21:00:00Z")
    start(world, "alone")
    due(world, "", "")
    assert shown(world).patrol == "alone"
    due(world, "night", "2026-03-02T21:00:00Z")
    assert shown(world).patrol == "night", "the last word counts"


def test_a_scheduled_one_passes_over_what_cannot_be_reached_and_says_so(world) -> None:
    due(world, "far", "2026-03-01T21:00:00Z")
    world.run(30.0)
    assert went_to(world) == ["yard"]
    assert shown(world).trouble.startswith("behind is passed over: behind lies at pan 179.00°")


def test_one_that_can_go_nowhere_is_over_and_says_so(world) -> None:
    told = refused(due(world, "nowhere", "2026-03-01T21:00:00Z"))
    assert told.message.startswith("patrol nowhere is over, none of its places can be reached; behind is passed over")
    assert (world.machine.state, shown(world)) == (State.IDLE, None)
