"""Recorded lives of the rig: decided the same again, matched the same again, and the falsified one caught."""

from __future__ import annotations

import itertools
import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as Xml

import cv2
import numpy as np
import pytest
import yaml

from ptzd.app.replaying import replay
from ptzd.calibration.file import read_rig
from ptzd.cli import entry
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.jpeg.pixels import decode_grey
from ptzd.log.reader import LoggedCommand, LoggedEvent, LogReader
from ptzd.log.topics import PTZ_IMAGE
from ptzd.matching.turned import compare
from ptzd.model import Turn

HERE = Path(__file__).parent
MUST_FAIL = "tampered"
OUTCOMES = {
    "lock": {"target": "locked"},
    "refusal": {},
    "preemption": {"slow": "preempted", "urgent": "locked"},
    "device_loss": {"interrupted": "device_lost"},
    "update": {"moving": "locked"},
    "lease": {"interrupted": "preempted", "waits": "locked"},
    "hand": {"waits": "locked"},
    "zones": {"around": "locked", "behind": "unreachable"},
    "patrol": {"between": "locked"},
}


@pytest.fixture(autouse=True)
def one_thread():
    """The replay sets it; other tests are not to notice."""
    threads = cv2.getNumThreads()
    yield
    cv2.setNumThreads(threads)


def golden(name: str) -> Path:
    return HERE / f"{name}.mcap"


def decisions(name: str) -> list:
    with LogReader(golden(name)) as reader:
        return list(reader.decisions())


def settings(name: str, folder: Path, **changes: dict[str, object]) -> Path:
    """The recorded settings with others in their place."""
    with LogReader(golden(name)) as reader:
        document = yaml.safe_load(reader.run.config_text)
    for part, values in changes.items():
        document[part].update(values)
    path = folder / "other.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


def test_they_are_small_and_name_no_machine() -> None:
    files = sorted(HERE.glob("*.mcap"))
    assert [path.stem for path in files] == sorted([*OUTCOMES, MUST_FAIL])
    assert max(path.stat().st_size for path in files) <= 2_000_000
    assert sum(path.stat().st_size for path in files) <= 8_000_000
    for path in files:
        with LogReader(path) as reader:
            config = yaml.safe_load(reader.run.config_text)
        assert not Path(config["calibration"]).is_absolute()
        assert not Path(config["log"]["directory"]).is_absolute()


@pytest.mark.parametrize("name", OUTCOMES)
def test_the_same_is_decided_twice_in_a_row(name: str) -> None:
    once, again = replay(golden(name)), replay(golden(name))
    assert once.differences == again.differences == []
    assert once.replayed == again.replayed == once.recorded
    assert {request: result.outcome for request, result in once.replayed.items()} == OUTCOMES[name]
    assert once.events > 20
    assert once.commands > 5


@pytest.mark.parametrize("name", OUTCOMES)
def test_the_same_is_matched_again(name: str) -> None:
    found = replay(golden(name), recompute=True)
    assert found.differences == []
    answered = [logged for logged in decisions(name) if isinstance(getattr(logged, "event", None), ev.MatchFinished)]
    assert found.matches == len(answered), "one that was under way at the end has no answer"
    assert (found.matches > 0) == bool(OUTCOMES[name])


def test_they_hold_what_they_are_for() -> None:
    refused = [c.command for c in decisions("refusal") if isinstance(c, LoggedCommand)]
    assert {c.code for c in refused if isinstance(c, cmd.ReplyRefused)} == {"outside", "invalid", "stale_frame"}
    updated = [e.event for e in decisions("update") if not isinstance(e, LoggedCommand)]
    assert any(isinstance(event, ev.UpdateReceived) for event in updated)
    lost = [e.event for e in decisions("device_loss") if not isinstance(e, LoggedCommand)]
    assert any(isinstance(event, ev.DeviceLost) for event in lost)
    zones = [c.command for c in decisions("zones") if isinstance(c, LoggedCommand)]
    (refused_move,) = [told for told in zones if isinstance(told, cmd.RefuseMove)]
    assert refused_move.reason.startswith("no way leads around the no_go zones")
    assert [told.code for told in zones if isinstance(told, cmd.ReplyRefused)] == ["zone"]
    grab = next(index for index, told in enumerate(zones) if isinstance(told, cmd.GrabView))
    assert sum(isinstance(told, cmd.MoveHead) for told in zones[:grab]) > 1, "the first way has more than one leg"


def test_the_patrol_goes_back_to_where_a_request_found_it() -> None:
    shown = [
        (c.command.patrol.place, c.command.patrol.phase)
        for c in decisions("patrol")
        if isinstance(c, LoggedCommand) and isinstance(c.command, cmd.PublishStatus) and c.command.patrol is not None
    ]
    told = [step for number, step in enumerate(shown) if number == 0 or shown[number - 1] != step]
    assert told[:6] == [
        ("left", "on the way"), ("left", "there"), ("left", "waiting"),
        ("left", "on the way"), ("left", "there"), ("right", "on the way"),
    ]  # fmt: skip
    assert ("right", "paused") in told
    refused = [c.command for c in decisions("patrol") if isinstance(c, LoggedCommand)]
    assert [c.code for c in refused if isinstance(c, cmd.ReplyRefused)] == ["unreachable"]


