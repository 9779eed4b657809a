"""Snapshots that the first schema's core took in the middle of its life go on exactly as they did under it."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest

from ptzd.config import Motor
from ptzd.control.machine import Machine
from ptzd.control.memory import Memory
from ptzd.errors import LogError
from ptzd.log.codec import decode_command, decode_event
from ptzd.log.migrations import settings_now
from ptzd.replay.compare import EXACT, differences

LIVES = [json.loads(line) for line in (Path(__file__).with_name("schema_1.jsonl")).read_text().splitlines()]
"""Snapshot, and the events that followed with what was decided; recorded by a core of schema 1."""


def event(told: list):
    return decode_event(told[0], json.dumps(told[1]), 1)


@pytest.mark.parametrize("life", LIVES, ids=lambda life: life["state"])
def test_it_goes_on_as_it_did(rig, config, life) -> None:
    config = msgspec.structs.replace(config, motor=Motor(**settings_now({}, 1)["motor"]))
    machine = Machine.restored(rig, config, event(life["snapshot"]))
    assert machine.state == life["state"]
    for step in life["steps"]:
        decided = machine.handle(event(step["event"]), step["event"][1]["t_ns"])
        recorded = [decode_command(name, json.dumps(body), 1) for name, body in step["commands"]]
        assert len(decided) == len(recorded)
        for one, other in zip(recorded, decided, strict=True):
            assert differences(type(one).__name__, one, other, EXACT) == []


def test_they_were_everywhere() -> None:
    assert {life["state"] for life in LIVES} >= {"IDLE", "SCAN", "MATCH", "LOCK", "HOME", "FAULT"}
    memories = [msgspec.convert(event(life["snapshot"]).state, Memory, strict=False) for life in LIVES]
    assert any(memory.waiting for memory in memories)
    assert any(memory.holder is not None and memory.holder.owner == "stop" for memory in memories)
    assert any(memory.head.held for memory in memories)


def test_a_lock_without_the_time_of_its_confirmation_counts_as_confirmed_when_it_was_noted() -> None:
    life = next(life for life in LIVES if life["state"] == "LOCK" and life["snapshot"][1]["state"]["active"]["lock"])
    name, body = json.loads(json.dumps(life["snapshot"]))
    lock = body["state"]["active"]["lock"]
    for field in ("confirmed_ns", "misses", "moved", "overdue"):
        del lock[field]
    lock["confirmed"] = True
    memory = msgspec.convert(event([name, body]).state, Memory, strict=False)
    assert memory.holder.activity.confirmed_ns == body["t_ns"]


def test_a_snapshot_that_is_none_is_named() -> None:
    with pytest.raises(LogError, match="Snapshot: not as schema version 1 has it: KeyError"):
        decode_event("Snapshot", '{"t_ns": 1, "state": {"state": "IDLE"}}', 1)
