"""The writer's thread: takes records from the inbox, owns the open file, and keeps going when the disk does not.

It never waits for the disk to confirm anything: that is the keeper's, in a thread of its own.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from ptzd.config import LogSettings
from ptzd.control.commands import Command
from ptzd.control.events import Event, Snapshot
from ptzd.errors import PtzdError
from ptzd.log import retention
from ptzd.log.file import McapFile
from ptzd.log.inbox import Adopt, Cut, End, Inbox, Record, Settle
from ptzd.log.keeper import Keeper
from ptzd.log.notes import Level, log_message
from ptzd.log.protobuf import CompressedImage
from ptzd.log.run_info import RunInfo
from ptzd.ports import Clock

CHUNK_S = 0.25
"""A record outlives the process this long after it came; promised are 0.5 s, the rest is for a busy machine."""
SYNC_S = 1.0
"""A record outlives a power cut this long after its chunk was closed, if the disk is as quick."""
LATE_SYNC_S = 10.0
"""A sync that takes longer is told."""
RETENTION_S = 60.0
MAX_HELD = 100_000
"""Decisions kept in memory while there is no file to write to, about a quarter of an hour."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A JSON message for viewers, derived from events and commands."""

    topic: str
    publish_ns: int
    body: dict[str, object]


Illustrate = Callable[[int, Event | Command], Iterable[Document]]
"""From the time of a decision and the decision to documents for people; kept by the writer's thread alone."""


def nothing(t_ns: int, source: Event | Command) -> Iterable[Document]:
    """No illustration."""
    return ()


@dataclass(slots=True)
class Counters:
    """Written by the thread, read by anybody."""

    messages: int = 0
    """Given to a file; those that a failing disk took are given to the next one and count again."""
    pictures: int = 0
    pictures_dropped: int = 0
    """Not written because the disk had no room."""
    decisions_lost: int = 0
    """Given up after :data:`MAX_HELD` waited in vain for a disk."""
    bytes: int = 0
    """Payload, of all files."""
    files: int = 0


