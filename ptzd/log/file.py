"""One MCAP file that is being written: ``NAME.mcap.active`` until it is whole, then ``NAME.mcap``."""

from __future__ import annotations

import fcntl
import functools
import os
from pathlib import Path
from typing import IO, Any, cast

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import CompressionType, Writer

from ptzd import __version__
from ptzd.log.run_info import CALIBRATION, CONFIG, METADATA, RunInfo
from ptzd.log.topics import TOPICS, Topic
from ptzd.log.topics import topic as find_topic

ACTIVE = ".active"
CHUNK_BYTES = 1 << 20
"""1 MiB: 2 to 3 % of a core at 9 MB/s, and a viewer loads little more than what it shows."""
U32 = 0xFFFFFFFF


@functools.cache
def _schema_bytes(described: Topic) -> bytes:
    """Read once: a file that begins later must not depend on what was installed meanwhile."""
    return described.schema_bytes()


class _Tail:
    """Unbuffered end of a file: what was written is with the kernel, and an error leaves the offset known."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.offset = 0

    def write(self, data: bytes) -> int:
        view = memoryview(data)
        while view:
            written = os.write(self._descriptor, view)
            self.offset += written
            view = view[written:]
        return len(data)

    def tell(self) -> int:
        return self.offset

    def flush(self) -> None:
        """Nothing waits here."""


class McapFile:
    """Writes one file; every method may raise ``OSError`` when the disk refuses.

    After an ``OSError`` only :meth:`abandon` makes sense.

    Parameters
    ----------
    path : Path
        Final name, ending ``.mcap``.
    run : RunInfo
        Goes to the file's head.
    t_ns : int
        Time of the attachments, ns since the epoch.
    """

    def __init__(self, path: Path, run: RunInfo, t_ns: int) -> None:
        self.path = path
        self.active = path.with_name(path.name + ACTIVE)
        self._run = run
        self._t_ns = t_ns
        self._descriptor = -1
        self._channels: dict[str, int] = {}
        self._named = False
        self.good = 0
        """Offset behind the last closed chunk, bytes."""
        self.unflushed = 0
        """Payload bytes in the open chunk."""

    def open(self) -> None:
        """Create the file and write what says who wrote it."""
        self._descriptor = os.open(self.active, os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_CLOEXEC, 0o640)
        fcntl.flock(self._descriptor, fcntl.LOCK_EX)
        self._tail = _Tail(self._descriptor)
        self._writer = Writer(
            cast("IO[Any]", self._tail), chunk_size=CHUNK_BYTES, compression=CompressionType.NONE, use_chunking=True
        )
        self._writer.start(profile="", library=f"ptzd {__version__}")
        self._writer.add_metadata(METADATA, self._run.metadata())
        for name, text in ((CONFIG, self._run.config_text), (CALIBRATION, self._run.calibration_text)):
            self._writer.add_attachment(self._t_ns, self._t_ns, name, "application/yaml", text.encode())
        self._describe()
        self.good = self._tail.offset

    def _describe(self) -> None:
        """Tell the writer of every topic, and write it down before the first chunk."""
        records = RecordBuilder()
        schemas: dict[str, int] = {}
        for name, described in TOPICS.items():
            encoding, data = described.schema_encoding, _schema_bytes(described)
            if described.schema not in schemas:
                schema_id = self._writer.register_schema(described.schema, encoding, data)
                schemas[described.schema] = schema_id
                Schema(id=schema_id, name=described.schema, encoding=encoding, data=data).write(records)
            schema_id = schemas[described.schema]
            channel_id = self._writer.register_channel(name, described.encoding, schema_id)
            self._channels[name] = channel_id
            Channel(
                id=channel_id, topic=name, message_encoding=described.encoding, schema_id=schema_id, metadata={}
            ).write(records)
        self._tail.write(records.end())  # type: ignore[no-untyped-call]

    @property
    def size(self) -> int:
        """Bytes written and waiting in the open chunk."""
        return self.good + self.unflushed

    def add(self, topic: str, log_ns: int, publish_ns: int, sequence: int, data: bytes) -> None:
        """Append one message; the chunk closes when it is full."""
        before = self._tail.offset
        channel = self._channels[find_topic(topic).name]
        self._writer.add_message(channel, log_ns, data, publish_ns, sequence & U32)
        self.unflushed += len(data)
        if self._tail.offset != before:
            self._mark_good()

    def _mark_good(self) -> None:
        self.good = self._tail.offset
        self.unflushed = 0

    def flush(self) -> None:
        """Close the chunk in progress: what was added is readable after a crash of the process."""
        self._writer.flush()  # type: ignore[no-untyped-call]
        self._mark_good()

    def sync(self) -> None:
        """Ask the disk to keep what is closed: it survives a power cut."""
        os.fdatasync(self._descriptor)
        if not self._named:
            self._sync_directory()
            self._named = True

    def conclude(self) -> None:
        """Close the last chunk and write the summary; nothing can be added any more."""
        self._writer.finish()  # type: ignore[no-untyped-call]

    def seal(self) -> None:
        """Bring all of a concluded file to the disk and give it its final name."""
        os.fsync(self._descriptor)
        self.active.rename(self.path)
        self.close()
        self._sync_directory()

    def finish(self) -> None:
        """Conclude and seal."""
        self.conclude()
        self.seal()

    def cut_back(self) -> None:
        """Cut the file behind its last good chunk; recovery adds the summary."""
        os.ftruncate(self._descriptor, self.good)

    def abandon(self) -> None:
        """Cut back and close."""
        if self._descriptor < 0:
            return
        try:
            self.cut_back()
        finally:
            self.close()

    def close(self) -> None:
        """Let the file go as it is; again is harmless."""
        if self._descriptor >= 0:
            descriptor, self._descriptor = self._descriptor, -1
            os.close(descriptor)

    def _sync_directory(self) -> None:
        directory = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
