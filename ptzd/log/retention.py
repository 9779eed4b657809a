"""Which closed files have to go: too many bytes, too old, or too little room left on the disk."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from ptzd.config import LogSettings

RESERVE_BYTES = 8 << 20
"""Room kept for decisions, about a day of them: below it no picture is written, whatever the settings say."""
NS = 1_000_000_000
_DAY_S = 86_400.0
_NAME = re.compile(r"^(?P<rig>.+)-(?P<start>\d{8}T\d{6}Z)-(?P<index>\d{3,})\.mcap$")


@dataclass(frozen=True, slots=True, kw_only=True)
class Stored:
    """A closed file of the log."""

    path: Path
    size: int
    """Bytes."""
    t_s: float
    """Time of its last byte, s since the epoch."""


def file_name(rig: str, t_ns: int, index: int) -> str:
    """Name of a log file, e.g. ``yard-20261121T231502Z-000.mcap``."""
    return f"{rig}-{datetime.fromtimestamp(t_ns // NS, UTC):%Y%m%dT%H%M%SZ}-{index:03d}.mcap"


def closed_files(directory: Path, rig: str) -> list[Stored]:
    """Closed files of this rig, oldest first; names of another make are not ours, nor is what a link leads to."""
    found = []
    for path in directory.glob("*.mcap"):
        named = _NAME.match(path.name)
        if named and named["rig"] == rig and not path.is_symlink():
            try:
                status = path.stat()
            except FileNotFoundError:
                continue
            order = (named["start"], int(named["index"]))
            found.append((order, Stored(path=path, size=status.st_size, t_s=status.st_mtime)))
    return [stored for _, stored in sorted(found, key=lambda item: item[0])]


def free_bytes(directory: Path) -> int:
    """Room that a process without privileges may still use."""
    status = os.statvfs(directory)
    return status.f_bavail * status.f_frsize


def wanted_free_bytes(settings: LogSettings) -> int:
    """Room below which pictures stop."""
    return max(settings.min_free_bytes, RESERVE_BYTES)


LEAP_S = _DAY_S
"""A longer silence between two files, or between the last one and now, is a rig that was off, or a clock that leapt."""
CONFIRMED_S = _DAY_S
"""A clock that has led on for so long since its last leap is believed."""
FUTURE_S = 3600.0
"""Files from later than this after now: the clock went back."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Doomed:
    """A file to delete."""

    stored: Stored
    reason: str
    """The setting that asks for it, with its value."""

    def __str__(self) -> str:
        return f"{self.stored.path.name} ({self.stored.size / 1e6:.0f} MB) deleted: {self.reason}"


def surplus(
    files: Sequence[Stored], settings: LogSettings, *, free: int, open_bytes: int, now_s: float
) -> list[Doomed]:
    """Files to delete, oldest first.

    Parameters
    ----------
    files : sequence of Stored
        Closed files, oldest first.
    settings : LogSettings
        ``keep_bytes`` (with the open file's), ``keep_days``, ``min_free_bytes``.
    free : int
        Room on the disk now, bytes.
    open_bytes : int
        Size of the file being written.
    now_s : float
        S since the epoch.
    """
    total = open_bytes + sum(stored.size for stored in files)
    wanted = wanted_free_bytes(settings)
    oldest_s = now_s - settings.keep_days * _DAY_S
    by_age_s = believed_from_s(files, now_s)
    doomed = []
    for stored in files:
        if total > settings.keep_bytes:
            reason = f"the log is larger than log.keep_bytes, {settings.keep_bytes / 1e9:.1f} GB"
        elif free < wanted:
            reason = f"less than {wanted / 1e9:.1f} GB is free on the disk (log.min_free_bytes)"
        elif stored.t_s < oldest_s and stored.t_s >= by_age_s:
            reason = f"older than log.keep_days, {settings.keep_days:g}"
        else:
            break
        doomed.append(Doomed(stored=stored, reason=reason))
        total -= stored.size
        free += stored.size
    return doomed


def believed_from_s(files: Sequence[Stored], now_s: float) -> float:
    """Time of the oldest file whose age the clock can tell, s since the epoch; infinite when it can tell none.

    The files' own times lead up to now. Behind a leap of more than `LEAP_S` ages are believed only when the clock has
    gone on for `CONFIRMED_S` since, so that one start with a wrong clock deletes nothing.
    """
    if any(stored.t_s > now_s + FUTURE_S for stored in files):
        return math.inf
    since_s = now_s
    for stored in reversed(files):
        if since_s - stored.t_s > LEAP_S:
            return -math.inf if now_s - since_s >= CONFIRMED_S else since_s
        since_s = min(since_s, stored.t_s)
    return -math.inf


def doubt(files: Sequence[Stored], settings: LogSettings, now_s: float) -> str:
    """Why files that the clock calls too old are kept; empty when none are."""
    from_s = believed_from_s(files, now_s)
    oldest_s = now_s - settings.keep_days * _DAY_S
    kept = [stored for stored in files if stored.t_s < min(oldest_s, from_s) or stored.t_s > now_s + FUTURE_S]
    if not kept or from_s == -math.inf:
        return ""
    newest = max(stored.t_s for stored in files)
    days = (now_s - newest) / _DAY_S
    where = f"{days:.1f} days after" if days > 0 else f"{-days:.1f} days before"
    return (
        f"the clock is {where} the newest file of the log: nothing is deleted by age (log.keep_days) until it has gone "
        f"on for a day; {len(kept)} files stay. If it is wrong, set it right"
    )
