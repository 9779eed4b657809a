"""Telling the service manager that the daemon works, and only while it does.

A loop that turns is not enough: a task may wait for ever inside a loop that is well. So every organ shows a number that
changes while it works. One that is known not to work and has said so is excused: a restart plugs no camera in.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ptzd.runtime.notify import Notifier

STATUS_EVERY_S = 1.0
"""How often the status line is renewed when no watchdog asks for more."""

_log = logging.getLogger(__name__)


def never() -> bool:
    """No excuse."""
    return False


@dataclass(frozen=True, slots=True, kw_only=True)
class Vital:
    """A sign of life of one organ."""

    name: str
    progress: Callable[[], int]
    """A number that changes while the organ works."""
    limit_s: float
    """Without a change for longer than this the organ counts as stuck."""
    excused: Callable[[], bool] = never
    """Whether the organ is known not to work and this was reported."""


class Watchdog:
    """Feeds the service manager's watchdog while every organ is alive or excused, and keeps the status line.

    Parameters
    ----------
    notifier : Notifier
        The line to the service manager.
    vitals : sequence of Vital
        What must be alive.
    status : callable
        One line for ``systemctl status``.
    """

    def __init__(self, notifier: Notifier, vitals: Sequence[Vital], status: Callable[[], str]) -> None:
        self._notifier = notifier
        self._vitals = tuple(vitals)
        self._status = status
        self._seen: dict[str, tuple[int, float]] = {}
        self._told: tuple[str, ...] = ()

    async def run(self) -> None:
        """Look, feed and sleep until cancelled."""
        loop = asyncio.get_running_loop()
        every_s = min(self._notifier.ping_every_s or STATUS_EVERY_S, STATUS_EVERY_S)
        while True:
            self.look(loop.time())
            await asyncio.sleep(every_s)

    def look(self, now_s: float) -> tuple[str, ...]:
        """Feed unless an organ is stuck.

        Parameters
        ----------
        now_s : float
            Any steady clock, s.

        Returns
        -------
        tuple of str
            Names of the stuck organs; empty when the watchdog was fed.
        """
        stuck = tuple(vital.name for vital in self._vitals if self._is_stuck(vital, now_s))
        if stuck != self._told:
            self._told = stuck
            if stuck:
                _log.error("stuck: %s; not feeding the watchdog", ", ".join(stuck))
        if not stuck and self._notifier.ping_every_s is not None:
            self._notifier.alive()
        self._notifier.status(f"stuck: {', '.join(stuck)}" if stuck else self._status())
        return stuck

    def _is_stuck(self, vital: Vital, now_s: float) -> bool:
        progress = vital.progress()
        before, since_s = self._seen.get(vital.name, (None, now_s))
        if progress != before or vital.excused():
            self._seen[vital.name] = (progress, now_s)
            return False
        return now_s - since_s > vital.limit_s
