"""A log told per request, for people and for programs."""

import dataclasses
import json

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import LogError
from ptzd.evidence.info import describe, document, lines
from ptzd.evidence.story import collect
from ptzd.log.file import McapFile
from ptzd.log.reader import LoggedCommand, LoggedEvent, LogReader
from ptzd.log.times import clock_time
from ptzd.model import Box, Outcome


def test_a_request_has_its_timeline_and_its_end(lock_log):
    summary = describe(lock_log)
    story, refused = summary.stories
    assert (story.id, story.outcome, story.reason) == ("gate-1", "locked", "held as asked")
    assert [step.what for step in story.steps] == ["request", "plan", "match", "update", "cancel", "result"]
    assert [step.sequence for step in story.steps] == [2, 2, 5, 6, 7, 7]
    assert story.found is story.looks[0]
    assert story.frame.seq == 11
    assert (refused.outcome, refused.reason) == ("refused", "the queue is full")
    assert summary.counts["/event"] == 8
    assert summary.warnings == ("3 pictures dropped",)
    assert summary.torn == ""
    assert summary.span_s == pytest.approx(2.03)


def test_the_text_names_everything(lock_log):
    text = "\n".join(lines(describe(lock_log)))
    for words in (
        "rig yard",
        "2026-11-18 11:06:39.970Z",
        "gate-1",
        "locked: held as asked",
        "0.000 s",
        "#7",
        "dropped",
    ):
        assert words in text


def test_the_document_is_json(lock_log):
    told = json.loads(json.dumps(document(describe(lock_log)), allow_nan=False))
    assert [request["outcome"] for request in told["requests"]] == ["locked", "refused"]
    assert told["rig"] == "yard"


def test_a_torn_file_tells_what_it_can(lock_log):
    lock_log.write_bytes(lock_log.read_bytes()[:-40])
    summary = describe(lock_log)
    assert "torn at byte" in summary.torn
    assert len(summary.stories) == 2
    assert any(line.startswith("not whole") for line in lines(summary))


def test_many_warnings_are_cut_short(lock_log):
    summary = dataclasses.replace(describe(lock_log), warnings=("no room",) * 50)
    assert sum("no room" in line for line in lines(summary)) == 20
    assert any("30 warnings more" in line for line in lines(summary))


def test_a_log_message_of_another_shape_is_refused(tmp_path, run):
    file = McapFile(tmp_path / "odd.mcap", run, 5)
    file.open()
    file.add("/log", 5, 5, 0, b'{"level": "loud"}')
    file.finish()
    with pytest.raises(LogError, match="/log"):
        describe(file.path)


BOX = Box(x=1.0, y=2.0, w=10.0, h=10.0)


def asked(sequence, name="a", token=None):
    return LoggedEvent(sequence=sequence, t_ns=sequence, event=ev.RequestReceived(token=token, id=name, box=BOX))


def ended(sequence, name="a"):
    result = cmd.PublishResult(id=name, outcome=Outcome.CANCELLED, reason="", label="", elapsed_ms=0, views=0)
    return LoggedCommand(sequence=sequence, t_ns=sequence, command=result)


def test_the_same_id_again_while_it_runs_is_one_story_and_after_its_end_another():
    assert [story.outcome for story in collect([asked(1), asked(2), ended(3)])] == ["cancelled"]
    assert [story.outcome for story in collect([asked(1), ended(2), asked(3), ended(4)])] == ["cancelled"] * 2


def test_a_request_of_an_older_file_still_has_its_end():
    (story,) = collect([ended(5)])
    assert (story.request, story.box, story.outcome, story.label) == (None, None, "cancelled", "")


def test_a_request_without_an_end_is_open():
    (story,) = collect([asked(1)])
    assert (story.outcome, story.reason, story.found) == ("open", "", None)


def test_times_of_day():
    assert clock_time(1_795_000_000_123_456_789) == "2026-11-18 11:06:40.123Z"
    assert clock_time(-5) == "-5 ns"
    assert clock_time(1 << 80) == f"{1 << 80} ns"


def test_the_reader_and_the_summary_agree(lock_log):
    with LogReader(lock_log) as log:
        assert len(collect(log.decisions())) == len(describe(lock_log).stories)
