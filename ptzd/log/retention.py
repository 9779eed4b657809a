"""Which closed files have to go: too many bytes, too old, or too little room left on the disk."""

from __future__ import annotations

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
    """Closed files of this rig, oldest first; names of another make are not ours."""
    found = []
    for path in directory.glob("*.mcap"):
        named = _NAME.match(path.name)
        if named and named["rig"] == rig:
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


def surplus(
    files: Sequence[Stored], settings: LogSettings, *, free: int, open_bytes: int, now_s: float
) -> list[Stored]:
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
    doomed = []
    for stored in files:
        if total <= settings.keep_bytes and free >= wanted and stored.t_s >= oldest_s:
            break
        doomed.append(stored)
        total -= stored.size
        free += stored.size
    return doomed
