"""A shadow: every look of a life is missed, and nothing is claimed that only a picture could tell."""

from __future__ import annotations

import pytest

from ptzd.config import Search, Shadow
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.model import HeadLimits, Outcome

BEHIND = HeadLimits(pan_deg=(120, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
"""A head that cannot look where the fisheye does."""


@pytest.fixture
def shadow(make_world):
    """A rig whose camera stands where no look goes."""
    world = make_world(shadow=Shadow(enabled=True), search=Search(scan_hfov_deg=12.0, range_m=(0.7, 100.0)))
    taken = world._perform

    def missed(command: cmd.Command) -> None:
        if isinstance(command, cmd.GrabView):
            reason = "the camera stands elsewhere"
            world._head_answer = world._answer(0.2, ev.ViewMissed, grab_id=command.grab_id, reason=reason)
        else:
            taken(command)

    world._perform, world.taken = missed, taken
    world.start()
    return world


def test_every_view_of_the_plan_is_told_in_its_order_and_the_end_is_its_own(shadow) -> None:
    shadow.request("a", hold_s=0.0)
    shadow.run(until=State.IDLE)
    (result,) = shadow.results()["a"]
    told = [step.detail for step in shadow.of(cmd.PublishFeedback) if step.step == "shadow"]
    moves = [move.target for move in shadow.of(cmd.MoveHead)]
    assert [(step["pan_deg"], step["tilt_deg"], step["zoom"]) for step in told] == [
        (target.pan_deg, target.tilt_deg, target.zoom) for target in moves
    ]
    assert len(moves) > 1
    assert [step["after_s"] for step in told] == pytest.approx([index + 1.0 for index in range(len(told))])
    assert result.outcome is Outcome.SHADOW
    assert f"would have taken {len(moves)} looks: pan {moves[0].pan_deg:.2f}°" in result.reason
    assert result.pan_deg is None
    assert not shadow.of(cmd.RunMatch)


def test_what_no_picture_is_needed_for_is_told_as_ever(shadow) -> None:
    """A place out of reach, a time that runs out, a request taken back: a shadow decides these for real."""
    shadow.tell(ev.HeadReady(limits=BEHIND, reading=shadow.reading))
    shadow.request("out", hold_s=0.0)
    shadow.tell(ev.HeadReady(limits=shadow.limits, reading=shadow.reading))
    shadow.request("late", token=2, timeout_s=1.5)
    shadow.run(2.0)
    shadow.request("taken", token=3)
    shadow.run(1.5)
    shadow.tell(ev.CancelReceived(token=4, id="taken"))
    ends = {name: results[0].outcome for name, results in shadow.results().items()}
    assert ends == {"out": Outcome.UNREACHABLE, "late": Outcome.TIMEOUT, "taken": Outcome.CANCELLED}


def test_pictures_taken_where_asked_count_and_end_where_they_end(shadow) -> None:
    """The camera happens to stand at the views of the scan, and then not where the place would be centred."""
    misses, shadow._perform = shadow._perform, shadow.taken
    shadow.request("a", hold_s=0.0)
    shadow.run(until=State.LOCK)
    shadow._perform = misses
    shadow.run(until=State.IDLE)
    (result,) = shadow.results()["a"]
    assert result.outcome is Outcome.SHADOW
    assert "would have taken one look" in result.reason


def test_it_is_told_in_the_status_and_a_stop_is_not_told_as_one(shadow) -> None:
    assert shadow.of(cmd.PublishStatus)[-1].shadow
    shadow.request("a")
    shadow.tell(ev.ControlReceived(token=7, verb=ev.Verb.STOP))
    shadow.run(1.0)
    (refused,) = [reply for reply in shadow.of(cmd.ReplyRefused) if reply.token == 7]
    assert refused.code == "shadow"
    assert "whoever moves it must stop it" in refused.message
    assert shadow.results()["a"][0].outcome is Outcome.CANCELLED
    assert not [reply for reply in shadow.of(cmd.ReplyOutcome) if reply.token == 7]


def test_a_head_that_moves_is_no_shadow(world) -> None:
    world.request("a", hold_s=0.0)
    world.run(until=State.IDLE)
    assert not any(status.shadow for status in world.of(cmd.PublishStatus))
    assert world.results()["a"][0].outcome is Outcome.LOCKED


def test_it_goes_on_from_a_snapshot_in_the_middle(shadow, rig) -> None:
    shadow.request("a", hold_s=0.0)
    shadow.run(1.1)
    assert shadow.machine._memory.task.missed
    shadow.machine = Machine.restored(rig, shadow.machine.config, shadow.machine.snapshot())
    shadow.run(until=State.IDLE)
    assert shadow.results()["a"][0].outcome is Outcome.SHADOW
