"""Tells the core which patrol the schedule wants, whenever that changes."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

from ptzd.control import events as ev
from ptzd.presets import Presets
from ptzd.runtime.calendar import Due, due

CHECK_S = 10.0
"""Between two looks at the clock at most: one that leaps is noticed within this time, and so are other settings."""


def wall_clock() -> datetime:
    """Now, as the machine's clock shows it: unlike the daemon's own, it leaps when it is set."""
    return datetime.now(UTC)


class Roster:
    """Keeps the schedule; what is due goes into the log as an event, so that a replay needs neither clock nor zones.

    Parameters
    ----------
    presets : callable
        The patrols and the schedule in force.
    tell : callable
        Tells the core.
    now : callable
        The wall clock, aware.
    """

    def __init__(
        self,
        presets: Callable[[], Presets],
        tell: Callable[[ev.Event], None],
        now: Callable[[], datetime] = wall_clock,
    ) -> None:
        self._presets = presets
        self._tell = tell
        self._now = now
        self._told = ("", "")

    async def run(self) -> None:
        """Keep it until cancelled."""
        while True:
            wait_s = self.look()
            await asyncio.sleep(wait_s)

    def look(self) -> float:
        """Tell what is due if it is something else than before; returns for how long that holds at most, s."""
        now, presets = self._now(), self._presets()
        found = Due(patrol="", since="", changes=None)
        if presets.schedule and presets.time_zone is not None:
            found = due(presets.schedule, ZoneInfo(presets.time_zone), now)
        if (found.patrol, found.since) != self._told:
            self._told = (found.patrol, found.since)
            self._tell(ev.PatrolDue(patrol=found.patrol, since=found.since))
        if found.changes is None:
            return CHECK_S
        return min(max((found.changes - now).total_seconds(), 0.0), CHECK_S)
