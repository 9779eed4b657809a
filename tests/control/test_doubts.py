"""When the head is in doubt: two that say the same, never one; and what takes a doubt back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.doubts import Doubts
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.model import Box, HeadReading, Motion, Turn, Turned


def at(pan: float, tilt: float = 0.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=1.0)


def found(verdict: Turn, pan: float = 0.0, tilt: float = 0.0, *, place: float = 0.0, turned: bool = False) -> Turned:
    before = at(place - 20.0) if turned else at(place)
    return Turned(verdict=verdict, before=before, after=at(place), pan_off_deg=pan, tilt_off_deg=tilt, turned=turned)


SLIP = found(Turn.SLIPPED, 2.0, 1.0)
UNMOVED = found(Turn.UNMOVED, turned=True)


def compared(*found_: Turned, reference: bool = True) -> Doubts:
    doubts = Doubts()
    for one in found_:
        doubts.compared(one, reference=reference and one.verdict is not Turn.UNMOVED)
    return doubts


@given(st.lists(st.sampled_from([Turn.AGREES, Turn.UNKNOWN]), max_size=20), st.sampled_from([SLIP, UNMOVED]))
def test_one_contradiction_among_any_number_of_others_is_no_doubt(others, one) -> None:
    for place in range(len(others) + 1):
        story = [found(verdict) for verdict in others]
        story.insert(place, one)
        assert compared(*story).words == ""


def test_two_of_the_same_are(world) -> None:
    assert compared(UNMOVED, UNMOVED).words.startswith("stuck: reported at pan 0.00°")
    assert compared(SLIP, SLIP).words == (
        "lost its zero: pictures look +2.00° in pan and +1.00° in tilt off what is reported"
    )


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_slips_that_differ_do_not_confirm_each_other(pan, tilt) -> None:
    other = found(Turn.SLIPPED, pan, tilt)
    apart = ((pan - 2.0) ** 2 + (tilt - 1.0) ** 2) ** 0.5
    if apart > 0.3 * max((pan**2 + tilt**2) ** 0.5, 1.0):
        assert compared(SLIP, other).words == ""


def test_only_the_place_that_testified_takes_a_lost_zero_back() -> None:
    doubts = compared(SLIP, SLIP)
    doubts.compared(found(Turn.AGREES, place=40.0), reference=True)
    doubts.compared(found(Turn.AGREES), reference=False)
    assert doubts.words
    doubts.compared(found(Turn.AGREES), reference=True)
    assert doubts.words == ""


def test_only_a_turn_that_the_pictures_follow_takes_a_stuck_head_back() -> None:
    doubts = compared(UNMOVED, UNMOVED)
    doubts.compared(found(Turn.AGREES), reference=True)
    assert doubts.words
    doubts.compared(found(Turn.AGREES, turned=True), reference=False)
    assert doubts.words == ""


def test_pairs_alone_do_not_take_the_zero(world) -> None:
    """Without a look of this very place from before nobody can say which of both was right."""
    assert compared(SLIP, SLIP, reference=False).words == ""


@pytest.mark.parametrize(("target", "rests", "doubted"), [
    (at(40.0), at(0.0), True), (at(40.0), at(0.05), True), (at(40.0), at(12.0), False), (at(40.0), at(40.0), False),
    (at(0.5), at(0.0), False),
])  # fmt: skip
def test_a_head_that_is_reported_where_it_was_after_two_moves_is_stuck(target, rests, doubted) -> None:
    doubts = Doubts()
    doubts.came(at(0.0), target, rests)
    assert doubts.words == ""
    doubts.came(at(0.0), target, rests)
    assert doubts.words.startswith("stuck: told to go to") is doubted
    doubts.came(at(0.0), at(40.0), at(39.9))
    assert doubts.words == ""


def test_it_is_told_once_in_the_status_and_in_every_result_until_it_is_taken_back(world, rig) -> None:
    told = len(world.of(cmd.PublishStatus))
    for _ in range(5):
        world.tell(ev.ViewsCompared(found=SLIP, reference=True))
    (status,) = world.of(cmd.PublishStatus)[told:]
    assert status.doubt.startswith("lost its zero")
    world.request("a", hold_s=0.0)
    world.run(until=State.IDLE)
    assert "beware, the head is in doubt: lost its zero" in world.results()["a"][0].reason
    twin = Machine.restored(rig, world.machine.config, world.machine.snapshot())
    twin.handle(ev.ViewsCompared(found=found(Turn.AGREES), reference=True), world.t_ns)
    world.tell(ev.ViewsCompared(found=found(Turn.AGREES), reference=True))
    assert twin.snapshot() == world.machine.snapshot()
    world.request("b", token=2, hold_s=0.0)
    world.run(until=State.IDLE)
    assert "doubt" not in world.results()["b"][0].reason


def test_a_motor_that_takes_no_moves_is_told_from_its_reports(world) -> None:
    world.tell(ev.HeadPolled(reading=world.reading, motion=Motion.STABLE))
    for token, name in enumerate(("a", "b"), start=1):
        world.silent = {cmd.MoveHead}
        world.request(name, token=token, box=Box(x=150, y=230, w=40, h=32), hold_s=0.0)
        for move in world.of(cmd.MoveHead)[-1:]:
            world.tell(ev.HeadStalled(move_id=move.move_id, reading=world.reading, reason="rests"))
        world.run(until=State.IDLE)
    doubt = world.of(cmd.PublishStatus)[-1].doubt
    assert doubt.startswith("stuck: told to go to")
