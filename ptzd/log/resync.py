"""Walk a damaged file past its damage: a length field that is wrong hides one record, never what lies behind it.

A record is believed when its content fills its length exactly, or else when plausible heads follow it. Where neither
holds, the next record that proves itself is looked for byte by byte: a chunk or an attachment by its checksum, the end
of data by the footer at the end of the file, a description (schema, channel, metadata) by leading to one of these
without a message between, which tells it from those inside a chunk. A picture that holds such bytes by chance proves
nothing.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, MessageIndex, Metadata, Schema

from ptzd.errors import LogError
from ptzd.log.records import CLOSING_BYTES, HEAD_BYTES, MAGIC, MAX_RECORD, PASSED_OVER, Frame, RecordFile, inner_frames

_WINDOW = 4 << 20
"""Bytes that are searched at a time."""
_AHEAD = 3
"""Plausible heads that must follow a record whose content does not tell its length: each is 1 in 2³⁶ by chance."""
_LEADS = 256
"""Descriptions that are followed from one to the next; a log has 60."""
_CHUNK_HEAD = struct.Struct("<QQQII")
_ANCHOR = re.compile(rb"[\x03\x04\x06\x09\x0c\x0f][\x00-\xff]{3}[\x00-\x04]\x00{4}")
"""Opcode and length of what may prove itself."""
_DESCRIPTIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_CLOSING = frozenset(
    {
        Opcode.SCHEMA,
        Opcode.CHANNEL,
        Opcode.STATISTICS,
        Opcode.CHUNK_INDEX,
        Opcode.ATTACHMENT_INDEX,
        Opcode.METADATA_INDEX,
        Opcode.SUMMARY_OFFSET,
        Opcode.FOOTER,
    }
)
"""What may stand behind the end of data."""
_READERS: Mapping[int, Callable[[ReadDataStream], Any]] = {
    Opcode.HEADER: Header.read,
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.ATTACHMENT: Attachment.read,
    Opcode.METADATA: Metadata.read,
    Opcode.MESSAGE_INDEX: MessageIndex.read,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Walk:
    """Every record of a file, damaged stretches between them, and where it ends."""

    frames: tuple[Frame, ...]
    """In the order of the file; one of opcode :data:`PASSED_OVER` for each stretch as well."""
    stretches: frozenset[int]
    """Offsets of the stretches that are not such records yet, bytes."""
    torn: int | None
    """Offset behind the last record of a file that is not complete; None of one that is."""


def walk(file: RecordFile) -> Walk:
    """Walk the whole file.

    Raises
    ------
    LogError
        The disk refuses.
    """
    frames: list[Frame] = []
    stretches: set[int] = set()
    at, ended = len(MAGIC), False
    while True:
        frame = _head(file, at)
        if frame is None or not _believed(file, frame, ended=ended):
            found = None if ended else _next_proven(file, at + HEAD_BYTES)
            if found is None:
                return Walk(frames=tuple(frames), stretches=frozenset(stretches), torn=at)
            frame = Frame(PASSED_OVER, at, found - at - HEAD_BYTES)
            stretches.add(at)
        frames.append(frame)
        ended = ended or frame.ends(Opcode.DATA_END)
        at = frame.end
        if ended and frame.ends(Opcode.FOOTER):
            whole = file.read(at, len(MAGIC)) == MAGIC
            return Walk(frames=tuple(frames), stretches=frozenset(stretches), torn=None if whole else at)


def torn_record(file: RecordFile, at: int) -> bool:
    """Whether the bytes from ``at`` are what a writer leaves that was stopped: one record's beginning, or zeroes."""
    rest = file.size - at
    if rest < HEAD_BYTES:
        return True
    data = file.read(at, HEAD_BYTES)
    opcode, length = data[0], int.from_bytes(data[1:], "little")
    if rest > HEAD_BYTES + length:
        return _zeroes(file, at)
    if opcode == Opcode.CHUNK:
        known = rest >= HEAD_BYTES + _CHUNK_HEAD.size + len("zstd") + 8
        return length <= MAX_RECORD and (not known or _fills_chunk(file, Frame(opcode, at, length)))
    if opcode == Opcode.MESSAGE_INDEX and rest >= HEAD_BYTES + 6:
        return length == 6 + int.from_bytes(file.read(at + HEAD_BYTES + 2, 4), "little")
    return opcode in {Opcode.MESSAGE_INDEX, Opcode.DATA_END}


