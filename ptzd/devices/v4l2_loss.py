"""Numbers for pictures, such that the gaps are the pictures that were lost.

Two things tell of a loss. A driver that had no free buffer skips a sequence number. A camera that never sent a picture
leaves no trace there, only a longer time between two stamps. Neither tells of the other's losses.
"""

from __future__ import annotations

from collections import deque
from statistics import median

WINDOW = 31
"""Intervals that the usual time per picture is the median of: one second at 30 pictures/s, so a camera that halves its
rate in the dark counts as losing for half a second only."""

WRAP = 1 << 32
"""The driver's sequence number has 32 bits."""


class Numbering:
    """Gives every picture of a source a number that is never given twice, over any number of openings.

    Parameters
    ----------
    period_s : float or None
        Time per picture that the driver granted; None when it does not say.
    first : int
        Number of the first picture.
    """

    def __init__(self, period_s: float | None, first: int = 0) -> None:
        self._next = first
        self._granted_ns = None if period_s is None else period_s * 1e9
        self._intervals_ns: deque[float] = deque(maxlen=WINDOW)
        self._last: tuple[int, int | None] | None = None

    @property
    def next(self) -> int:
        """Number that the next picture gets if nothing is lost before it."""
        return self._next

    @property
    def period_ns(self) -> float | None:
        """Usual time per picture: the granted one until half a window of intervals is known."""
        if len(self._intervals_ns) <= WINDOW // 2 and self._granted_ns is not None:
            return self._granted_ns
        return median(self._intervals_ns) if self._intervals_ns else None

    def note(self, sequence: int, t_ns: int | None) -> int:
        """Number of a picture that arrived.

        Parameters
        ----------
        sequence : int
            The driver's counter, 32 bits.
        t_ns : int or None
            The driver's time stamp in ns; None when it has none that can be trusted.

        Returns
        -------
        int
            The number; one more than the last plus the pictures lost between the two.
        """
        lost = 0
        if self._last is not None:
            by_sequence = (sequence - self._last[0]) % WRAP - 1
            if not 0 <= by_sequence < WRAP // 2:
                by_sequence = 0
            lost = max(by_sequence, self._lost_by_time(t_ns, self._last[1], by_sequence + 1))
        self._last = (sequence, t_ns)
        number = self._next + lost
        self._next = number + 1
        return number

    def _lost_by_time(self, t_ns: int | None, before_ns: int | None, steps: int) -> int:
        if t_ns is None or before_ns is None or t_ns <= before_ns:
            return 0
        elapsed = t_ns - before_ns
        period = self.period_ns
        self._intervals_ns.append(elapsed / steps)
        return 0 if period is None else max(0, round(elapsed / period) - 1)
