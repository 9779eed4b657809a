"""What a replay found, told to a person, a program and a test runner; other decisions do not spoil the next request."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as Xml

import msgspec
import pytest
import yaml

from ptzd.app.replaying import replay, time_span_ns
from ptzd.cli import entry
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import LogError
from ptzd.log.reader import LogReader
from ptzd.replay.compare import ACROSS_MACHINES, EXACT, ROUNDING, Difference, differences, kind, named_path
from ptzd.replay.drive import Player, Replay
from ptzd.replay.report import RIG, Report, document, junit, lines, stories


@pytest.fixture
def stricter(config, tmp_path: Path) -> Path:
    """Settings under which no match is ever believed."""
    other = msgspec.to_builtins(config)
    other["search"].update(accept_probability=1.0, certain_probability=1.0)
    path = tmp_path / "stricter.yaml"
    path.write_text(yaml.safe_dump(other))
    return path


async def test_each_request_parts_by_itself_and_no_other_suffers(record, stricter) -> None:
    found = replay(await record(), config_path=stricter)
    parted = {one.request: one.event for one in found.differences if one.parts}
    assert parted.keys() >= {"first", "slow"}
    assert parted["first"] == parted["slow"] == "MatchFinished"
    assert len(found.differences) <= 2 * len(found.recorded)
    assert {name: result.outcome for name, result in found.recorded.items()} == {
        "first": "locked",
        "slow": "preempted",
        "urgent": "device_lost",
    }


async def test_new_matches_that_part_a_request_leave_the_next_one_comparable(record, rig, config, steps) -> None:
    """The first request is said to see nothing; the second, pre-empted in its lock, is decided as it was."""
    recorded = {event.match_id: event.result for _, event, _ in steps if isinstance(event, ev.MatchFinished)}

    def forgetful(job, fisheye, view):
        result = recorded[job.match_id]
        return replace(result, candidates=()) if job.request_id == "first" else result

    with LogReader(await record()) as reader:
        found = Player(reader=reader, rig=rig, config=config, recorded=(rig, config), matcher=forgetful).run()
    assert {one.request for one in found.differences} == {"first"}
    assert [one.parts for one in found.differences] == [False, True]
    told = {story.name: str(story) for story in stories(found)}
    assert told["slow"] == "slow: preempted"
    assert told["first"] in {
        "first: locked, replayed not_found",
        "first: locked, replayed otherwise; to what end, the recording cannot tell",
    }


async def test_a_picture_that_is_missing_is_told_and_the_recorded_match_taken(record, rig, config) -> None:
    log = await record()

    class Blind(LogReader):
        def picture(self, topic, frame):
            raise LogError(f"{self.path}: {topic} has no picture {frame.seq}")

    with Blind(log) as reader:
        found = Player(reader=reader, rig=rig, config=config, recorded=(rig, config), matcher=pytest.fail).run()
    assert {one.request for one in found.differences} == {"first", "slow"}
    assert all("has no picture" in one.replayed and not one.parts for one in found.differences)
    assert found.replayed == found.recorded


async def test_a_foreign_machine_is_named_with_what_may_differ(record) -> None:
    log = await record(foreign=True)
    assert "the machine that recorded differs in" in replay(log).regime
    assert "same fingerprint" in replay(await record(folder="own")).regime


async def test_a_last_bit_of_another_machine_is_no_difference(record, steps) -> None:
    def nudged(steps):
        return [
            (
                t_ns,
                event,
                [
                    replace(one, target=replace(one.target, pan_deg=one.target.pan_deg + 1e-13))
                    if isinstance(one, cmd.MoveHead)
                    else one
                    for one in commands
                ],
            )
            for t_ns, event, commands in steps
        ]

    assert replay(await record(nudged, foreign=True)).same
    assert not replay(await record(nudged, folder="own")).same


@pytest.mark.parametrize(
    ("name", "one", "other", "same"),
    [
        ("x.pan_rad", 2.0, 2.0 + 1.7e-5, True),
        ("x.pan_rad", 2.0, 2.0 + 1.8e-5, False),
        ("x.pan_deg", 90.0, 90.0009, True),
        ("x.pan_deg", 90.0, 90.0011, False),
        ("x.box_px[2][1]", 300.0, 300.29, True),
        ("x.box_px[2][1]", 300.0, 300.31, False),
        ("x.score", 0.0, 4.9e-4, True),
        ("x.score", float("nan"), float("nan"), True),
        ("x.score", float("nan"), 0.0, False),
    ],
)
def test_angles_and_other_values_have_limits_of_their_own(name: str, one: float, other: float, same: bool) -> None:
    assert (differences(name, one, other, ACROSS_MACHINES) == []) == same
    if not math.isnan(one) and one != other:
        assert differences(name, one, other, ROUNDING)
        assert differences(name, one, other, EXACT)


def test_kinds_are_what_the_world_would_answer_otherwise() -> None:
    step = cmd.PublishFeedback(id="a", step="view", detail={"score": 0.1})
    assert kind(step) == kind(replace(step, detail={"score": 0.2})) == "PublishFeedback a view"
    assert kind(replace(step, step="found")) != kind(step)
    assert kind(None) == "nothing"
    assert kind(cmd.StopHead()) == "StopHead"


PARTED = Difference(sequence=9, event="MatchFinished", request="a", path="x", recorded="b", replayed="c", parts=True)
OUTSIDE = Difference(sequence=3, event="DeadlinePassed", request="", path="MoveHead", recorded="b", replayed="c")


def found(*differences: Difference) -> Report:
    return Report(path=Path("n.mcap"), replay=Replay(regime="exactly", events=4, differences=list(differences)))


def test_what_a_person_reads() -> None:
    said = list(lines(found(PARTED, OUTSIDE)))
    assert said[0] == "n.mcap: differences: 2, in 2 of 2 requests: 4 events, 0 commands"
    assert "  a: not ended in this file, replayed" not in said
    assert "    event 9 (MatchFinished): recorded b, replayed c" in said
    assert "    event 3 (DeadlinePassed): MoveHead: recorded b, replayed c" in said
    assert sum("no longer fits" in line for line in said) == 1
    assert "no difference" in next(lines(found()))
    assert list(lines(Report(path=Path("n.mcap"), error="n.mcap: torn"))) == ["n.mcap: torn"]


def test_what_a_program_reads() -> None:
    told = json.loads(json.dumps(document(found(PARTED))))
    assert told["same"] is False
    assert told["differences"][0]["sequence"] == 9
    assert told["differences"][0]["parts"] is True
    assert document(Report(path=Path("n"), error="torn")) == {"file": "n", "same": False, "error": "torn"}


def test_what_a_test_runner_reads() -> None:
    reports = [found(PARTED, OUTSIDE), Report(path=Path("t.mcap"), error="torn <here> & there")]
    one, other = Xml.fromstring(junit(reports))
    assert (one.get("tests"), one.get("failures"), one.get("errors")) == ("2", "2", "0")
    assert {case.get("name") for case in one if case.find("failure") is not None} == {"a", RIG}
    assert (other.get("tests"), other.get("failures"), other.get("errors")) == ("1", "0", "1")
    assert other.find("testcase/error").get("message") == "torn <here> & there"


async def test_a_report_that_cannot_be_written(record, tmp_path: Path, capsys) -> None:
    log = await record()
    assert entry(["replay", str(log), "--junit", str(tmp_path / "nowhere" / "x.xml")]) == 65
    assert "cannot be written" in capsys.readouterr().err


async def test_the_bar_spans_the_file(record, steps) -> None:
    first, last = time_span_ns(await record())
    assert first <= steps[0][0]
    assert last >= steps[-1][0]


async def test_a_calibration_that_is_not_there(record, tmp_path: Path, capsys) -> None:
    assert entry(["replay", str(await record()), "--calibration", str(tmp_path / "none.yaml")]) == 78
    assert "none.yaml" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("path", "told"),
    [
        ("PublishResult.range_m", "PublishResult.range_baselines"),
        ("PublishFeedback.detail.range_m", "PublishFeedback.detail.range_baselines"),
        ("RequestReceived.range_m[0]", "RequestReceived.range_baselines[0]"),
        ("MoveHead.pan_deg", "MoveHead.pan_deg"),
    ],
)
def test_a_difference_names_ranges_of_a_rig_without_scale_by_their_unit(path, told) -> None:
    assert named_path(path, metric=False) == told
    assert named_path(path, metric=True) == path
