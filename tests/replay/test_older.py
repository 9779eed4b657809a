"""A log of an older version replays: its decisions and settings are led to the present ones in small steps."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ptzd.app.replaying import replay
from ptzd.cli import entry
from ptzd.control.events import Device, DeviceWell
from ptzd.errors import LogError
from ptzd.log import codec, migrations
from ptzd.log.file import McapFile
from ptzd.log.migrations import Step, settings_now, steps_from
from ptzd.log.reader import LogReader
from ptzd.log.topics import COMMAND, EVENT

LOCK = Path(__file__).parents[1] / "golden" / "lock.mcap"


def older(name: str, body: dict) -> tuple[str, dict]:
    """How an older version wrote things: flat poses under another name, a band without its unit, another word in
    the snapshot's state.
    """
    if name == "HeadPolled":
        return "PoseReported", {"t_ns": body["t_ns"], **body["reading"], "motion": body["motion"]}
    if name == "RunMatch":
        return name, {("band" if field == "band_rad" else field): value for field, value in body.items()}
    if name == "Snapshot":
        state = {("waiting" if field == "queue" else field): value for field, value in body["state"].items()}
        return name, {**body, "state": state}
    return name, body


def newer(name: str, body: dict) -> tuple[str, dict]:
    """The step that leads out of that version."""
    if name == "PoseReported":
        reading = {axis: body[axis] for axis in ("pan_deg", "tilt_deg", "zoom")}
        return "HeadPolled", {"t_ns": body["t_ns"], "reading": reading, "motion": body["motion"]}
    if name == "RunMatch":
        return name, {("band_rad" if field == "band" else field): value for field, value in body.items()}
    if name == "Snapshot":
        state = {("queue" if field == "waiting" else field): value for field, value in body["state"].items()}
        return name, {**body, "state": state}
    return name, body


def older_settings(settings: dict) -> dict:
    """It had the search's rounds at the top."""
    search = dict(settings["search"])
    return {**settings, "rounds": search.pop("max_rounds"), "search": search}


def newer_settings(settings: dict) -> dict:
    kept = dict(settings)
    rounds = kept.pop("rounds")
    return {**kept, "search": {**kept["search"], "max_rounds": rounds}}


@pytest.fixture
def old_log(tmp_path: Path) -> Path:
    """The lock as an older version would have written it, pictures and all."""
    path = tmp_path / "old.mcap"
    with LogReader(LOCK) as reader:
        settings = older_settings(yaml.safe_load(reader.run.config_text))
        run = replace(reader.run, schema=1, config_text=yaml.safe_dump(settings))
        file = McapFile(path, run, 0)
        file.open()
        for entry_ in reader.entries():
            data = entry_.data
            if entry_.topic in {EVENT, COMMAND}:
                held = json.loads(data)
                name, body = older(held["name"], json.loads(held["body"]))
                data = json.dumps({**held, "name": name, "body": json.dumps(body)}).encode()
            file.add(entry_.topic, entry_.log_ns, entry_.publish_ns, entry_.sequence, data)
    file.finish()
    return path


@pytest.fixture
def present(monkeypatch: pytest.MonkeyPatch) -> None:
    """One version more lies before the first."""
    follow = {number + 1: step for number, step in migrations.STEPS.items()}
    monkeypatch.setattr(migrations, "SCHEMA_VERSION", migrations.SCHEMA_VERSION + 1)
    monkeypatch.setattr(migrations, "STEPS", {1: Step(decision=newer, settings=newer_settings), **follow})


@pytest.mark.usefixtures("present")
@pytest.mark.parametrize("recompute", [False, True])
def test_an_older_log_replays_as_the_same_one_of_today(old_log: Path, recompute: bool) -> None:
    found, today = replay(old_log, recompute=recompute), replay_today(recompute=recompute)
    assert found.differences == today.differences
    assert {name: result.outcome for name, result in found.recorded.items()} == {"target": "locked"}
    assert (found.events, found.commands, found.matches) == (today.events, today.commands, today.matches)
    assert found.replayed == today.replayed


