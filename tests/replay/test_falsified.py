"""Logs of lives in virtual time, written as the daemon writes them: a true one replays, a falsified one is caught."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
import yaml

from ptzd.cli import entry
from ptzd.control import commands as cmd
from ptzd.control import events as ev

Step = tuple[int, ev.Event, list[cmd.Command]]


def first(steps: list[Step], kind: type[cmd.Command]) -> tuple[int, int]:
    """Where the first command of a kind stands."""
    return next(
        (number, index)
        for number, (_, _, commands) in enumerate(steps)
        for index, command in enumerate(commands)
        if isinstance(command, kind)
    )


def changed(kind: type[cmd.Command], **fields: object) -> Callable[[list[Step]], list[Step]]:
    """Falsify: the first command of a kind was another."""

    def falsify(steps: list[Step]) -> list[Step]:
        number, index = first(steps, kind)
        t_ns, event, commands = steps[number]
        commands = [*commands[:index], replace(commands[index], **fields), *commands[index + 1 :]]
        return [*steps[:number], (t_ns, event, commands), *steps[number + 1 :]]

    return falsify


def without_command(steps: list[Step]) -> list[Step]:
    number, index = first(steps, cmd.MoveHead)
    t_ns, event, commands = steps[number]
    return [*steps[:number], (t_ns, event, commands[:index] + commands[index + 1 :]), *steps[number + 1 :]]


def without_event(steps: list[Step]) -> list[Step]:
    number = next(n for n, (_, event, _) in enumerate(steps) if isinstance(event, ev.HeadArrived))
    return steps[:number] + steps[number + 1 :]


def other_match(steps: list[Step]) -> list[Step]:
    """The matcher is said to have found something else than what the decisions rest on."""
    number = next(n for n, (_, event, _) in enumerate(steps) if isinstance(event, ev.MatchFinished))
    t_ns, event, commands = steps[number]
    return [
        *steps[:number],
        (t_ns, replace(event, result=replace(event.result, candidates=())), commands),
        *steps[number + 1 :],
    ]


ENDS = {"first": "locked", "slow": "preempted", "urgent": "device_lost"}


async def test_a_true_log_has_no_difference(record, steps, capsys) -> None:
    assert entry(["replay", str(await record()), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["same"]
    assert report["differences"] == []
    assert report["events"] == len(steps)
    assert report["commands"] == sum(len(commands) for _, _, commands in steps)


@pytest.mark.parametrize(
    ("falsify", "told"),
    [
        (changed(cmd.MoveHead, move_id=99), "99"),
        (changed(cmd.PublishResult, reason="it was fate"), "it was fate"),
        (changed(cmd.ReplyAccepted, position=3), "ReplyAccepted"),
        (changed(cmd.RunMatch, inverse_range=(0.0, 2.0)), "inverse_range"),
        (changed(cmd.RunMatch, band_rad=0.5), "band_rad"),
        (without_command, "MoveHead"),
        (without_event, ""),
        (other_match, ""),
    ],
)
async def test_a_golden_log_that_must_fail_does(record, capsys, falsify, told: str) -> None:
    log = await record(falsify)
    assert entry(["replay", str(log), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert not report["same"]
    assert told in json.dumps(report["differences"])
    assert entry(["replay", str(log)]) == 1
    assert told in capsys.readouterr().out


async def test_a_difference_far_below_anything_visible_is_a_difference(record, steps, capsys) -> None:
    number, index = first(steps, cmd.MoveHead)
    target = steps[number][2][index].target
    log = await record(changed(cmd.MoveHead, target=replace(target, pan_deg=target.pan_deg + 1e-12)))
    assert entry(["replay", str(log)]) == 1
    assert "pan_deg" in capsys.readouterr().out


async def test_what_if_says_that_a_request_would_have_ended_otherwise(record, config, tmp_path: Path, capsys) -> None:
    log = await record()
    other = msgspec.to_builtins(config)
    other["search"]["accept_probability"] = other["search"]["certain_probability"] = 1.0
    settings = tmp_path / "other.yaml"
    settings.write_text(yaml.safe_dump(other))
    assert entry(["replay", str(log), "--config", str(settings)]) == 1
    said = capsys.readouterr().out
    assert "first" in said
    assert "locked" in said


async def test_a_folder_is_replayed_file_by_file(record, capsys) -> None:
    good, bad = await record(folder="good"), await record(without_command, folder="bad")
    assert entry(["replay", str(good.parent)]) == 0
    bad.rename(good.parent / "z.mcap")
    assert entry(["replay", str(good.parent)]) == 1
    assert "z.mcap" in capsys.readouterr().out


@pytest.mark.parametrize("content", [b"", b"not a log", b"\x89MCAP0\r\n"])
def test_what_is_no_log_is_refused_in_one_line(tmp_path: Path, capsys, content: bytes) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    assert entry(["replay", str(tmp_path / "x.mcap")]) == 65
    said = capsys.readouterr()
    assert "x.mcap" in said.err
    assert len(said.err.splitlines()) == 1


@pytest.mark.parametrize("name", ["none.mcap", "."])
def test_a_log_that_is_not_there_or_a_folder_without_any(tmp_path: Path, capsys, name: str) -> None:
    assert entry(["replay", str(tmp_path / name)]) == 65
    assert len(capsys.readouterr().err.splitlines()) == 1