class Scribe:
    """Runs in one thread from :meth:`open` to the end of :meth:`run`.

    Parameters
    ----------
    settings : LogSettings
        Directory, rotation, retention.
    run : RunInfo
        Goes to the head of every file.
    clock : Clock
        For file names and messages of its own.
    inbox : Inbox
        Where records come from.
    illustrate : Illustrate
        Makes documents for viewers out of decisions.
    """

    def __init__(
        self, settings: LogSettings, run: RunInfo, clock: Clock, inbox: Inbox, illustrate: Illustrate = nothing
    ) -> None:
        self._settings = settings
        self._run = run
        self._clock = clock
        self._inbox = inbox
        self._illustrate = illustrate
        self._directory = Path(settings.directory)
        self._keeper = Keeper(self._directory, run.rig, clock)
        self._file: McapFile | None = None
        self._held: list[Record] = []
        self._opened_s = self._flushed_s = self._synced_s = self._retained_s = 0.0
        self._room = True
        self._low = False
        self._decisions = 0
        self._reported = (0, "")
        self.counters = Counters()
        self.degraded = ""
        """Why not everything is written; empty when it is."""
        self.headless = True
        """The current file does not begin with a snapshot."""
        self.snapshots = 0
        """How many snapshots were taken from the inbox."""
        self._ended = False
        self.beats = 0
        """Turns of the thread: changes at least every :data:`SYNC_S` while it lives, whatever the disk does."""

    @property
    def ended(self) -> bool:
        """Nothing is written any more."""
        return self._ended or self._keeper.ended

    @property
    def current(self) -> Path | None:
        """Final name of the file being written."""
        file = self._file
        return file.path if file else None

    @property
    def size(self) -> int:
        """Of the file being written, bytes."""
        file = self._file
        return file.size if file else 0

    @property
    def age_s(self) -> float:
        """Of the file being written, s."""
        return time.monotonic() - self._opened_s

    def make_room(self) -> None:
        """Delete old files before anything is written; for a start on a disk that is full."""
        self._keeper.retain_now(self._settings, 0)

    def open(self) -> None:
        """Begin a file.

        Raises
        ------
        OSError
            The disk refuses.
        """
        t_ns = self._clock.now_ns()
        while True:
            path = self._directory / retention.file_name(self._run.rig, t_ns, self.counters.files)
            run = replace(self._run, file_index=self.counters.files)
            self.counters.files += 1
            if not path.exists():
                break
        file = McapFile(path, run, t_ns)
        try:
            file.open()
        except OSError:
            with contextlib.suppress(OSError):
                file.abandon()
            file.active.unlink(missing_ok=True)
            raise
        self._file = file
        self.headless = True
        self._decisions = 0
        self._opened_s = self._flushed_s = self._synced_s = time.monotonic()

    def run(self) -> None:
        """Write until the inbox says that nothing more comes."""
        self._keeper.start()
        try:
            while not isinstance(item := self._inbox.take(self._patience_s()), End):
                if isinstance(item, Record):
                    self._take(item)
                elif isinstance(item, Cut):
                    self._cut()
                elif isinstance(item, Adopt):
                    self._settings, self._run = item.settings, item.run
                elif isinstance(item, Settle):
                    self._settle(item)
                self._tend()
                self.beats += 1
            self._end()
        finally:
            self._ended = True
            self._keeper.end()

    def _patience_s(self) -> float:
        due_s = self._flushed_s + CHUNK_S if self._held and self._file else self._synced_s + SYNC_S
        return max(0.0, due_s - time.monotonic())

    def _take(self, record: Record) -> None:
        if record.droppable and not (self._room and self._file):
            self.counters.pictures_dropped += 1
            return
        if not self._held:
            self._flushed_s = time.monotonic()
        self._write(record)
        self.snapshots += isinstance(record.source, Snapshot)
        if record.source is not None:
            for document in self._derived(record):
                self._write(document)

    def _derived(self, record: Record) -> list[Record]:
        assert record.source is not None
        try:
            documents = list(self._illustrate(record.log_ns, record.source))
        except PtzdError as error:
            documents = [Document(topic="/log", publish_ns=record.log_ns, body=self._says(Level.WARNING, str(error)))]
        return [
            Record(
                topic=document.topic,
                log_ns=record.log_ns,
                publish_ns=document.publish_ns,
                sequence=record.sequence,
                data=msgspec.json.encode(document.body),
            )
            for document in documents
        ]

    def _write(self, record: Record) -> None:
        self._held.append(record)
        if self._file is None:
            self._limit_held()
            return
        payload = record.payload()
        good = self._file.good
        try:
            self._file.add(record.topic, record.log_ns, record.publish_ns, record.sequence, payload)
        except OSError as error:
            self._fail(error)
            return
        if record.source is not None:
            self.headless = self.headless and not (self._decisions == 0 and isinstance(record.source, Snapshot))
            self._decisions += 1
        self.counters.messages += 1
        self.counters.pictures += isinstance(record.data, CompressedImage)
        self.counters.bytes += len(payload)
        if self._file.good != good:
            self._kept()

    def _kept(self) -> None:
        """Everything taken so far is in a closed chunk."""
        self._held.clear()
        self._flushed_s = time.monotonic()

    def _limit_held(self) -> None:
        excess = len(self._held) - MAX_HELD
        if excess > 0:
            del self._held[:excess]
            self.counters.decisions_lost += excess

    def _tend(self) -> None:
        now_s = time.monotonic()
        try:
            if self._file and self._held and now_s - self._flushed_s >= CHUNK_S:
                self._file.flush()
                self._kept()
            self._hear()
            if now_s - self._synced_s >= SYNC_S:
                self._synced_s = now_s
                if self._file:
                    self._keeper.sync(self._file)
                self._look_at_disk(now_s)
        except OSError as error:
            self._fail(error)

    def _hear(self) -> None:
        """Take on what the keeper found out."""
        while self._keeper.refused:
            file, error = self._keeper.refused.popleft()
            if file is self._file:
                self._fail(error)
            else:
                self.say(Level.WARNING, f"{file.path.name}: the disk refused a sync: {error.strerror or error}")
        while self._keeper.notes:
            self.say(*self._keeper.notes.popleft())

    def _look_at_disk(self, now_s: float) -> None:
        """Below the wanted room the oldest files go, and if that does not help until the next look, pictures."""
        free = retention.free_bytes(self._directory)
        wanted = retention.wanted_free_bytes(self._settings)
        low = free < wanted
        if low or now_s - self._retained_s >= RETENTION_S:
            self._keeper.retain(self._settings, self.size)
            self._retained_s = now_s
        self._room = not low or (self._room and not self._low)
        self._low = low
        if self._file is None:
            self._reopen()
        if self._room and self._file and self._keeper.torn:
            self._keeper.mend()
        if self._file:
            self.degraded = self._complaint(free, wanted)
        self._report()

    def _complaint(self, free: int, wanted: int) -> str:
        if not self._room:
            return f"no pictures are kept: {free >> 20} MiB free, {wanted >> 20} wanted"
        if self._keeper.unsynced_s > LATE_SYNC_S:
            return f"the disk has confirmed nothing for more than {LATE_SYNC_S:g} s"
        return ""

    def _report(self) -> None:
        """Tell the reader of the log what it does not hold."""
        state = (self.counters.pictures_dropped, self.degraded)
        if self._file is None or state == self._reported:
            return
        text = self.degraded or "all is written again"
        if state[0] != self._reported[0]:
            text = f"{state[0] - self._reported[0]} pictures dropped; {text}"
        self._reported = state
        self.say(Level.WARNING if self.degraded else Level.INFO, text)

    def say(self, level: Level, text: str) -> None:
        """Write a line of the writer's own to ``/log``."""
        t_ns = self._clock.now_ns()
        body = msgspec.json.encode(self._says(level, text, t_ns))
        self._write(Record(topic="/log", log_ns=t_ns, publish_ns=t_ns, sequence=0, data=body))

    def _says(self, level: Level, text: str, t_ns: int | None = None) -> dict[str, object]:
        return log_message(self._clock.now_ns() if t_ns is None else t_ns, level, "ptzd.log", text)

    def _fail(self, error: OSError) -> None:
        """The file cannot be written on: cut it behind its last good chunk and go on in a new one."""
        self.degraded = f"the log cannot be written: {error.strerror or error}"
        self._room = False
        if self._file is None:
            return
        with contextlib.suppress(OSError):
            self._file.cut_back()
        self._keeper.give_up(self._file)
        self._file = None
        kept = [record for record in self._held if not record.droppable]
        self.counters.pictures_dropped += len(self._held) - len(kept)
        self._held = kept
        self._limit_held()

    def _reopen(self) -> None:
        """Begin a new file with the records that the old one lost; without room for those, later."""
        waiting = sum(len(record.payload()) for record in self._held)
        if retention.free_bytes(self._directory) < waiting + (1 << 20):
            return
        self.open()
        held, self._held = self._held, []
        for at, record in enumerate(held):
            self._write(record)
            if self._file is None:
                self._held.extend(held[at + 1 :])
                return

    def _settle(self, item: Settle) -> None:
        try:
            if self._file and self._held:
                self._file.flush()
                self._kept()
        except OSError as error:
            self._fail(error)
        self._keeper.call(item.done)

    def _cut(self) -> None:
        if self._file is None or self._decisions == 0:
            return
        try:
            self._finish(self._file)
            self.open()
            self._keeper.retain(self._settings, self.size)
        except OSError as error:
            self._fail(error)

    def _end(self) -> None:
        try:
            if self._file is None:
                self._reopen()
            self._keeper.mend()
            self._keeper.wait()
            self._hear()
            if self._file:
                self._finish(self._file)
        except OSError as error:
            self._fail(error)

    def _finish(self, file: McapFile) -> None:
        """Close the last chunk first: a summary that finds no room costs no records."""
        file.flush()
        self._kept()
        file.conclude()
        self._keeper.seal(file)
        self._file = None
