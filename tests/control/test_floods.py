"""What a flood of messages can make the core forget: nothing that somebody relies on."""

from __future__ import annotations

from ptzd.control import admission
from ptzd.control.desk import ENDED_KEPT
from ptzd.control.states import State
from ptzd.model import Box

NOWHERE = Box(x=-900, y=-900, w=1, h=1)


def test_refused_puts_let_no_end_be_forgotten(world) -> None:
    """The same put again after more refusals than are remembered: still the one result of the first time."""
    world.request("a", hold_s=0.0)
    world.run(until=State.LOCK)
    world.run(5)
    for number in range(ENDED_KEPT + 10):
        world.request(f"junk-{number}", token=None, box=NOWHERE)
    assert world.request("a", token=None, box=NOWHERE) == []
    assert world.request("a", token=None) == []
    (told,) = world.request("a", token=5)
    assert told.code == "ended"
    assert len(world.results()["a"]) == 1


def test_the_newest_refusals_are_remembered_too(world) -> None:
    for number in range(ENDED_KEPT + 10):
        world.request(f"junk-{number}", token=None, box=NOWHERE)
    assert world.request("junk-10", token=None, box=NOWHERE) == []
    assert len(world.request("junk-9", token=None, box=NOWHERE)) == 1


def test_who_finds_no_room_is_told_so_before_his_box_is_looked_at(world, monkeypatch) -> None:
    """Looking costs rays of the lens; a flood that costs little leaves the loop to the operator's stop."""
    for number in range(9):
        world.request(f"r{number}")
    monkeypatch.setattr(admission, "check_box", None)
    for number in range(10):
        (told,) = world.request(f"late-{number}")
        assert told.code == "busy"
