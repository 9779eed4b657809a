"""The daemon's one clock."""

from __future__ import annotations

import time


class SteadyClock:
    """Ns since the epoch at start plus monotonic time since: comparable with the world, and never jumping."""

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Ns since the epoch."""
        return time.monotonic_ns() + self._offset_ns

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        """Convert a CLOCK_MONOTONIC stamp, e.g. of a V4L2 buffer."""
        return monotonic_ns + self._offset_ns
