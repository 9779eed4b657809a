"""Longer and longer pauses between attempts, spread so that many clients do not come back at once."""

from __future__ import annotations

from collections.abc import Callable

FIRST_S = 0.5
LAST_S = 30.0


class Backoff:
    """Pauses from half a second, doubling up to half a minute, each shortened by up to half at random.

    Parameters
    ----------
    jitter : callable
        Random numbers in [0, 1).
    """

    def __init__(self, jitter: Callable[[], float]) -> None:
        self._jitter = jitter
        self._next_s = FIRST_S

    def reset(self) -> None:
        """The attempt succeeded: the next pause is short again."""
        self._next_s = FIRST_S

    def pause_s(self) -> float:
        """How long to wait now, s."""
        pause_s = self._next_s * (1 - self._jitter() / 2)
        self._next_s = min(self._next_s * 2, LAST_S)
        return pause_s
