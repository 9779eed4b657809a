"""The perception worker: one thread that decodes and matches, so that the loop never waits for arithmetic."""

from __future__ import annotations

import asyncio
import traceback
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from ptzd.control.commands import RunMatch
from ptzd.errors import MatchError, PtzdError
from ptzd.geometry.rig import Rig
from ptzd.jpeg.pixels import decode_grey
from ptzd.matching.job import MatchInputs, match
from ptzd.matching.turned import compare
from ptzd.model import HeadReading, MatchResult, Turned


class ThreadPerception:
    """Runs one match after the other in a thread of its own.

    Parameters
    ----------
    rig : Rig
        The calibration.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="perception")
        self._decoded: tuple[bytes, NDArray[np.uint8]] | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self._executor.shutdown, cancel_futures=True)

    async def match(self, job: RunMatch, fisheye_jpeg: bytes, view_jpeg: bytes) -> MatchResult:
        """Run one match; see :class:`ptzd.ports.Perception`."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._executor, self.match_now, job, fisheye_jpeg, view_jpeg)

    async def compare(self, before: bytes, at: HeadReading, after: bytes, then: HeadReading) -> Turned:
        """Hold two pictures against their poses; MatchError as for matches."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._executor, self._compare_now, before, at, after, then)

    def _compare_now(self, before: bytes, at: HeadReading, after: bytes, then: HeadReading) -> Turned:
        try:
            return compare(self._rig, decode_grey(before), at, decode_grey(after), then)
        except PtzdError:
            raise
        except Exception as error:
            # The same boundary: arithmetic on other people's pictures.
            what = " ".join(str(error).split())
            raise MatchError(f"comparing two views failed: {type(error).__name__}: {what}") from error

    def match_now(self, job: RunMatch, fisheye_jpeg: bytes, view_jpeg: bytes) -> MatchResult:
        """Do the same in the calling thread: what replay uses.

        Whatever a decoder or a matcher stumbles over, in pictures and boxes that come from outside, is the failure of
        this match alone; a defect anywhere else still ends the daemon.
        """
        try:
            return self._matched(job, fisheye_jpeg, view_jpeg)
        except PtzdError:
            raise
        except Exception as error:
            # The boundary around arithmetic on other people's pictures; it tells where in the program it was.
            raise MatchError(_told(job, error)) from error

    def _matched(self, job: RunMatch, fisheye_jpeg: bytes, view_jpeg: bytes) -> MatchResult:
        return match(
            MatchInputs(
                fisheye_grey=self._fisheye(fisheye_jpeg),
                view_grey=decode_grey(view_jpeg),
                rig=self._rig,
                box=job.box,
                reading=job.view.reading,
                inverse_range=job.inverse_range,
                band_rad=job.band_rad,
                seed=job.seed,
                budget_s=job.budget_s,
            ),
            job.matcher,
        )

    def _fisheye(self, jpeg: bytes) -> NDArray[np.uint8]:
        """Decode a fisheye frame; views of one scan share it, so the last one is kept."""
        if self._decoded is None or self._decoded[0] != jpeg:
            self._decoded = (jpeg, decode_grey(jpeg))
        return self._decoded[1]


def _told(job: RunMatch, error: Exception) -> str:
    """One line: what failed, on what, and where in the program, so that it can be mended."""
    place = traceback.extract_tb(error.__traceback__)[-1]
    what = " ".join(str(error).split()) or "no words"
    where = f"{Path(place.filename).name}:{place.lineno}"
    box = f"box {job.box.x:g},{job.box.y:g},{job.box.w:g},{job.box.h:g}"
    return f"{job.matcher} failed on {box}: {type(error).__name__}: {what} (at {where}); please report it with the log"
