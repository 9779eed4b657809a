"""Records of an MCAP file, walked with every length checked against what is there.

A length field of a damaged file is never trusted: no record is read that ends behind the file or exceeds
:data:`MAX_RECORD`, so reading garbage costs a clear error, not memory.
"""

from __future__ import annotations

import io
import os
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream
from zstandard import ZstdError

from ptzd.documents import open_regular
from ptzd.errors import LogError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD = 64 << 20
"""Largest record that is read into memory, and largest chunk after decompression, bytes."""

CLOSING_BYTES = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}
"""Lengths of the records that end a section, bytes."""

PASSED_OVER = 0x80
"""Private opcode that `ptzd log recover` gives to a stretch that cannot be read; every reader passes it over."""

_HEAD = struct.Struct("<BQ")
HEAD_BYTES = _HEAD.size
"""Of every record: opcode and length."""
_CHUNK = struct.Struct("<QQQI")
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
_DAMAGE = (struct.error, McapError, ValueError, OverflowError, EOFError, RuntimeError, ZstdError)
"""What the parsers of the mcap library and the decompressors below it raise on damaged bytes."""

_MESSAGE = struct.Struct("<HIQQ")
_T = TypeVar("_T")


class Frame(NamedTuple):
    """Place of one record."""

    opcode: int
    start: int
    """Offset of its opcode, bytes."""
    length: int
    """Of its body, bytes."""

    @property
    def body(self) -> int:
        """Offset of the body, bytes."""
        return self.start + _HEAD.size

    @property
    def end(self) -> int:
        """Offset behind the record, bytes."""
        return self.body + self.length

    def ends(self, what: Opcode) -> bool:
        """Whether it is this closing record; one whose length is another's carries its opcode by damage."""
        return self.opcode == what and self.length == CLOSING_BYTES[what]


class MessageHead(NamedTuple):
    """What precedes a message's data."""

    channel_id: int
    sequence: int
    log_ns: int
    publish_ns: int


MESSAGE_HEAD_BYTES = _MESSAGE.size


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkData:
    """Content of one chunk."""

    data: memoryview
    """Records, uncompressed."""
    compression: str
    packed_size: int
    """As it lies in the file, bytes."""


class _Bounded(io.BytesIO):
    """A record's bytes; the parsers of the mcap library take what is left for the whole, so a short read is told."""

    def read(self, size: int | None = -1) -> bytes:
        data = super().read(size)
        if size is not None and len(data) < size:
            raise EOFError(f"{size} bytes named, {len(data)} there")
        return data


class Torn(LogError):
    """The file ends inside a record, or without the closing summary.

    Parameters
    ----------
    message : str
        One line.
    good : int
        Offset behind the last whole record, bytes.
    """

    def __init__(self, message: str, good: int) -> None:
        super().__init__(message)
        self.good = good


