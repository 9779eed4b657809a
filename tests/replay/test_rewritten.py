"""Logs as other tools leave them: records moved, compressed, damaged, recovered, merged."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader
from mcap.records import Attachment, Metadata
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from ptzd.app.replaying import replay
from ptzd.cli import entry
from ptzd.errors import LogError
from ptzd.evidence.info import describe
from ptzd.log.reader import Entry, LogReader
from ptzd.log.recover import recover
from ptzd.log.times import clock_time

GOLDEN = Path(__file__).parents[1] / "golden"
LOCK = GOLDEN / "lock.mcap"


def rewrite(
    target: Path, *sources: Path, order: str = "mad", compression: CompressionType = CompressionType.NONE
) -> Path:
    """Copy logs into one file: m = metadata, a = attachments, d = messages by time, in this order."""
    writer = Writer(str(target), chunk_size=20_000, compression=compression)
    writer.start(profile="", library="another tool")
    records = [record for source in sources for record in StreamReader(BytesIO(source.read_bytes())).records]
    for part in order:
        if part == "d":
            _copy_messages(writer, sources)
        for record in records:
            if part == "m" and isinstance(record, Metadata):
                writer.add_metadata(record.name, record.metadata)
            if part == "a" and isinstance(record, Attachment):
                writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
    writer.finish()
    return target


def _copy_messages(writer: Writer, sources: tuple[Path, ...]) -> None:
    channels: dict[str, int] = {}
    found = [
        item
        for source in sources
        for item in make_reader(BytesIO(source.read_bytes())).iter_messages(log_time_order=False)
    ]
    for schema, channel, message in found:
        if channel.topic not in channels:
            known = writer.register_schema(schema.name, schema.encoding, schema.data) if schema else 0
            channels[channel.topic] = writer.register_channel(
                channel.topic, channel.message_encoding, known, channel.metadata
            )
        writer.add_message(
            channels[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
        )


def damaged(path: Path, share: float) -> Path:
    """One byte of the file turned over."""
    data = bytearray(path.read_bytes())
    data[int(len(data) * share)] ^= 0x55
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("order", ["mad", "mda", "dma", "adm", "dam"])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_records_may_stand_anywhere(tmp_path, order, compression):
    moved = rewrite(tmp_path / "moved.mcap", LOCK, order=order, compression=compression)
    assert replay(moved).same
    assert [story.outcome for story in describe(moved).stories] == ["locked"]
    assert entry(["log", "export", str(moved), "--out", str(tmp_path / "out")]) == 0


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("share", [0.2, 0.35, 0.5, 0.65, 0.8])
def test_a_damaged_chunk_is_named_passed_over_and_told_as_a_hole(tmp_path, capsys, compression, share):
    file = damaged(rewrite(tmp_path / "night.mcap", LOCK, compression=compression), share)
    with pytest.raises(LogError, match=r"night\.mcap: damaged at byte \d+"):
        describe(file)
    with pytest.raises(LogError, match=r"night\.mcap: damaged at byte \d+"):
        replay(file)
    active = file.rename(tmp_path / "night.mcap.active")
    report = recover(active)
    assert report.parts_lost == 1
    with LogReader(report.path) as log:
        assert len(log.passed_over) == 1
    assert any("passed over" in hole for hole in describe(report.path).holes)


@pytest.mark.parametrize("gone", [(20, 30), (41, 41), (60, 74)])
def test_missing_events_are_a_hole_and_no_changed_decision(tmp_path, capsys, gone):
    whole = LogReader(LOCK)
    with whole:
        places = {logged.sequence for logged in whole.decisions()}
    assert set(gone) <= places
    cut = tmp_path / "cut.mcap"
    _without(cut, gone)
    found = replay(cut)
    assert found.same
    assert [(hole.first, hole.last) for hole in found.holes] == [gone]
    assert entry(["replay", str(cut)]) == 0
    assert f"events {gone[0]} to {gone[1]} are missing" in capsys.readouterr().out
    assert any("are missing" in hole for hole in describe(cut).holes)


def _without(target: Path, gone: tuple[int, int]) -> None:
    """The log less some events, and less the commands of the event before them, as a lost chunk leaves it."""
    writer = Writer(str(target))
    writer.start(profile="", library="test")
    for record in StreamReader(BytesIO(LOCK.read_bytes())).records:
        if isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        if isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
    channels: dict[str, int] = {}
    for schema, channel, message in make_reader(BytesIO(LOCK.read_bytes())).iter_messages(log_time_order=False):
        if channel.topic in {"/event", "/command"}:
            sequence = msgspec.json.decode(message.data)["sequence"]
            if gone[0] <= sequence <= gone[1] or (channel.topic == "/command" and sequence == gone[0] - 1):
                continue
        if channel.topic not in channels:
            known = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.topic] = writer.register_channel(channel.topic, channel.message_encoding, known)
        writer.add_message(
            channels[channel.topic], message.log_time, message.data, message.publish_time, message.sequence
        )
    writer.finish()


def test_a_log_merged_of_two_runs_is_told(tmp_path):
    merged = rewrite(tmp_path / "merged.mcap", LOCK, GOLDEN / "update.mcap")
    for use in (describe, replay):
        with pytest.raises(LogError, match=r"merged\.mcap: merged of 2 logs \(rig .*, file 0, rig .*, file 0; they "):
            use(merged)


def test_merged_logs_are_told_apart_by_when_they_begin(tmp_path):
    first, second = LOCK, GOLDEN / "update.mcap"
    merged = rewrite(tmp_path / "merged.mcap", first, second)
    begins = [clock_time(min(told.log_ns for told in _events(path))) for path in (first, second)]
    with pytest.raises(LogError) as refused:
        replay(merged)
    assert f"they begin at {', '.join(begins)}" in str(refused.value)


def _events(path: Path) -> list[Entry]:
    with LogReader(path) as log:
        return list(log.entries(["/event"]))


@pytest.mark.parametrize("name", ["lock", "update", "device_loss", "refusal"])
def test_a_log_merged_with_its_copy_is_refused_with_a_sentence(tmp_path, capsys, name):
    source = GOLDEN / f"{name}.mcap"
    merged = rewrite(tmp_path / "merged.mcap", source, source)
    for use in (describe, replay):
        with pytest.raises(
            LogError, match=r"event \d+ (stands in it twice|follows event \d+): merged of a log and its"
        ):
            use(merged)
    rewrite(tmp_path / "plain.mcap", source)
    report = tmp_path / "report.xml"
    assert entry(["replay", str(tmp_path), "--junit", str(report)]) == LogError.exit_code
    assert "plain.mcap: no difference" in capsys.readouterr().out
    assert 'name="merged.mcap" tests="1" failures="0" errors="1"' in report.read_text()


def test_a_file_that_cannot_be_read_does_not_stop_the_report_of_a_folder(tmp_path, capsys):
    damaged(rewrite(tmp_path / "a.mcap", LOCK, compression=CompressionType.ZSTD), 0.5)
    (tmp_path / "b.mcap").write_bytes(b"no log")
    rewrite(tmp_path / "c.mcap", LOCK)
    assert entry(["replay", str(tmp_path)]) == LogError.exit_code
    out = capsys.readouterr().out
    assert "a.mcap: damaged at byte" in out
    assert "b.mcap: not an MCAP file" in out
    assert "c.mcap: no difference" in out