def _zeroes(file: RecordFile, at: int) -> bool:
    return all(not any(file.read(start, _WINDOW)) for start in range(at, file.size, _WINDOW))


def _head(file: RecordFile, at: int) -> Frame | None:
    """The record at an offset, if it can be one."""
    data = file.read(at, HEAD_BYTES)
    if len(data) < HEAD_BYTES or not data[0]:
        return None
    frame = Frame(data[0], at, int.from_bytes(data[1:], "little"))
    fits = frame.end <= file.size and (frame.length <= MAX_RECORD or frame.opcode == PASSED_OVER)
    return frame if fits else None


def _believed(file: RecordFile, frame: Frame, *, ended: bool) -> bool:
    """Whether a record's length may be gone by."""
    if ended:
        return True
    if frame.ends(Opcode.FOOTER):
        return False
    if frame.ends(Opcode.DATA_END):
        behind = _head(file, frame.end)
        return frame.end == file.size or (behind is not None and behind.opcode in _CLOSING)
    if _fills(file, frame):
        return True
    verifiable = frame.opcode == Opcode.CHUNK or frame.opcode in _READERS or frame.opcode in CLOSING_BYTES
    return _followed(file, frame, _AHEAD if verifiable else 1)


def _followed(file: RecordFile, frame: Frame, heads: int) -> bool:
    """Whether so many plausible heads follow, or the file's end."""
    at = frame.end
    for _ in range(heads):
        behind = _head(file, at)
        if behind is None:
            return at == file.size
        at = behind.end
        if behind.ends(Opcode.FOOTER):
            break
    return True


def _fills(file: RecordFile, frame: Frame) -> bool:
    """Whether a record's content ends exactly where its length says; of kinds that do not tell, False."""
    if frame.opcode == Opcode.CHUNK:
        return _fills_chunk(file, frame)
    if frame.opcode not in _READERS:
        return False
    try:
        held = file.parse(frame, _READERS[frame.opcode])
        out = RecordBuilder()
        held.write(out)
    except (LogError, struct.error, UnicodeError):
        return False
    return bool(out.count == HEAD_BYTES + frame.length)


def _fills_chunk(file: RecordFile, frame: Frame) -> bool:
    data = file.read(frame.body, _CHUNK_HEAD.size)
    if len(data) < _CHUNK_HEAD.size:
        return False
    *_, named = _CHUNK_HEAD.unpack(data)
    if named > len("zstd"):
        return False
    packed = int.from_bytes(file.read(frame.body + _CHUNK_HEAD.size + named, 8), "little")
    return frame.length == _CHUNK_HEAD.size + int(named) + 8 + packed


def _next_proven(file: RecordFile, start: int) -> int | None:
    """Offset of the next record that proves itself; None when there is none."""
    for window in range(start, file.size, _WINDOW):
        data = file.read(window, _WINDOW + HEAD_BYTES - 1)
        at = 0
        while (match := _ANCHOR.search(data, at)) is not None and match.start() < _WINDOW:
            frame = _head(file, window + match.start())
            if frame is not None and _proven(file, frame):
                return frame.start
            at = match.start() + 1
    return None


def _proven(file: RecordFile, frame: Frame) -> bool:
    for _ in range(_LEADS):
        if frame.opcode not in _DESCRIPTIONS:
            return _proves(file, frame)
        behind = _head(file, frame.end)
        if behind is None or not _fills(file, frame):
            return False
        frame = behind
    return False


def _proves(file: RecordFile, frame: Frame) -> bool:
    """Whether a record cannot be there by chance."""
    if frame.opcode == Opcode.CHUNK and _fills_chunk(file, frame):
        try:
            data = file.chunk(frame).data
            return any(inner.opcode == Opcode.MESSAGE for inner in inner_frames(data))
        except (LogError, ValueError):
            return False
    if frame.opcode == Opcode.ATTACHMENT and _fills(file, frame):
        body = file.body(frame)
        crc = int.from_bytes(body[-4:], "little")
        return bool(crc) and zlib.crc32(body[:-4]) == crc
    return frame.ends(Opcode.DATA_END) and _leads_to_end(file, frame)


def _leads_to_end(file: RecordFile, frame: Frame) -> bool:
    behind = _head(file, frame.end)
    while behind is not None and behind.opcode in _CLOSING:
        if behind.ends(Opcode.FOOTER):
            return file.read(behind.end, len(MAGIC)) == MAGIC and behind.end + len(MAGIC) == file.size
        behind = _head(file, behind.end)
    return False
