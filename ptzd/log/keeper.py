"""The log's second thread: all that waits for the disk, so that writing never does.

A write ends in the kernel's cache, which outlives the process. Syncing, closing, deleting and mending files end on the
disk, and a slow one takes a second and more for that.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue

from ptzd.config import LogSettings
from ptzd.errors import LogError
from ptzd.log import retention
from ptzd.log.file import McapFile
from ptzd.log.notes import Level
from ptzd.log.recover import recover
from ptzd.ports import Clock

LOGGER = logging.getLogger(__name__)

Errand = Callable[[], None]
PATIENCE_S = 0.5
"""How soon a wait notices that the thread has ended."""


class Keeper:
    """Runs errands one after the other; every method but those that say so returns at once.

    Parameters
    ----------
    directory : Path
        Of the log.
    rig : str
        Whose files are deleted when there are too many.
    clock : Clock
        For the age of files.
    """

    def __init__(self, directory: Path, rig: str, clock: Clock) -> None:
        self._directory = directory
        self._rig = rig
        self._clock = clock
        self._errands: SimpleQueue[Errand | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="ptzd-log-disk")
        self._unsynced_s: float | None = None
        self.torn: deque[Path] = deque()
        """Files without their summary."""
        self.refused: deque[tuple[McapFile, OSError]] = deque()
        """Files that the disk would not keep; for the thread that writes."""
        self.notes: deque[tuple[Level, str]] = deque()
        """What the log is to say about this; for the thread that writes."""
        self.ended = False
        self._doubted = False

    def start(self) -> None:
        """Begin to run errands."""
        self._thread.start()

    def end(self) -> None:
        """Run what waits, then no more; waits for that."""
        self._errands.put(None)
        self._thread.join()

    def wait(self) -> None:
        """Wait until all errands so far are done, or none will be any more."""
        done = threading.Event()
        self._errands.put(done.set)
        while not done.wait(PATIENCE_S) and not self.ended:
            pass

    def call(self, done: Errand) -> None:
        """Call back, in the keeper's thread, when all errands so far are done."""
        self._errands.put(done)

    @property
    def unsynced_s(self) -> float:
        """How long a sync has been waiting for the disk, s; 0 when none is under way."""
        since_s = self._unsynced_s
        return 0.0 if since_s is None else time.monotonic() - since_s

    def sync(self, file: McapFile) -> None:
        """Bring to the disk what is closed; one that is under way is not asked again."""
        if self._unsynced_s is None:
            self._unsynced_s = time.monotonic()
            self._errands.put(lambda: self._sync(file))

    def seal(self, file: McapFile) -> None:
        """Bring a concluded file to the disk and give it its final name."""
        self._errands.put(lambda: self._seal(file))

    def give_up(self, file: McapFile) -> None:
        """Close a file that cannot be written on; it is torn now."""
        self._errands.put(lambda: self._give_up(file))

    def mend(self) -> None:
        """Give torn files their summary."""
        self._errands.put(self._mend)

    def retain(self, settings: LogSettings, open_bytes: int) -> None:
        """Delete what is too much, too old, or in the way; ``open_bytes`` is the size of the file being written."""
        self._errands.put(lambda: self.retain_now(settings, open_bytes))

    def _run(self) -> None:
        try:
            while (errand := self._errands.get()) is not None:
                errand()
        finally:
            self.ended = True

    def _sync(self, file: McapFile) -> None:
        try:
            file.sync()
        except OSError as error:
            self.refused.append((file, error))
        self._unsynced_s = None

    def _seal(self, file: McapFile) -> None:
        try:
            file.seal()
        except OSError as error:
            self.notes.append((Level.WARNING, f"{file.active.name}: cannot be closed: {error.strerror or error}"))
            self._give_up(file)

    def _give_up(self, file: McapFile) -> None:
        with contextlib.suppress(OSError):
            file.close()
        if file.active.exists():
            self.torn.append(file.active)

    def _mend(self) -> None:
        while self.torn:
            try:
                report = recover(self.torn.popleft())
            except LogError as error:
                self.notes.append((Level.WARNING, str(error)))
            else:
                self.notes.append((Level.INFO, f"{report.path.name}: recovered: {report.note}"))

    def retain_now(self, settings: LogSettings, open_bytes: int) -> None:
        """The same in the caller's thread."""
        try:
            files = retention.closed_files(self._directory, self._rig)
            free = retention.free_bytes(self._directory)
            now_s = self._clock.now_ns() / retention.NS
            doomed = retention.surplus(files, settings, free=free, open_bytes=open_bytes, now_s=now_s)
            for gone in doomed:
                gone.stored.path.unlink(missing_ok=True)
                self.notes.append((Level.INFO, str(gone)))
                LOGGER.info("%s", gone)
            doubt = retention.doubt(files, settings, now_s)
            if doubt and not self._doubted:
                self.notes.append((Level.WARNING, doubt))
                LOGGER.warning("%s", doubt)
            self._doubted = bool(doubt)
        except OSError as error:
            self.notes.append((Level.WARNING, f"{self._directory}: old files stay: {error.strerror or error}"))
