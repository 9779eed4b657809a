"""Damage anywhere in a log costs what it hit and nothing else."""

from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from ptzd.app.replaying import replay
from ptzd.cli import entry
from ptzd.errors import LogError
from ptzd.evidence.info import describe
from ptzd.log.reader import LogReader
from ptzd.log.records import RecordFile
from ptzd.log.recover import recover, recover_directory
from ptzd.log.resync import walk

GOLDEN = Path(__file__).parents[1] / "golden"
DATA = (GOLDEN / "refusal.mcap").read_bytes()


def _frames(path):
    with RecordFile(path) as file:
        return list(file.frames())


FRAMES = _frames(GOLDEN / "refusal.mcap")
CHUNKS = [frame for frame in FRAMES if frame.opcode == Opcode.CHUNK]
TOLD = [frame.start for frame in FRAMES if frame.opcode in {Opcode.SCHEMA, Opcode.CHANNEL}]


def contents(path):
    """The bytes of every chunk that can be read."""
    with RecordFile(path) as file:
        return [bytes(file.chunk(frame).data) for frame in file.frames() if frame.opcode == Opcode.CHUNK]


WHOLE = contents(GOLDEN / "refusal.mcap")


def survivors(data):
    """Content of the chunks that are in these bytes as they were written."""
    return [
        held
        for frame, held in zip(CHUNKS, WHOLE, strict=True)
        if data[frame.start : frame.end] == DATA[frame.start : frame.end]
    ]


def in_order(some, of):
    rest = iter(of)
    return all(one in rest for one in some)


byte = st.tuples(st.integers(8, len(DATA) - 1), st.integers(1, 255))
length_byte = st.tuples(
    st.sampled_from(FRAMES).flatmap(lambda frame: st.integers(frame.start, frame.start + 8)), st.integers(1, 255)
)
zeroes = st.tuples(st.integers(8, len(DATA) - 1), st.integers(1, 30_000))


flips = st.lists(st.one_of(byte, length_byte), max_size=3)
runs = st.lists(zeroes, max_size=1)
cuts = st.one_of(st.just(len(DATA)), st.integers(8, len(DATA)))


def damaged(flipped, zeroed, cut):
    data = bytearray(DATA)
    for at, mask in flipped:
        data[at] ^= mask
    for at, count in zeroed:
        end = min(at + count, len(data))
        data[at:end] = bytes(end - at)
    return bytes(data[:cut])


@pytest.fixture
def folder(tmp_path, prompt_disk):
    return tmp_path


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(flipped=flips, zeroed=runs, cut=cuts)
def test_every_chunk_that_is_whole_is_kept_and_a_second_recovery_changes_nothing(folder, flipped, zeroed, cut):
    data = damaged(flipped, zeroed, cut)
    for old in folder.iterdir():
        old.unlink()
    active = folder / "night.mcap.active"
    active.write_bytes(data)
    report = recover(active)
    kept = contents(report.path)
    assert in_order(survivors(data), kept)
    assert in_order(kept, WHOLE)
    once = report.path.read_bytes()
    again = recover(report.path)
    assert again.note == "whole"
    assert report.path.read_bytes() == once
    for aside in folder.glob("*.cut"):
        assert data[report.bytes_kept :].endswith(aside.read_bytes())
    with LogReader(report.path) as log:
        assert sum(1 for _ in log.entries()) == report.messages
    for use in (describe, replay):
        with contextlib.suppress(LogError):  # of a head that is gone; any other exception fails
            use(report.path)


