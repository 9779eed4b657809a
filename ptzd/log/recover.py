"""Make a torn file whole again: keep every whole record, cut the torn end, write the summary that was never written.

In place, because the reason for a torn file is often a full disk, and because a GiB is then read once and not copied. A
chunk whose checksum does not agree, and a stretch in which no record can be found, is turned into a private record
(opcode 0x80), which every reader passes over; its bytes stay. Only an end is cut, and one that is more than the
beginning of a record goes to a file beside it (``.cut``) before.
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
from ptzd.log.resync import torn_record
from ptzd.log.summary import Survey, survey

CUT = ".cut"
"""What the name of an end ends with that was cut and kept; ptzd never deletes it."""
_BLOCK = 4 << 20
_PLACES = 5
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
    parts_lost: int
    """Chunks with a wrong checksum and stretches without a record, now passed over."""
    note: str
    """One line for a person."""


def recover(path: Path) -> Recovery:
    """Make one file readable; a whole one is only checked.

    Raises
    ------
    LogError
        No MCAP file, being written by a running daemon, or the disk refuses; the file is then as it was.
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
            aside = None if found.torn is None else _set_aside(path, file, found.torn)
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
    return _report(final, found, size, aside)


def _set_aside(path: Path, file: RecordFile, torn: int) -> Path | None:
    """Keep the end that will be cut, if it may hold more than a writer's last record; the path of the copy."""
    if torn_record(file, torn):
        return None
    aside = path.with_name(f"{path.name.removesuffix(ACTIVE)}.{torn}{CUT}")
    if aside.exists() and not _begins_with(file, torn, aside):
        raise LogError(f"{path}: {aside.name} exists; move it away, the end of this file goes there")
    try:
        with aside.open("wb") as copy:
            for start in range(torn, file.size, _BLOCK):
                copy.write(file.read(start, _BLOCK))
            copy.flush()
            os.fsync(copy.fileno())
    except OSError as error:
        aside.unlink(missing_ok=True)
        raise LogError(
            f"{path}: left as it is: the {file.size - torn} bytes from byte {torn} are damaged and cannot be kept "
            f"beside it: {error.strerror}; make room"
        ) from None
    return aside


def _begins_with(file: RecordFile, torn: int, aside: Path) -> bool:
    """Whether a copy holds this end or its beginning, as a recovery leaves it that was stopped itself."""
    if aside.is_symlink() or not aside.is_file():
        return False
    with aside.open("rb") as copy:
        at = torn
        while held := copy.read(_BLOCK):
            if held != file.read(at, len(held)):
                return False
            at += len(held)
    return True


def _mend(descriptor: int, found: Survey) -> None:
    for frame in found.damaged:
        os.pwrite(descriptor, bytes([PASSED_OVER]) + frame.length.to_bytes(8, "little"), frame.start)
    os.ftruncate(descriptor, found.good)
    data = memoryview(found.closing_records())
    at = found.good
    while data:
        written = os.pwrite(descriptor, data, at)
        at += written
        data = data[written:]
    os.fsync(descriptor)


def _report(path: Path, found: Survey, size: int, aside: Path | None) -> Recovery:
    cut = 0 if found.whole else size - found.good
    note = "whole" if found.whole else f"{found.messages} messages kept, {cut} bytes cut ({found.reason})"
    if aside is not None:
        note += f" and kept in {aside.name}"
    if found.damaged:
        places = ", ".join(f"{frame.start} to {frame.end - 1}" for frame in found.damaged[:_PLACES])
        more = f" and {len(found.damaged) - _PLACES} more" if len(found.damaged) > _PLACES else ""
        note += f", {len(found.damaged)} damaged parts passed over: bytes {places}{more}"
    return Recovery(
        path=path,
        messages=found.messages,
        bytes_kept=found.good,
        bytes_cut=cut,
        parts_lost=len(found.damaged),
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
