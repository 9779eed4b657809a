"""Read a log in the order in which it was written."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import msgspec
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata

from ptzd.control.commands import Command
from ptzd.control.events import Event
from ptzd.errors import LogError
from ptzd.log.codec import decode_command, decode_event
from ptzd.log.file import U32
from ptzd.log.protobuf import CompressedImage, decode_image
from ptzd.log.records import (
    MESSAGE_HEAD_BYTES,
    PASSED_OVER,
    Frame,
    MessageHead,
    RecordFile,
    Torn,
    inner_frames,
    message_head,
)
from ptzd.log.run_info import CALIBRATION, CONFIG, METADATA, RunInfo, run_info
from ptzd.log.times import clock_time
from ptzd.log.topics import COMMAND, EVENT, IMAGES
from ptzd.model import FrameRef


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One message as it lies in the file."""

    topic: str
    sequence: int
    """Modulo 2³²; of pictures the stream's counter."""
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedEvent:
    """What the core was told, and when."""

    sequence: int
    t_ns: int
    event: Event


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedCommand:
    """What the core answered to the event of this sequence number."""

    sequence: int
    t_ns: int
    command: Command


class _Body(msgspec.Struct, frozen=True):
    """Document of ``/event`` and ``/command``."""

    sequence: int
    t_ns: int
    name: str
    body: str


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a message's data lies."""

    frame: Frame
    start: int
    """Inside the chunk, or inside the record when it lies outside of any."""
    end: int


_Found = tuple[str, MessageHead, Frame, memoryview, int, int]
"""Topic, head, outer record, bytes, start and end of the data in them."""


_MERGED = "decisions of several logs in one file cannot be told apart, use the files as they were recorded"
_NAME_WITHIN = 120
"""Bytes of an event within which its name stands."""


def _name_of(run: Mapping[str, str]) -> str:
    return f"rig {run.get('rig', '?')}, file {run.get('file_index', '?')}"