@pytest.mark.parametrize("place", range(9))
@pytest.mark.parametrize("mask", [0x01, 0x03, 0x80, 0xFF])
def test_a_damaged_head_of_a_chunk_costs_this_chunk(tmp_path, capsys, place, mask):
    victim = CHUNKS[len(CHUNKS) // 3]
    data = bytearray(DATA)
    data[victim.start + place] ^= mask
    path = tmp_path / "night.mcap"
    path.write_bytes(data)
    report = recover(path)
    assert contents(path) == [held for frame, held in zip(CHUNKS, WHOLE, strict=True) if frame != victim]
    assert f"bytes {victim.start} to" in report.note
    assert any(str(victim.start) in hole for hole in describe(path).holes)
    with LogReader(path) as log:
        assert log.passed_over == [victim.start]
    found = replay(path)
    assert found.same
    assert found.passed_over == [victim.start]
    assert entry(["replay", str(path), "--junit", str(tmp_path / "report.xml")]) == 0
    told = f"a damaged part at byte {victim.start} was passed over"
    assert told in capsys.readouterr().out
    assert told in (tmp_path / "report.xml").read_text()


@pytest.mark.parametrize("victim", CHUNKS, ids=lambda frame: str(frame.start))
def test_whatever_a_lost_chunk_held_the_replay_tells_a_hole_and_no_other_decision(tmp_path, victim):
    data = bytearray(DATA)
    data[victim.start + 5] ^= 0x7F
    path = tmp_path / "night.mcap"
    path.write_bytes(data)
    recover(path)
    if victim == CHUNKS[0]:
        with pytest.raises(LogError, match="no snapshot"):
            replay(path)
        return
    found = replay(path)
    assert found.same, found.differences
    assert found.passed_over == [victim.start]


def test_a_recovery_that_was_stopped_is_taken_up_again(tmp_path):
    tail = b"\x05" + bytes([255] * 3000)
    path = tmp_path / "night.mcap"
    path.write_bytes(DATA[: CHUNKS[-1].end] + tail)
    aside = tmp_path / f"night.mcap.{CHUNKS[-1].end}.cut"
    aside.write_bytes(tail[:1000])
    recover(path)
    assert aside.read_bytes() == tail


@pytest.mark.parametrize("value", [0, 1, 17, 4000, 70_000, 1 << 24, 1 << 40, (1 << 64) - 1])
def test_the_daemon_at_its_next_start_keeps_the_rest_as_well(tmp_path, value):
    victim = CHUNKS[1]
    data = bytearray(DATA)
    data[victim.start + 1 : victim.start + 9] = value.to_bytes(8, "little")
    (tmp_path / "night.mcap.active").write_bytes(data[: CHUNKS[-1].end - 40])
    (line,) = recover_directory(tmp_path)
    assert "passed over" in line
    assert contents(tmp_path / "night.mcap") == [WHOLE[0], *WHOLE[2:-1]]
    assert not list(tmp_path.glob("*.cut"))


@pytest.mark.parametrize("start", TOLD)
def test_a_damaged_description_costs_no_chunk_when_the_summary_repeats_it(tmp_path, start):
    data = bytearray(DATA)
    data[start + 4] ^= 0x20
    path = tmp_path / "night.mcap"
    path.write_bytes(data)
    recover(path)
    assert contents(path) == WHOLE


def test_bytes_of_a_picture_that_look_like_records_are_none(tmp_path):
    """A head of every kind in the middle of a damaged chunk, lengths that fit included."""
    victim = CHUNKS[2]
    data = bytearray(DATA)
    data[victim.start + 7] = 1
    at = victim.body + 100
    for opcode in range(1, 16):
        for length in (0, 4, 20, 40, victim.end - at - 9):
            data[at : at + 9] = struct.pack("<BQ", opcode, length)
            at += 20
    path = tmp_path / "night.mcap"
    path.write_bytes(data)
    recover(path)
    assert contents(path) == WHOLE[:2] + WHOLE[3:]


def test_an_end_that_is_no_torn_record_is_kept_beside_the_file(tmp_path):
    tail = b"\x05" + (1 << 50).to_bytes(8, "little") + b"what another tool may understand" * 9
    path = tmp_path / "night.mcap"
    path.write_bytes(DATA[: CHUNKS[-1].end] + tail)
    report = recover(path)
    (aside,) = tmp_path.glob("*.cut")
    assert aside.read_bytes() == tail
    assert aside.name in report.note
    assert contents(path) == WHOLE


def test_an_end_that_cannot_be_kept_leaves_the_file_as_it_is(tmp_path):
    path = tmp_path / "night.mcap"
    data = DATA[: CHUNKS[-1].end] + b"\x05" + bytes([255] * 300)
    path.write_bytes(data)
    (tmp_path / f"night.mcap.{CHUNKS[-1].end}.cut").write_bytes(b"of somebody")
    with pytest.raises(LogError, match="move it away"):
        recover(path)
    assert path.read_bytes() == data


def test_a_whole_file_is_walked_without_a_stretch():
    for path in GOLDEN.glob("*.mcap"):
        with RecordFile(path) as file:
            found = walk(file)
            assert found.frames == tuple(file.frames())
        assert found.torn is None
        assert not found.stretches
