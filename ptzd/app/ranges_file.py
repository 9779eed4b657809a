"""What locks have taught of the scene's ranges, kept over restarts in a file beside the log.

The file belongs to one rig and one calibration, whose digest stands in its name: ranges measured with another one are
not used, and are there again when that one is.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec

from ptzd.app.kept import KeptFile, put_aside
from ptzd.config import Config
from ptzd.control.planning.ranges import HOUR_NS, MOST_LOCKS, RangeLock, RangeMap
from ptzd.documents import read_regular

EVERY_S = 5.0
"""What a crash may lose."""
CLOCK_SLACK_NS = 60_000_000_000
"""A file from this little after now is none from the future: clocks are set by seconds all the time."""

_log = logging.getLogger(__name__)


class _Document(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    ptzd_ranges: Literal[1]
    calibration_sha256: str
    saved_ns: int
    locks: list[RangeLock]


def digest_of(calibration_text: str) -> str:
    """What names a calibration."""
    return hashlib.sha256(calibration_text.encode()).hexdigest()


def ranges_path(config: Config, digest: str) -> Path:
    """Where the map of this calibration lies."""
    return Path(config.log.directory) / f"{config.rig}-ranges-{digest[:12]}.json"


def read_ranges(config: Config, digest: str, now_ns: int) -> RangeMap:
    """What is kept for this calibration; an empty map where nothing is.

    A damaged file is put aside and said in the journal. How long the daemon was away counts for the age of what is
    known, but never more than one half-life: a clock that was set, or was wrong, empties no map.
    """
    path = ranges_path(config, digest)
    try:
        document = msgspec.json.decode(read_regular(path), type=_Document)
        _check(document, digest)
    except FileNotFoundError:
        _tell_others(path)
        return RangeMap()
    except (OSError, ValueError) as error:  # msgspec's errors are ValueErrors
        why = " ".join(str(error).split())
        _log.warning("%s cannot be used (%s): ranges are learned anew; %s", path, why, put_aside(path))
        return RangeMap()
    _log.info("%d lock(s) tell the scene's ranges (%s)", len(document.locks), path)
    return RangeMap(locks=_brought_to(document, now_ns, config.ranges.half_life_h))


def _check(document: _Document, digest: str) -> None:
    if document.calibration_sha256 != digest:
        raise ValueError("it was learned with another calibration")
    if len(document.locks) > MOST_LOCKS:
        raise ValueError(f"{len(document.locks)} locks, at most {MOST_LOCKS} are kept")
    for lock in document.locks:
        if abs(math.hypot(*lock.ray) - 1.0) > 1e-6:
            raise ValueError(f"lock {lock.id}: its ray {lock.ray} is no direction of length 1")
        if lock.inverse_range < 0.0 or lock.sigma <= 0.0:
            raise ValueError(f"lock {lock.id}: inverse range {lock.inverse_range:g}, sigma {lock.sigma:g}")


def _brought_to(document: _Document, now_ns: int, half_life_h: float) -> list[RangeLock]:
    """The locks on today's clock."""
    away_ns = now_ns - document.saved_ns
    counted_ns = min(max(away_ns, 0), round(half_life_h * HOUR_NS))
    if away_ns < -CLOCK_SLACK_NS or away_ns > counted_ns:
        _log.warning(
            "the ranges were written %.1f h %s by the clock: %.1f h of that count for their age",
            abs(away_ns) / HOUR_NS, "from now" if away_ns < 0 else "ago", counted_ns / HOUR_NS,
        )  # fmt: skip
    moved_ns = away_ns - counted_ns
    return [replace(lock, t_ns=lock.t_ns + moved_ns) for lock in document.locks]


def _tell_others(path: Path) -> None:
    rig = path.name.rpartition("-")[0]
    others = sorted(other.name for other in path.parent.glob(f"{rig}-*.json"))
    if others:
        _log.info("ranges learned with another calibration are not used: %s", ", ".join(others))


class RangesBook:
    """Keeps the map in its file.

    Parameters
    ----------
    path, digest
        Of the calibration in use.
    known : callable
        The locks of the map as it is.
    now_ns : callable
        The daemon's clock.
    """

    def __init__(
        self, path: Path, digest: str, known: Callable[[], Sequence[RangeLock]], now_ns: Callable[[], int]
    ) -> None:
        self._file, self._digest = KeptFile(path), digest
        self._known, self._now_ns = known, now_ns
        self._written = tuple(known())

    async def run(self) -> None:
        """Keep it until cancelled."""
        while True:
            await asyncio.sleep(EVERY_S)
            await self.keep()

    async def keep(self) -> None:
        """Write it if it has changed; a disk that takes none is told once, and tried again."""
        locks = tuple(self._known())
        if locks == self._written:
            return
        document = _Document(ptzd_ranges=1, calibration_sha256=self._digest, saved_ns=self._now_ns(), locks=list(locks))
        if await self._file.write(msgspec.json.encode(document)):
            self._written = locks