class LogReader:
    """One log file; use as a context manager.

    Parameters
    ----------
    path : Path
        A ``.mcap`` file, or a ``.mcap.active`` one with ``torn_ok``.
    torn_ok : bool
        Take the last whole record for the end, as in a file that is still being written.
    """

    def __init__(self, path: Path, *, torn_ok: bool = False) -> None:
        self.path = path
        self._torn_ok = torn_ok
        self._file = RecordFile(path)
        self._attachments: dict[str, bytes] = {}
        self._metadata: list[Metadata] = []
        self._described: dict[int, str] = {}
        self.passed_over: list[int] = []
        """Bytes at which a recovery passed over a part that cannot be read."""
        self.crossed = 0
        """How many of these lie before the message that was read last."""
        self._schema: int | None = None
        self._pictures: dict[tuple[str, int, int], _Place] | None = None
        self._chunk: tuple[int, memoryview] = (-1, memoryview(b""))

    def __enter__(self) -> Self:
        self._file.__enter__()
        try:
            self._read_head()
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _frames(self) -> Iterator[Frame]:
        try:
            yield from self._file.frames()
        except Torn:
            if not self._torn_ok:
                raise

    def _read_head(self) -> None:
        """What the file says of itself: it may stand anywhere between header and end of data."""
        with contextlib.suppress(Torn):  # told when its messages are read
            for frame in self._file.frames():
                if frame.opcode == Opcode.METADATA:
                    self._metadata.append(self._file.parse(frame, Metadata.read))
                elif frame.opcode == Opcode.ATTACHMENT:
                    attachment = self._file.parse(frame, Attachment.read)
                    self._attachments.setdefault(attachment.name, attachment.data)
                elif frame.opcode == Opcode.CHANNEL:
                    self._name(frame, self._file.body(frame), self._described)
                elif frame.opcode == PASSED_OVER:
                    self.passed_over.append(frame.start)

    @property
    def run(self) -> RunInfo:
        """Who wrote the file, with what.

        Raises
        ------
        LogError
            Not a log of ptzd, merged of several, or its head contradicts itself.
        """
        runs = [found.metadata for found in self._metadata if found.name == METADATA]
        if not runs:
            raise LogError(f"{self.path}: no log of ptzd: the metadata record {METADATA} is missing")
        if any(run != runs[0] for run in runs):
            raise LogError(
                f"{self.path}: merged of {len(runs)} logs ({', '.join(_name_of(run) for run in runs)}"
                f"{self._apart(runs)}); {_MERGED}"
            )
        try:
            return run_info(runs[0], self.attachment(CONFIG), self.attachment(CALIBRATION))
        except LogError as error:
            raise LogError(f"{self.path}: {error}") from None

    def _apart(self, runs: list[dict[str, str]]) -> str:
        """What tells merged logs apart: when each begins, and what else is said of them."""
        begun = [
            clock_time(head.log_ns)
            for _, head, _, data, start, end in self._messages((EVENT,))
            if b'"Snapshot"' in bytes(data[start : min(start + _NAME_WITHIN, end)])
        ]
        other = sorted({key for run in runs for key in run if run[key] != runs[0].get(key)} - {"rig", "file_index"})
        told = f"; they begin at {', '.join(begun)}" if begun else ""
        return told + (f"; they differ in {', '.join(other)}" if other else "")

    def _check_order(self, frame: Frame, last: int, sequence: int) -> None:
        """Refuse events that stand twice or go back, which one run never writes."""
        if last < 0 or 0 < (sequence - last) & U32 <= U32 // 2:
            return
        what = f"event {sequence} stands in it twice" if sequence == last else f"event {sequence} follows event {last}"
        raise LogError(
            f"{self.path}: at byte {frame.start} {what}: merged of a log and its copy, or of runs that are named "
            f"alike; {_MERGED}"
        )

    def attachment(self, name: str) -> str:
        """Text of an attachment.

        Raises
        ------
        LogError
            None of this name, or no text.
        """
        if name not in self._attachments:
            raise LogError(f"{self.path}: no attachment {name}; there are {', '.join(self._attachments) or 'none'}")
        try:
            return self._attachments[name].decode()
        except UnicodeDecodeError as error:
            raise LogError(f"{self.path}: attachment {name}: {error}") from None

    def entries(self, topics: Collection[str] | None = None) -> Iterator[Entry]:
        """Messages in write order, of these topics or of all.

        Raises
        ------
        Torn
            Behind the last whole message of a file without its end (unless ``torn_ok``).
        LogError
            The file is damaged; the message names the byte.
        """
        last = -1
        for topic, head, frame, data, start, end in self._messages(topics):
            if topic == EVENT:
                self._check_order(frame, last, head.sequence)
                last = head.sequence
            yield Entry(
                topic=topic,
                sequence=head.sequence,
                log_ns=head.log_ns,
                publish_ns=head.publish_ns,
                data=bytes(data[start:end]),
            )

    def decisions(self) -> Iterator[LoggedEvent | LoggedCommand]:
        """Events and commands in write order; errors as for :meth:`entries`, and for bodies that cannot be decoded."""
        for entry in self.entries((EVENT, COMMAND)):
            yield self.decision(entry)

    def decision(self, entry: Entry) -> LoggedEvent | LoggedCommand:
        """Decode one entry of ``/event`` or ``/command``.

        Raises
        ------
        LogError
            Its body cannot be decoded; the message says why.
        """
        if self._schema is None:
            self._schema = self.run.schema
        try:
            held = msgspec.json.decode(entry.data, type=_Body)
            if entry.topic == EVENT:
                event = decode_event(held.name, held.body, self._schema)
                return LoggedEvent(sequence=held.sequence, t_ns=held.t_ns, event=event)
            command = decode_command(held.name, held.body, self._schema)
        except (msgspec.DecodeError, UnicodeDecodeError, LogError) as error:
            raise LogError(f"{self.path}: {entry.topic} of {entry.log_ns} ns: {error}") from None
        return LoggedCommand(sequence=held.sequence, t_ns=held.t_ns, command=command)

    def picture(self, topic: str, frame: FrameRef) -> bytes:
        """Bytes of a picture as the camera sent it.

        Parameters
        ----------
        topic : str
            ``/fisheye/image`` or ``/ptz/image``.
        frame : FrameRef
            Which picture of that stream.

        Raises
        ------
        LogError
            The picture is not in this file, or the file is damaged.
        """
        place = self._index().get((topic, frame.seq & U32, frame.t_capture_ns))
        if place is None:
            raise LogError(f"{self.path}: {topic} has no picture {frame.seq} of {frame.t_capture_ns} ns")
        return self._image(topic, place.frame.start, bytes(self._content(place.frame)[place.start : place.end])).data

    def image(self, entry: Entry) -> CompressedImage:
        """Decode one entry of a topic of pictures.

        Raises
        ------
        LogError
            It is none.
        """
        return self._image(entry.topic, entry.log_ns, entry.data)

    def _image(self, topic: str, place: int, message: bytes) -> CompressedImage:
        try:
            return decode_image(message)
        except LogError as error:
            raise LogError(f"{self.path}: {topic} at {place}: {error}") from None

    def has_picture(self, topic: str, frame: FrameRef) -> bool:
        """Whether :meth:`picture` finds it in this file."""
        return (topic, frame.seq & U32, frame.t_capture_ns) in self._index()

    def _index(self) -> dict[tuple[str, int, int], _Place]:
        if self._pictures is None:
            self._pictures = {
                (topic, head.sequence, head.publish_ns): _Place(frame, start, end)
                for topic, head, frame, _, start, end in self._messages(IMAGES)
            }
        return self._pictures

    def _content(self, frame: Frame) -> memoryview:
        """Bytes that a place counts in; the last chunk is remembered, as pictures are asked for in order."""
        if self._chunk[0] != frame.start:
            chunked = frame.opcode == Opcode.CHUNK
            data = self._file.chunk(frame).data if chunked else memoryview(self._file.body(frame))
            self._chunk = (frame.start, data)
        return self._chunk[1]

    def _messages(self, topics: Collection[str] | None) -> Iterator[_Found]:
        names = dict(self._described)
        for frame in self._frames():
            if frame.opcode == PASSED_OVER:
                self.crossed += 1
            elif frame.opcode == Opcode.CHUNK:
                yield from self._chunk_messages(frame, names, topics)
            elif frame.opcode == Opcode.CHANNEL:
                self._name(frame, self._file.body(frame), names)
            elif frame.opcode == Opcode.MESSAGE:
                data = memoryview(self._file.body(frame))
                if len(data) < MESSAGE_HEAD_BYTES:
                    raise self._file.damage(frame, f"a message of {len(data)} bytes")
                head = message_head(data)
                topic = self._topic(frame, head, names)
                if topics is None or topic in topics:
                    yield topic, head, frame, data, MESSAGE_HEAD_BYTES, len(data)

    def _chunk_messages(self, frame: Frame, names: dict[int, str], topics: Collection[str] | None) -> Iterator[_Found]:
        data = self._file.chunk(frame).data
        try:
            records = list(inner_frames(data))
        except ValueError as error:
            raise self._file.damage(frame, str(error)) from None
        for record in records:
            if record.opcode == Opcode.CHANNEL:
                self._name(frame, data[record.body : record.end], names)
            elif record.opcode == Opcode.MESSAGE:
                head = message_head(data, record.body)
                topic = self._topic(frame, head, names)
                if topics is None or topic in topics:
                    yield topic, head, frame, data, record.body + MESSAGE_HEAD_BYTES, record.end

    def _name(self, frame: Frame, data: bytes | memoryview, names: dict[int, str]) -> None:
        channel = cast("Channel", self._file.parse_bytes(frame, data, Channel.read))
        names[channel.id] = channel.topic

    def _topic(self, frame: Frame, head: MessageHead, names: dict[int, str]) -> str:
        if head.channel_id not in names:
            raise self._file.damage(frame, f"a message of channel {head.channel_id}, which was never described")
        return names[head.channel_id]
