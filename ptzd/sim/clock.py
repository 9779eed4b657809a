"""The simulator's time: seconds that rise, real or by hand."""

from __future__ import annotations

import asyncio
import heapq
import time
from typing import Protocol


class SimClock(Protocol):
    """Seconds since the epoch on a scale that never jumps."""

    def now_s(self) -> float:
        """The present."""
        ...

    async def sleep_until(self, t_s: float) -> None:
        """Return when ``now_s() >= t_s``."""
        ...


class WallClock:
    """Epoch at construction plus the monotonic clock since.

    Parameters
    ----------
    rate : float
        Simulated seconds per real one; above 1 the camera's mechanics run faster than life.
    """

    def __init__(self, rate: float = 1.0) -> None:
        self._start_s = time.time()
        self._monotonic_s = time.monotonic()
        self._rate = rate

    def now_s(self) -> float:
        """The present, s since the epoch."""
        return self._start_s + (time.monotonic() - self._monotonic_s) * self._rate

    async def sleep_until(self, t_s: float) -> None:
        """Sleep on the event loop."""
        rest_s = t_s - self.now_s()
        while rest_s > 0:
            await asyncio.sleep(rest_s / self._rate)
            rest_s = t_s - self.now_s()


class VirtualClock:
    """Time that passes only when :meth:`advance` says so; for tests.

    Parameters
    ----------
    start_s : float
        First value of ``now_s``.
    """

    def __init__(self, start_s: float = 1_000_000.0) -> None:
        self._now_s = start_s
        self._sleepers: list[tuple[float, int, asyncio.Future[None]]] = []
        self._count = 0

    def now_s(self) -> float:
        """The present."""
        return self._now_s

    async def sleep_until(self, t_s: float) -> None:
        """Wait until somebody advanced the clock past ``t_s``."""
        if t_s <= self._now_s:
            return
        future: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._count += 1
        heapq.heappush(self._sleepers, (t_s, self._count, future))
        await future

    def advance(self, duration_s: float) -> None:
        """Let time pass and wake those whose time has come, in order."""
        if duration_s < 0:
            raise ValueError(f"time does not run backwards: {duration_s} s")
        self._now_s += duration_s
        while self._sleepers and self._sleepers[0][0] <= self._now_s:
            future = heapq.heappop(self._sleepers)[2]
            if not future.done():
                future.set_result(None)
