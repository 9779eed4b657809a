"""One MCAP file that is being written: ``NAME.mcap.active`` until it is whole, then ``NAME.mcap``."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
from typing import IO, Any, cast

from mcap.writer import CompressionType, Writer

from ptzd import __version__
from ptzd.log.run import CALIBRATION, CONFIG, METADATA, RunInfo
from ptzd.log.topics import topic as find_topic

ACTIVE = ".active"
CHUNK_BYTES = 1 << 20
"""1 MiB: 2 to 3 % of a core at 9 MB/s, and a viewer loads little more than what it shows."""
U32 = 0xFFFFFFFF


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
        self._schemas: dict[str, int] = {}
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
        self.good = self._tail.offset

    @property
    def size(self) -> int:
        """Bytes written and waiting in the open chunk."""
        return self.good + self.unflushed

    def add(self, topic: str, log_ns: int, publish_ns: int, sequence: int, data: bytes) -> None:
        """Append one message; the chunk closes when it is full."""
        before = self._tail.offset
        channel = self._channels.get(topic)
        if channel is None:
            channel = self._register(topic)
        self._writer.add_message(channel, log_ns, data, publish_ns, sequence & U32)
        self.unflushed += len(data)
        if self._tail.offset != before:
            self._mark_good()

    def _register(self, name: str) -> int:
        described = find_topic(name)
        if described.schema not in self._schemas:
            self._schemas[described.schema] = self._writer.register_schema(
                described.schema, described.schema_encoding, described.schema_bytes()
            )
        channel = self._writer.register_channel(name, described.encoding, self._schemas[described.schema])
        self._channels[name] = channel
        return channel

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

    def finish(self) -> None:
        """Write the summary, bring all of it to the disk, give the file its final name."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        os.fsync(self._descriptor)
        self.active.rename(self.path)
        self._close()
        directory = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)

    def abandon(self) -> None:
        """Cut the file behind its last good chunk and let it go; recovery adds the summary."""
        if self._descriptor < 0:
            return
        try:
            os.ftruncate(self._descriptor, self.good)
        finally:
            self._close()

    def _close(self) -> None:
        os.close(self._descriptor)
        self._descriptor = -1
