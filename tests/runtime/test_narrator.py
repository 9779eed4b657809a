from __future__ import annotations

import dataclasses
import logging

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import Box, FrameRef, GotoShown, HeadReading, Outcome, PatrolShown
from ptzd.runtime.narrator import Narrator


@pytest.fixture
def lines(caplog: pytest.LogCaptureFixture):
    caplog.set_level(logging.DEBUG, logger="ptzd")
    narrator = Narrator()

    def tell(event: ev.Event, *commands: cmd.Command, t_ns: int = 1) -> list[tuple[int, str]]:
        caplog.clear()
        narrator.seen(t_ns, event, list(commands))
        return [(record.levelno, record.getMessage()) for record in caplog.records]

    return tell


QUIET = ev.HeadStopped()


def test_a_loss_is_an_error_and_a_recovery_is_news(lines) -> None:
    assert lines(ev.DeviceLost(device=ev.Device.PTZ, reason="no answer")) == [(logging.ERROR, "ptz lost: no answer")]
    assert lines(ev.DeviceWell(device=ev.Device.PTZ)) == [(logging.INFO, "ptz is well")]


def test_a_failed_match_is_a_warning_with_its_reason(lines) -> None:
    failed = ev.MatchFailed(match_id=4, reason="sweep failed on box 1,2,30,40")
    assert lines(failed) == [(logging.WARNING, "match 4 failed: sweep failed on box 1,2,30,40")]


def test_foreign_motion_is_a_warning(lines) -> None:
    reading = HeadReading(pan_deg=0, tilt_deg=0, zoom=1)
    assert lines(ev.ForeignMotion(reading=reading)) == [(logging.WARNING, "somebody else moves the camera")]


def test_a_foreign_motion_that_goes_on_is_told_once_and_the_next_one_again(lines) -> None:
    def moved(t_s: float) -> list[tuple[int, str]]:
        reading = HeadReading(pan_deg=t_s, tilt_deg=0, zoom=1)
        return lines(ev.ForeignMotion(reading=reading), t_ns=round(t_s * 1e9))

    assert [len(moved(k / 10)) for k in range(600)] == [1] + [0] * 599
    assert len(moved(59.9 + 4.9)) == 0
    assert len(moved(59.9 + 4.9 + 5.1)) == 1


def test_a_place_is_told_when_it_is_asked_for_and_when_the_head_is_there(lines) -> None:
    def status(goto: GotoShown | None) -> list[str]:
        told = cmd.PublishStatus(
            state="GOTO", active=None, phase="", queue=(), fisheye="well", ptz="well", held=False, goto=goto
        )
        return [text for level, text in lines(QUIET, told) if level == logging.INFO]

    way = GotoShown(place="gate", by="desk", since_ns=10)
    there = GotoShown(place="gate", by="desk", since_ns=10, there_ns=1_500_000_010, until_ns=9_000_000_000)
    assert status(way) == ["the head is sent to gate by desk"]
    assert status(way) == []
    assert status(there) == ["the head is at gate after 1.5 s"]
    assert status(there) == []
    assert status(None) == []


def test_a_patrol_is_told_when_it_begins_rests_goes_on_ends_and_misses_a_place(lines) -> None:
    def status(patrol: PatrolShown | None) -> list[str]:
        told = cmd.PublishStatus(
            state="PATROL", active=None, phase="", queue=(), fisheye="well", ptz="well", held=False, patrol=patrol
        )
        return [text for level, text in lines(QUIET, told) if level >= logging.INFO]

    there = PatrolShown(patrol="night", place="gate", phase="there", since_ns=10)
    assert status(there) == ["patrol night begins"]
    assert status(dataclasses.replace(there, place="yard", phase="on the way")) == []
    paused = dataclasses.replace(there, phase="paused", paused="somebody paused it")
    assert status(paused) == ["patrol night is paused: somebody paused it"]
    assert status(there) == ["patrol night goes on at gate"]
    missed = dataclasses.replace(there, trouble="the head did not get to yard: blocked")
    assert status(missed) == ["patrol night: the head did not get to yard: blocked"]
    assert status(missed) == []
    other = PatrolShown(patrol="day", place="gate", phase="there", since_ns=20, scheduled=True)
    assert status(other) == ["patrol day begins, by the schedule"]
    assert status(None) == ["patrol day is over"]


def test_positions_and_frames_are_no_news(lines) -> None:
    assert lines(QUIET) == []
    assert lines(ev.FrameArrived(frame=FrameRef(seq=1, t_capture_ns=1))) == []


