"""Walk a file whose summary is missing or not to be trusted, and write that summary anew."""

from __future__ import annotations

import contextlib
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from ptzd.errors import LogError
from ptzd.log.records import (
    CLOSING_BYTES,
    MAGIC,
    MAX_RECORD,
    MESSAGE_HEAD_BYTES,
    PASSED_OVER,
    Frame,
    RecordFile,
    inner_frames,
    message_head,
)
from ptzd.log.resync import Walk, walk

UNDESCRIBED = "/undescribed/"
"""What the topic of a channel begins with whose description is lost; its number follows."""
_FOOTER = struct.Struct("<QQI")


@dataclass(slots=True)
class Survey:
    """What a file holds."""

    good: int = len(MAGIC)
    """Offset behind the last whole record of the data section, bytes."""
    whole: bool = False
    """Nothing is to be mended."""
    undescribed: bool = False
    """A channel is described nowhere."""
    torn: int | None = None
    """Where the data section is torn, bytes; None when its end is there."""
    reason: str = ""
    damaged: list[Frame] = field(default_factory=list)
    """Records and stretches that cannot be read."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    counts: Counter[int] = field(default_factory=Counter)
    start_ns: int = 0
    end_ns: int = 0
    indexed: ChunkIndex | None = None
    """The chunk that message indexes now belong to; None behind a damaged one."""
    last: list[MessageIndex] = field(default_factory=list)
    """Message indexes of the last chunk: they may be torn, so they are written anew."""
    last_end: int = 0

    @property
    def messages(self) -> int:
        """How many messages can be read."""
        return self.counts.total()

    def closing_records(self) -> bytes:
        """Everything behind :attr:`good`: message indexes of the last chunk, end of data, summary, footer, magic."""
        out = RecordBuilder()
        if self.chunks and self.good == self.last_end:
            index = self.chunks[-1]
            index.message_index_offsets = {}
            for entry in self.last:
                index.message_index_offsets[entry.channel_id] = self.good + out.count
                entry.write(out)
            index.message_index_length = out.count
        DataEnd(0).write(out)
        start = self.good + out.count
        summary, offsets = self._summary(start)
        footer = RecordBuilder()
        Footer(summary_start=start, summary_offset_start=offsets, summary_crc=0).write(footer)
        closing = footer.end()  # type: ignore[no-untyped-call]
        crc = zlib.crc32(closing[:-4], zlib.crc32(summary))
        data = out.end()  # type: ignore[no-untyped-call]
        return bytes(data + summary + closing[:-4] + crc.to_bytes(4, "little") + MAGIC)

    def _summary(self, start: int) -> tuple[bytes, int]:
        """Summary section, and the file offset of its summary offsets."""
        statistics = Statistics(
            attachment_count=len(self.attachments),
            channel_count=len(self.channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self.chunks),
            message_count=self.messages,
            metadata_count=len(self.metadata),
            message_start_time=self.start_ns,
            message_end_time=self.end_ns,
            schema_count=len(self.schemas),
        )
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, list(self.schemas.values())),
            (Opcode.CHANNEL, list(self.channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, list(self.chunks)),
            (Opcode.ATTACHMENT_INDEX, list(self.attachments)),
            (Opcode.METADATA_INDEX, list(self.metadata)),
        ]
        out = RecordBuilder()
        offsets = []
        for opcode, records in groups:
            begin = out.count
            for record in records:
                record.write(out)
            if records:
                offsets.append(
                    SummaryOffset(group_opcode=opcode, group_start=start + begin, group_length=out.count - begin)
                )
        offsets_start = start + out.count
        for offset in offsets:
            offset.write(out)
        return bytes(out.end()), offsets_start  # type: ignore[no-untyped-call]


def survey(file: RecordFile) -> Survey:
    """Note what the data section holds, past everything damaged, up to its end or to where the file is torn.

    Raises
    ------
    LogError
        The disk refuses.
    """
    found, walked = Survey(), walk(file)
    _take_from_summary(file, walked, found)
    for frame, behind in pairwise([*walked.frames, None]):
        if frame is None or frame.ends(Opcode.DATA_END):
            break
        if frame.opcode != Opcode.MESSAGE_INDEX:
            found.indexed = None
        if frame.start in walked.stretches or _was_chunk(frame, behind):
            found.damaged.append(frame)
            found.reason = found.reason or f"damaged at byte {frame.start}"
        else:
            _note(file, frame, found)
        if frame.opcode != Opcode.MESSAGE_INDEX:
            found.good = frame.end
    else:
        found.torn = walked.torn
    if walked.torn is not None:
        found.reason = found.reason or f"torn at byte {walked.torn}"
    elif not _summary_agrees(file, walked.frames[-1]):
        found.reason = found.reason or "its summary is damaged"
        return found
    found.whole = walked.torn is None and not found.damaged and not found.undescribed
    return found


def _summary_agrees(file: RecordFile, footer: Frame) -> bool:
    """Whether the checksum of the closing summary, if there is one, is that of its bytes."""
    start, offsets, crc = _FOOTER.unpack(file.body(footer))
    if not start:
        return bool(not offsets)
    if not len(MAGIC) < start <= footer.start or footer.start - start > MAX_RECORD:
        return False
    return bool(not crc or zlib.crc32(file.read(start, footer.end - start - 4)) == crc)


def _was_chunk(frame: Frame, behind: Frame | None) -> bool:
    """Whether indexes of messages follow a record of nobody: it is a chunk with a damaged opcode."""
    nobodys = frame.opcode not in _NOTES and frame.opcode not in {*CLOSING_BYTES, Opcode.HEADER, PASSED_OVER}
    return nobodys and behind is not None and behind.opcode == Opcode.MESSAGE_INDEX


def _take_from_summary(file: RecordFile, walked: Walk, found: Survey) -> None:
    """Schemas and channels that the summary repeats: where they stood first may be damaged."""
    ended = False
    with contextlib.suppress(LogError):
        for frame in walked.frames:
            ended = ended or frame.ends(Opcode.DATA_END)
            if ended and frame.opcode in {Opcode.SCHEMA, Opcode.CHANNEL}:
                _NOTES[frame.opcode](file, frame, found)


def _note(file: RecordFile, frame: Frame, found: Survey) -> None:
    try:
        if frame.opcode in CLOSING_BYTES:
            raise file.damage(frame, f"a record of {frame.length} bytes with the opcode of an end")
        if frame.opcode in _NOTES:
            _NOTES[frame.opcode](file, frame, found)
    except LogError as error:
        found.damaged.append(frame)
        found.reason = found.reason or str(error)


def _note_attachment(file: RecordFile, frame: Frame, found: Survey) -> None:
    held = file.parse(frame, Attachment.read)
    found.attachments.append(
        AttachmentIndex(
            offset=frame.start,
            length=frame.end - frame.start,
            log_time=held.log_time,
            create_time=held.create_time,
            data_size=len(held.data),
            name=held.name,
            media_type=held.media_type,
        )
    )


def _note_metadata(file: RecordFile, frame: Frame, found: Survey) -> None:
    name = file.parse(frame, Metadata.read).name
    found.metadata.append(MetadataIndex(offset=frame.start, length=frame.end - frame.start, name=name))


def _note_message_index(file: RecordFile, frame: Frame, found: Survey) -> None:
    """An index behind its chunk: kept where it is, except behind the last chunk, where it may be torn."""
    index = found.indexed
    if index is not None:
        index.message_index_offsets[file.parse(frame, MessageIndex.read).channel_id] = frame.start
        index.message_index_length += frame.end - frame.start


def _note_schema(file: RecordFile, frame: Frame, found: Survey, data: bytes | memoryview | None = None) -> None:
    schema = file.parse_bytes(frame, file.body(frame) if data is None else data, Schema.read)
    found.schemas[schema.id] = schema


def _note_channel(file: RecordFile, frame: Frame, found: Survey, data: bytes | memoryview | None = None) -> None:
    channel = file.parse_bytes(frame, file.body(frame) if data is None else data, Channel.read)
    found.channels[channel.id] = channel


def _note_message(file: RecordFile, frame: Frame, found: Survey) -> None:
    """A message outside any chunk, as other writers leave them."""
    if frame.length < MESSAGE_HEAD_BYTES:
        raise file.damage(frame, f"a message of {frame.length} bytes")
    head = message_head(memoryview(file.body(frame)))
    if head.channel_id not in found.channels:
        raise file.damage(frame, f"a message of channel {head.channel_id}, which was never described")
    found.counts[head.channel_id] += 1
    found.start_ns = min(found.start_ns or head.log_ns, head.log_ns)
    found.end_ns = max(found.end_ns, head.log_ns)


def _name_undescribed(found: Survey, channel_id: int) -> None:
    """Keep messages whose description is lost under a name that guesses nothing; the other topics stay readable."""
    found.undescribed = True
    found.reason = found.reason or f"channel {channel_id} was never described"
    found.channels[channel_id] = Channel(
        id=channel_id, topic=f"{UNDESCRIBED}{channel_id}", message_encoding="", schema_id=0, metadata={}
    )


def _note_chunk(file: RecordFile, frame: Frame, found: Survey) -> None:
    chunk = file.chunk(frame)
    data = chunk.data
    indexes: dict[int, MessageIndex] = {}
    try:
        inner = list(inner_frames(data))
    except ValueError as error:
        raise file.damage(frame, str(error)) from None
    for record in inner:
        if record.opcode == Opcode.MESSAGE:
            head = message_head(data, record.body)
            if head.channel_id not in found.channels:
                _name_undescribed(found, head.channel_id)
            entry = indexes.setdefault(head.channel_id, MessageIndex(channel_id=head.channel_id, records=[]))
            entry.records.append((head.log_ns, record.start))
        elif record.opcode == Opcode.SCHEMA:
            _note_schema(file, frame, found, data[record.body : record.end])
        elif record.opcode == Opcode.CHANNEL:
            _note_channel(file, frame, found, data[record.body : record.end])
    times = [log_ns for entry in indexes.values() for log_ns, _ in entry.records]
    for channel_id, entry in indexes.items():
        found.counts[channel_id] += len(entry.records)
    if times:
        found.start_ns = min(found.start_ns or times[0], *times)
        found.end_ns = max(found.end_ns, *times)
    found.chunks.append(
        ChunkIndex(
            message_start_time=min(times, default=0),
            message_end_time=max(times, default=0),
            chunk_start_offset=frame.start,
            chunk_length=frame.end - frame.start,
            message_index_offsets={},
            message_index_length=0,
            compression=chunk.compression,
            compressed_size=chunk.packed_size,
            uncompressed_size=len(data),
        )
    )
    found.indexed = found.chunks[-1]
    found.last, found.last_end = list(indexes.values()), frame.end


_NOTES: Mapping[int, Callable[[RecordFile, Frame, Survey], None]] = {
    Opcode.CHUNK: _note_chunk,
    Opcode.MESSAGE_INDEX: _note_message_index,
    Opcode.ATTACHMENT: _note_attachment,
    Opcode.METADATA: _note_metadata,
    Opcode.SCHEMA: _note_schema,
    Opcode.CHANNEL: _note_channel,
    Opcode.MESSAGE: _note_message,
}