def replay_today(*, recompute: bool):
    """The same log as it lies there, without that version."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(migrations, "SCHEMA_VERSION", migrations.SCHEMA_VERSION - 1)
        patch.setattr(migrations, "STEPS", {number - 1: step for number, step in migrations.STEPS.items()})
        return replay(LOCK, recompute=recompute)


@pytest.mark.usefixtures("present")
def test_without_its_step_an_older_log_is_refused_by_name(old_log: Path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(migrations, "STEPS", {})
    assert entry(["replay", str(old_log)]) == 65
    (line,) = capsys.readouterr().err.splitlines()
    assert "old.mcap" in line
    assert "no step leads from schema version 1 to 2" in line


def test_read_as_if_it_were_of_today_it_is_refused_by_name(old_log: Path, capsys) -> None:
    assert entry(["replay", str(old_log)]) != 0
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.usefixtures("present")
def test_what_is_not_as_its_version_has_it_is_named() -> None:
    with pytest.raises(LogError, match="PoseReported: not as schema version 1 has it: KeyError 'pan_deg'"):
        codec.decode_event("PoseReported", '{"t_ns": 4}', 1)


@pytest.mark.usefixtures("present")
@pytest.mark.parametrize("version", [0, migrations.SCHEMA_VERSION + 2, -1])
def test_a_version_that_never_was_or_is_to_come_is_refused(version: int) -> None:
    with pytest.raises(LogError, match=f"schema version {version} is not one of 1 to {migrations.SCHEMA_VERSION};"):
        list(steps_from(version))
    with pytest.raises(LogError, match=f"HeadPolled: schema version {version}"):
        codec.decode_event("HeadPolled", "{}", version)


def test_steps_follow_each_other(monkeypatch) -> None:
    monkeypatch.setattr(migrations, "SCHEMA_VERSION", 3)
    steps = {
        1: Step(settings=lambda settings: {**settings, "way": [1]}),
        2: Step(settings=lambda settings: {**settings, "way": [*settings["way"], 2]}),
    }
    monkeypatch.setattr(migrations, "STEPS", steps)
    assert settings_now({}, 1) == {"way": [1, 2]}
    assert settings_now({"way": []}, 2) == {"way": [2]}
    assert settings_now({}, 3) == {}
    assert settings_now(None, 1) is None


def test_when_an_event_was_told_stands_beside_it_since_version_3() -> None:
    assert codec.decode_event("DeviceWell", '{"t_ns": 4, "device": "ptz"}', 2) == DeviceWell(device=Device.PTZ)
    with pytest.raises(LogError, match="unknown field 't_ns'"):
        codec.decode_event("DeviceWell", '{"t_ns": 4, "device": "ptz"}', 3)


def test_a_request_of_version_3_has_its_region_and_that_of_its_update() -> None:
    box, frame = {"x": 1.0, "y": 2.0, "w": 30.0, "h": 40.0}, {"seq": 4, "t_capture_ns": 5}
    served = {"id": "a", "box": box, "frame": frame, "newer_box": {**box, "x": 7.0}, "newer_frame": {**frame, "seq": 9}}
    waits = {"id": "b", "box": box, "frame": frame, "newer_box": None, "newer_frame": None}
    claims = [{"activity": {"activity": "scan", "task": {"request": waits}}}, {"activity": {"activity": "home"}}]
    state = {"holder": {"activity": {"activity": "lock", "task": {"request": served}}}, "claims": claims}
    read = codec.decode_event("Snapshot", json.dumps({"state": state}), 3).state
    first = read["holder"]["activity"]["task"]["request"]
    assert first == {
        "id": "a",
        "region": {"box": box, "frame": frame},
        "newer": {"box": {**box, "x": 7.0}, "frame": {**frame, "seq": 9}},
    }
    assert read["claims"][0]["activity"]["task"]["request"]["newer"] is None
    assert read["claims"][1] == claims[1]


def test_every_version_up_to_this_one_has_its_step() -> None:
    assert set(migrations.STEPS) == set(range(1, migrations.SCHEMA_VERSION))