@dataclass(slots=True)
class RecordFile:
    """An MCAP file open for reading; use as a context manager."""

    path: Path
    _fd: int = -1
    size: int = 0

    def __enter__(self) -> Self:
        try:
            self._fd = open_regular(self.path)
            self.size = os.fstat(self._fd).st_size
            start = os.pread(self._fd, len(MAGIC), 0)
        except OSError as error:
            self.close()
            raise LogError(f"{self.path}: cannot be read: {error.strerror}") from None
        if start != MAGIC:
            self.close()
            raise LogError(f"{self.path}: not an MCAP file: it starts with {start.hex(' ') or 'nothing'}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; again is harmless."""
        if self._fd >= 0:
            os.close(self._fd)
            self._fd = -1

    def frames(self) -> Iterator[Frame]:
        """Every record in the order of the file, up to and with the footer.

        Raises
        ------
        Torn
            After the last whole record, when the file is not complete.
        """
        at = len(MAGIC)
        while True:
            head = self.read(at, _HEAD.size) if at + _HEAD.size <= self.size else b""
            if len(head) < _HEAD.size:
                raise Torn(f"{self.path}: torn at byte {at}: no closing summary; run `ptzd log recover` on it", at)
            opcode, length = _HEAD.unpack(head)
            frame = Frame(opcode, at, length)
            if frame.opcode == 0 or frame.end > self.size:
                raise Torn(f"{self.path}: torn at byte {at} inside a record; run `ptzd log recover` on it", at)
            yield frame
            at = frame.end
            if frame.ends(Opcode.FOOTER):
                break
        if self.read(at, len(MAGIC)) != MAGIC:
            raise Torn(f"{self.path}: torn at byte {at}: no closing magic; run `ptzd log recover` on it", at)

    def read(self, offset: int, length: int) -> bytes:
        """Bytes from ``offset``; fewer at the end of the file.

        Raises
        ------
        LogError
            The disk refuses.
        """
        try:
            return os.pread(self._fd, length, offset)
        except OSError as error:
            raise LogError(f"{self.path}: cannot be read at byte {offset}: {error.strerror}") from None

    def body(self, frame: Frame) -> bytes:
        """Whole body of a record.

        Raises
        ------
        LogError
            Longer than :data:`MAX_RECORD`, or the file became shorter meanwhile.
        """
        if frame.length > MAX_RECORD:
            raise self.damage(frame, f"a record of {frame.length} bytes; at most {MAX_RECORD} are read")
        data = self.read(frame.body, frame.length)
        if len(data) < frame.length:
            raise self.damage(frame, "the file was cut while it was read")
        return data

    def parse(self, frame: Frame, read: Callable[[ReadDataStream], _T]) -> _T:
        """Parse a record's body with a reader of the mcap library.

        Raises
        ------
        LogError
            The body is damaged.
        """
        return self.parse_bytes(frame, self.body(frame), read)

    def parse_bytes(self, frame: Frame, data: bytes | memoryview, read: Callable[[ReadDataStream], _T]) -> _T:
        """Parse bytes found inside ``frame``; errors as for :meth:`parse`."""
        try:
            return read(ReadDataStream(_Bounded(data)))
        except _DAMAGE as error:
            raise self.damage(frame, f"{type(error).__name__} {error}") from None

    def chunk(self, frame: Frame) -> ChunkData:
        """Content of a chunk, decompressed, its checksum compared.

        Raises
        ------
        LogError
            The chunk is damaged.
        """
        body = memoryview(self.body(frame))
        try:
            _start, _end, size, crc = _CHUNK.unpack_from(body)
            at = _CHUNK.size
            (named,) = _U32.unpack_from(body, at)
            compression = bytes(body[at + 4 : at + 4 + named]).decode()
            at += 4 + named
            (packed,) = _U64.unpack_from(body, at)
            data = body[at + 8 : at + 8 + packed]
        except (struct.error, UnicodeDecodeError) as error:
            raise self.damage(frame, f"chunk head: {error}") from None
        if len(data) != packed or size > MAX_RECORD:
            raise self.damage(frame, f"a chunk of {packed} bytes, {size} unpacked, does not fit its record")
        if compression:
            data = self._unpack(frame, compression, data, size)
        if len(data) != size or (crc and zlib.crc32(data) != crc):
            raise self.damage(frame, "the chunk's checksum does not agree")
        return ChunkData(data=data, compression=compression, packed_size=packed)

    def _unpack(self, frame: Frame, compression: str, data: memoryview, size: int) -> memoryview:
        packed = Chunk(
            compression=compression,
            data=bytes(data),
            message_start_time=0,
            message_end_time=0,
            uncompressed_crc=0,
            uncompressed_size=size,
        )
        if compression not in {"lz4", "zstd"}:
            raise self.damage(frame, f"compression {compression[:20]!r} is unknown; lz4 and zstd can be read")
        try:
            stream, length = get_chunk_data_stream(packed)
            return memoryview(stream.read(min(length, size)))
        except _DAMAGE as error:
            raise self.damage(frame, f"cannot be unpacked: {error}") from None

    def damage(self, frame: Frame, what: str) -> LogError:
        """Error that names the file and the place."""
        return LogError(f"{self.path}: damaged at byte {frame.start}: {what}")


def inner_frames(data: memoryview) -> Iterator[Frame]:
    """Records inside a chunk's data; offsets count from its start.

    Raises
    ------
    ValueError
        A record does not end inside the chunk.
    """
    at, end = 0, len(data)
    while at < end:
        if at + _HEAD.size > end:
            raise ValueError(f"{end - at} bytes behind the last record of a chunk")
        opcode, length = _HEAD.unpack_from(data, at)
        frame = Frame(opcode, at, length)
        if frame.end > end:
            raise ValueError("a record does not end inside its chunk")
        if opcode == Opcode.MESSAGE and length < MESSAGE_HEAD_BYTES:
            raise ValueError(f"a message of {length} bytes")
        yield frame
        at = frame.end


def message_head(data: memoryview, at: int = 0) -> MessageHead:
    """Head of the message whose body begins at ``at``; `inner_frames` made sure that it is there."""
    return MessageHead(*_MESSAGE.unpack_from(data, at))
