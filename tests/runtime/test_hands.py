from __future__ import annotations

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import DeviceLost, PtzdError
from ptzd.model import Box, HeadReading, Matcher, ViewRef
from ptzd.ports import MoveStalled, MoveSuperseded
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.hands import Hands

TARGET = HeadReading(pan_deg=10.0, tilt_deg=2.0, zoom=5.0)
MOVE = cmd.MoveHead(move_id=4, target=TARGET)
GRAB = cmd.GrabView(grab_id=5, not_before_ns=0)


@pytest.fixture
def told() -> list[ev.Event]:
    return []


@pytest.fixture
def lost() -> list[Exception]:
    return []


@pytest.fixture
async def hands(head, perception, log, told, lost):
    made = Hands(
        tell=told.append, lost=lost.append, head=head, perception=perception,
        frames=FrameStore(4), log=log,
    )  # fmt: skip
    yield made
    await made.close()


async def test_a_move_that_arrives(hands, told, settled) -> None:
    hands.perform(MOVE)
    await settled()
    assert told == [ev.HeadArrived(move_id=4, reading=TARGET)]


async def test_a_move_that_stalls_says_where(hands, head, told, settled) -> None:
    head.error = MoveStalled(TARGET, "blocked")
    hands.perform(MOVE)
    await settled()
    assert told == [ev.HeadStalled(move_id=4, reading=TARGET, reason="blocked")]


async def test_a_superseded_move_says_nothing(hands, head, told, settled) -> None:
    head.error = MoveSuperseded()
    hands.perform(MOVE)
    await settled()
    assert told == []


@pytest.mark.parametrize("command", [MOVE, GRAB, cmd.StopHead()])
async def test_a_lost_camera_is_told_to_whoever_watches_it(hands, head, told, lost, settled, command) -> None:
    head.refuse = DeviceLost("unplugged")
    hands.perform(command)
    await settled()
    assert lost == [head.refuse]
    assert told == []


async def test_a_newer_move_takes_the_place_of_the_older(hands, head, told, settled) -> None:
    head.gate.clear()
    hands.perform(MOVE)
    await settled()
    hands.perform(cmd.MoveHead(move_id=6, target=TARGET))
    head.gate.set()
    await settled()
    assert told == [ev.HeadArrived(move_id=6, reading=TARGET)]


async def test_a_stop_ends_the_move_under_way(hands, head, told, settled) -> None:
    head.gate.clear()
    hands.perform(MOVE)
    await settled()
    hands.perform(cmd.StopHead())
    head.gate.set()
    await settled()
    assert head.calls == ["move", "stop"]
    assert told == [ev.HeadStopped()]


async def test_a_grabbed_picture_is_kept_logged_and_told(hands, head, log, told, picture, settled) -> None:
    head.picture = picture(3)
    hands.perform(GRAB)
    await settled()
    assert log.pictures == [("/ptz/image", head.picture)]
    assert hands._frames.view(head.picture.frame) is head.picture
    (taken,) = told
    assert (taken.grab_id, taken.view.frame) == (5, head.picture.frame)


def job(frame, view_frame) -> cmd.RunMatch:
    view = ViewRef(frame=view_frame, reading=TARGET, sigma_deg=0.01)
    return cmd.RunMatch(
        match_id=8, request_id="a", frame=frame, box=Box(x=1, y=1, w=20, h=20), view=view, inverse_range=(0.0, 1.0),
        band_rad=0.01, matcher=Matcher.SWEEP, seed=1,
    )  # fmt: skip


async def test_a_match_gets_the_bytes_of_frame_and_view(hands, perception, told, picture, settled) -> None:
    fisheye, view = picture(1), picture(2)
    hands._frames.add(fisheye)
    hands._frames.add_view(view)
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    assert perception.jobs == [(fisheye.jpeg, view.jpeg)]
    assert [(type(event), event.match_id) for event in told] == [(ev.MatchFinished, 8)]


async def test_a_match_without_its_pictures_fails_by_name(hands, told, picture, settled) -> None:
    fisheye, view = picture(1), picture(2)
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    hands._frames.add(fisheye)
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    assert [event.reason for event in told] == ["the fisheye frame is gone", "the view is gone"]


async def test_a_picture_that_does_not_decode_fails_its_match_only(hands, perception, told, picture, settled) -> None:
    fisheye, view = picture(1), picture(2)
    hands._frames.add(fisheye)
    hands._frames.add_view(view)
    perception.error = PtzdError("the view is no JPEG")
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    assert told == [ev.MatchFailed(match_id=8, reason="the view is no JPEG")]
    assert not hands.defect.done()


async def test_abandoned_matches_say_nothing(hands, perception, told, picture, settled) -> None:
    fisheye, view = picture(1), picture(2)
    hands._frames.add(fisheye)
    hands._frames.add_view(view)
    perception.gate.clear()
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    hands.perform(cmd.AbandonMatches())
    perception.gate.set()
    await settled()
    assert told == []


async def test_a_defect_is_not_swallowed(hands, perception, picture, settled) -> None:
    fisheye, view = picture(1), picture(2)
    hands._frames.add(fisheye)
    hands._frames.add_view(view)
    perception.error = ZeroDivisionError("somebody divided")
    hands.perform(job(fisheye.frame, view.frame))
    await settled()
    with pytest.raises(ZeroDivisionError):
        hands.defect.result()


async def test_what_is_not_for_hands_is_refused(hands) -> None:
    with pytest.raises(TypeError, match="Finished"):
        hands.perform(cmd.Finished())
