"""Make a torn file whole again: keep every whole record, cut the rest, write the summary that was never written.

In place, because the reason for a torn file is often a full disk, and because a GiB is then read once and not copied. A
chunk whose checksum does not agree is turned into a private record (opcode 0x80), which every reader passes over.
"""

from __future__ import annotations

import errno
import fcntl
import os
import stat
from dataclasses import dataclass
from pathlib import Path

from ptzd.errors import LogError
from ptzd.log.file import ACTIVE
from ptzd.log.records import MAGIC, PASSED_OVER, RecordFile
from ptzd.log.summary import Survey, survey

_SMALLEST = len(MAGIC) + 9
"""Magic and the head of one record, bytes: below it there is nothing to keep."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Recovery:
    """What became of one file."""

    path: Path
    """Its present name."""
    messages: int
    """Readable messages in it."""
    bytes_kept: int
    bytes_cut: int
    """Behind the last whole record."""
    chunks_lost: int
    """Whole chunks with a wrong checksum, now passed over."""
    note: str
    """One line for a person."""


def recover(path: Path) -> Recovery:
    """Make one file readable; a whole one is only checked.

    Raises
    ------
    LogError
        No MCAP file, being written by a running daemon, or the disk refuses.
    """
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError as error:
        if error.errno == errno.ELOOP:
            raise LogError(f"{path}: is a link; a recovery mends files where they are, name the file itself") from None
        raise LogError(f"{path}: cannot be opened for recovery: {error.strerror}") from None
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LogError(f"{path}: is being written by a running daemon; ask it to rotate instead") from None
        with RecordFile(path) as file:
            found = survey(file)
            if not found.whole:
                _mend(descriptor, found)
            size = file.size
        final = path.with_name(path.name.removesuffix(ACTIVE))
        if final != path:
            if final.exists():
                raise LogError(f"{path}: {final.name} exists as well; move one of them away")
            path.rename(final)
    except OSError as error:
        raise LogError(f"{path}: the disk refuses the recovery: {error.strerror}") from None
    finally:
        os.close(descriptor)
    return _report(final, found, size)


def _mend(descriptor: int, found: Survey) -> None:
    for start in found.damaged:
        os.pwrite(descriptor, bytes([PASSED_OVER]), start)
    os.ftruncate(descriptor, found.good)
    data = memoryview(found.closing_records())
    at = found.good
    while data:
        written = os.pwrite(descriptor, data, at)
        at += written
        data = data[written:]
    os.fsync(descriptor)


def _report(path: Path, found: Survey, size: int) -> Recovery:
    cut = 0 if found.whole else size - found.good
    note = "whole" if found.whole else f"{found.messages} messages kept, {cut} bytes cut ({found.reason})"
    if found.damaged:
        note += f", {len(found.damaged)} damaged chunks passed over"
    return Recovery(
        path=path,
        messages=found.messages,
        bytes_kept=found.good,
        bytes_cut=cut,
        chunks_lost=len(found.damaged),
        note=note,
    )


def recover_directory(directory: Path) -> list[str]:
    """Recover every file that a crash left behind; one line for a person on each.

    Files being written by another daemon are left alone; so are those that cannot be recovered, with the reason.
    """
    lines = []
    for path in sorted(directory.glob(f"*.mcap{ACTIVE}")):
        try:
            if not stat.S_ISREG(path.lstat().st_mode):
                lines.append(f"{path.name}: no file of its own; left alone")
                continue
            if path.lstat().st_size < _SMALLEST:
                path.unlink()
                lines.append(f"{path.name}: empty after a crash; removed")
                continue
            report = recover(path)
        except LogError as error:
            lines.append(str(error))
        else:
            lines.append(f"{report.path.name}: recovered: {report.note}")
    return lines
