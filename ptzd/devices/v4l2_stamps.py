"""Whether a driver's time stamps can be believed: held against the time at which the pictures come.

Some drivers stamp with zero, with one value for all, with the wall clock while they promise CLOCK_MONOTONIC, or jump.
"""

from __future__ import annotations

from time import monotonic_ns

OLDEST_NS = 10_000_000_000
"""Age at which a picture is not from a queue any more: exposure, transfer and a busy loop take a fraction of that."""
FUTURE_NS = 20_000_000
"""A stamp this far after the arrival is from another clock; less is the rounding of two clocks."""
PATIENCE = 5
"""Pictures with a stamp that cannot be, in a row, before the stamps are given up: as many as wait in the buffers after
the machine itself has stood still, whose stamps are old and right, and one."""


class StampJudge:
    """Believes stamps until they contradict the time of arrival.

    Attributes
    ----------
    complaint : str
        Why the stamps are not believed, one phrase; empty while they are.
    """

    def __init__(self) -> None:
        self.complaint = ""
        self._last_ns: int | None = None
        self._odd = 0

    @property
    def believed(self) -> bool:
        """Whether stamps are used; once given up they stay so until the device is opened again."""
        return not self.complaint

    def judge(self, stamp_ns: int | None) -> bool:
        """Hold a stamp on CLOCK_MONOTONIC against now; False for a picture whose time is not known.

        Such a picture is not to be used while the stamps are still believed: its age may be anything.
        """
        if stamp_ns is None or not self.believed:
            return True
        age_ns = monotonic_ns() - stamp_ns
        repeated = self._last_ns is not None and stamp_ns <= self._last_ns
        self._last_ns = stamp_ns
        if -FUTURE_NS <= age_ns <= OLDEST_NS and not repeated:
            self._odd = 0
            return True
        self._odd += 1
        if age_ns < -FUTURE_NS or self._odd >= PATIENCE:
            self.complaint = _complaint(age_ns, repeated=repeated)
            return True
        return False


def _complaint(age_ns: int, *, repeated: bool) -> str:
    what = "do not rise" if repeated else f"are {abs(age_ns) / 1e9:.1f} s {'old' if age_ns > 0 else 'ahead'} on arrival"
    return f"its time stamps {what}; pictures are dated by their arrival instead"
