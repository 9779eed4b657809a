"""Longer and longer pauses between attempts, spread where many clients would come back at once."""

from __future__ import annotations

from collections.abc import Callable

FIRST_S = 0.5


class Backoff:
    """Pauses from half a second, doubling up to a longest one, each shortened by up to half at random.

    Parameters
    ----------
    longest_s : float
        Where it stops growing.
    jitter : callable
        Numbers in [0, 1), 0: as long as said.
    """

    def __init__(self, longest_s: float = 30.0, *, jitter: Callable[[], float] = lambda: 0.0) -> None:
        self._longest_s = longest_s
        self._jitter = jitter
        self._next_s = FIRST_S

    def reset(self) -> None:
        """The attempt succeeded: the next pause is short again."""
        self._next_s = FIRST_S

    def pause_s(self) -> float:
        """How long to wait now, s."""
        pause_s = self._next_s * (1 - self._jitter() / 2)
        self._next_s = min(self._next_s * 2, self._longest_s)
        return pause_s