@pytest.mark.parametrize(("outcome", "level"), [(Outcome.LOCKED, logging.INFO), (Outcome.LOST, logging.WARNING)])
def test_a_result_is_told_with_its_request(lines, caplog, outcome: Outcome, level: int) -> None:
    result = cmd.PublishResult(id="gate-3", outcome=outcome, reason="so it is", label="", elapsed_ms=1500, views=2)
    assert lines(QUIET, result) == [(level, f"request gate-3: {outcome} after 1.5 s: so it is")]
    assert caplog.records[0].request == "gate-3"


def test_a_state_is_told_when_it_changes(lines) -> None:
    def status(state: str) -> cmd.PublishStatus:
        return cmd.PublishStatus(state=state, active=None, phase="", queue=(), fisheye="", ptz="", held=False)

    assert [text for _, text in lines(QUIET, status("IDLE"))] == ["– → IDLE"]
    assert lines(QUIET, status("IDLE")) == []
    assert lines(QUIET, status("FAULT")) == [(logging.ERROR, "IDLE → FAULT")]


def test_a_stop_that_a_lost_camera_leaves_unconfirmed_is_told_in_the_middle_of_a_flood(lines) -> None:
    for k in range(1000):
        lines(REFUSED_PUT, t_ns=k)
    unconfirmed = cmd.ReplyRefused(
        token=4, code="device_lost", message="the stop is not confirmed: no answer", field="$"
    )
    shown = lines(ev.DeviceLost(device=ev.Device.PTZ, reason="no answer"), unconfirmed, t_ns=1000)
    assert (logging.WARNING, "refused: $: the stop is not confirmed: no answer (device_lost)") in shown


@pytest.mark.parametrize("outcome", [Outcome.REJECTED, Outcome.STALE_FRAME])
def test_refused_puts_that_name_an_id_are_told_once_each_and_a_flood_of_them_counted(lines, outcome: Outcome) -> None:
    """Their results go out, one for each id, but the journal keeps to its few lines."""

    def put(k: int) -> list[tuple[int, str]]:
        result = cmd.PublishResult(
            id=f"junk-{k}", outcome=outcome, reason="$.box: nowhere", label="", elapsed_ms=0, views=0
        )
        event = ev.PayloadRefused(token=None, code="invalid", message="nowhere", field="$.box", id=f"junk-{k}")
        return lines(event, result, t_ns=k)

    shown = [put(k) for k in range(1000)]
    assert shown[0] == [(logging.WARNING, f"refused: junk-0: $.box: nowhere ({outcome})")]
    assert sum(map(len, shown)) == 10


REFUSED_PUT = ev.PayloadRefused(token=None, code="not_json", message="no JSON", field="$")


def test_a_put_that_is_no_message_gets_a_line_and_a_flood_of_them_a_few_and_a_count(lines) -> None:
    shown = [lines(REFUSED_PUT, t_ns=k) for k in range(1000)]
    assert shown[0] == [(logging.WARNING, "refused: $: no JSON (not_json)")]
    assert sum(map(len, shown)) == 10
    later = 11_000_000_000
    assert lines(ev.HeadStopped(), t_ns=later) == [(logging.WARNING, "refused: 990 more within 11 s, not shown")]
    assert lines(ev.HeadStopped(), t_ns=later + 1) == []
    assert len(lines(REFUSED_PUT, t_ns=later + 2)) == 1


def test_a_query_s_refusal_is_told_once(lines) -> None:
    event = ev.PayloadRefused(token=4, code="not_json", message="no JSON", field="$")
    assert lines(event, cmd.ReplyRefused(token=4, code="not_json", message="no JSON", field="$")) == [
        (logging.WARNING, "refused: $: no JSON (not_json)")
    ]


@pytest.mark.parametrize("event", [ev.CancelReceived(token=None, id="a")])
def test_what_a_put_could_not_do_gets_a_line(lines, event) -> None:
    note = cmd.PublishFeedback(id="a", step="note", detail={"text": "cancel refused: $.id: no request a"})
    assert lines(event, note) == [(logging.WARNING, "refused: $: a: cancel refused: $.id: no request a (put)")]


def test_what_is_taken_back_of_the_learned_ranges_is_told_and_a_question_is_not(lines) -> None:
    def told(**forget: object) -> list[str]:
        return [text for _, text in lines(ev.RangesAsked(token=None, **forget))]

    begins = "asked to forget the ranges that locks have taught: "
    assert told() == []
    assert told(forget_last=3) == [f"{begins}those of the last 3 lock(s)"]
    assert told(forget_all=True) == [f"{begins}all"]
    box = Box(x=1, y=2.5, w=30, h=40)
    assert told(forget_box=box) == [f"{begins}those in 1,2.5,30,40 px of the fisheye's picture"]