def test_the_falsified_one_fails_at_its_place(capsys) -> None:
    (sequence,) = {
        true.sequence
        for true, false in zip(decisions("lock"), decisions(MUST_FAIL), strict=True)
        if isinstance(true, LoggedCommand) and true.command != false.command
    }
    (found,) = replay(golden(MUST_FAIL)).differences
    assert (found.sequence, found.request, found.path) == (sequence, "target", "MoveHead.target.pan_deg")
    assert not found.parts
    assert entry(["replay", "--recompute", str(golden(MUST_FAIL))]) == 1
    assert f"event {sequence} (RequestReceived): MoveHead.target.pan_deg" in capsys.readouterr().out


@pytest.mark.parametrize("recompute", [(), ("--recompute",)])
def test_on_another_cpu_within_the_tolerance(recompute: tuple[str, ...], tmp_path: Path) -> None:
    """The libraries are told to use the code for older ones."""
    for name in OUTCOMES:
        (tmp_path / f"{name}.mcap").symlink_to(golden(name))
    simd = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    other = {
        "OPENCV_CPU_DISABLE": "AVX2,AVX512-SKX,AVX,FP16",
        "OPENBLAS_CORETYPE": "Nehalem",
        "NPY_DISABLE_CPU_FEATURES": " ".join(simd),
    }
    done = subprocess.run(
        [sys.executable, "-m", "ptzd", "replay", str(tmp_path), *recompute, "--json"],
        env={**os.environ, **other},
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done
    reports = {Path(report["file"]).stem: report for report in json.loads(done.stdout)}
    assert reports.keys() == OUTCOMES.keys()
    for name, report in reports.items():
        assert report["differences"] == []
        assert report["requests"] == report["replayed"] == OUTCOMES[name]
        assert "within" in report["regime"]
        assert "dispatch" in report["regime"]
        assert (report["matches"] > 0) == (bool(recompute) and bool(OUTCOMES[name]))


def test_other_settings_part_once_and_the_rest_is_no_noise(tmp_path: Path, capsys) -> None:
    other = settings("lock", tmp_path, search={"accept_probability": 1.0, "certain_probability": 1.0, "max_rounds": 1})
    assert entry(["replay", str(golden("lock")), "--config", str(other)]) == 1
    said = capsys.readouterr().out
    found = replay(golden("lock"), config_path=other).differences
    assert [(difference.event, difference.parts) for difference in found][-1] == ("MatchFinished", True)
    assert len(found) <= 2
    assert "target: locked, replayed" in said
    assert len(said.splitlines()) <= 6


def test_settings_that_change_nothing_differ_nowhere(tmp_path: Path) -> None:
    assert replay(golden("lock"), config_path=settings("lock", tmp_path, bus={"prefix": "other"})).same


def test_another_calibration_moves_the_head_elsewhere(tmp_path: Path) -> None:
    with LogReader(golden("lock")) as reader:
        document = yaml.safe_load(reader.run.calibration_text)
    document["head"]["pan"]["offset_deg"] += 0.5
    path = tmp_path / "rig.yaml"
    path.write_text(yaml.safe_dump(document))
    found = replay(golden("lock"), calibration_path=path)
    first = found.differences[0]
    assert first.path == "MoveHead.target.pan_deg"
    assert abs(float(first.replayed) - float(first.recorded)) == pytest.approx(0.5, abs=0.01)
    assert str(path) in found.regime


def test_a_folder_is_a_test_suite(tmp_path: Path, capsys) -> None:
    for name in ("lock", MUST_FAIL):
        (tmp_path / f"{name}.mcap").write_bytes(golden(name).read_bytes())
    (tmp_path / "torn.mcap").write_bytes(golden("lock").read_bytes()[:200_000])
    report = tmp_path / "report.xml"
    assert entry(["replay", str(tmp_path), "--junit", str(report)]) == 65
    assert "torn at byte" in capsys.readouterr().out
    suites = {suite.get("name"): suite for suite in Xml.parse(report).getroot()}
    told = {name: (suite.get("tests"), suite.get("failures"), suite.get("errors")) for name, suite in suites.items()}
    assert told == {
        "lock.mcap": ("2", "0", "0"),
        "tampered.mcap": ("2", "1", "0"),
        "torn.mcap": ("1", "0", "1"),
    }
    assert "MoveHead.target.pan_deg" in suites["tampered.mcap"].find("testcase/failure").text


@pytest.mark.parametrize("name", sorted(OUTCOMES))
def test_no_head_is_doubted_that_did_as_told(name: str) -> None:
    """Each view of a recorded life held against the one before it."""
    with LogReader(golden(name)) as reader:
        rig = read_rig(reader.run.calibration_text, name)
        events = [told.event for told in reader.decisions() if isinstance(told, LoggedEvent)]
        views = [event.view for event in events if isinstance(event, ev.ViewTaken)]
        pictures = [decode_grey(reader.picture(PTZ_IMAGE, view.frame)) for view in views]
    pairs = itertools.pairwise(zip(pictures, views, strict=True))
    found = [compare(rig, before, at.reading, after, then.reading).verdict for (before, at), (after, then) in pairs]
    assert set(found) <= {Turn.AGREES, Turn.UNKNOWN}
