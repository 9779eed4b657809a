"""Which patrol the schedule wants now: local clock times of the week as instants, change-over nights included.

A time of day that the clock skips counts as the moment of the leap; one that it shows twice begins a window the first
time and ends one the second time. So a window is never cut short, and one that lies inside the skipped hour is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime, time, timedelta
from zoneinfo import ZoneInfo

from ptzd.presets import DAYS, Window, minutes

SECOND = timedelta(seconds=1)
DAY = timedelta(days=1)
AHEAD = timedelta(days=8)
"""Every window begins again within a week."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Due:
    """What the schedule wants at a moment."""

    patrol: str
    """Empty: none."""
    since: str
    """When its window began, as UTC; empty: none. Names the window: the same one is told once."""
    changes: datetime | None
    """The next moment at which something else is due; None: never."""


def due(schedule: Sequence[Window], zone: ZoneInfo, now: datetime) -> Due:
    """What is due at a moment.

    Parameters
    ----------
    schedule : sequence of Window
    zone : ZoneInfo
        Of the clock times.
    now : datetime
        Aware.
    """
    today = now.astimezone(zone).date()
    spans = [
        (*span, window.patrol)
        for window in schedule
        for offset in range(-2, AHEAD.days + 1)
        if (span := _span(window, today + offset * DAY, zone)) is not None
    ]
    running = [span for span in spans if span[0] <= now < span[1]]
    edges = sorted({edge for begin, end, _ in spans for edge in (begin, end) if edge > now})
    changes = edges[0] if edges else None
    if not running:
        return Due(patrol="", since="", changes=changes)
    begin, _, patrol = max(running)
    return Due(patrol=patrol, since=f"{begin:%Y-%m-%dT%H:%M:%SZ}", changes=changes)


def _span(window: Window, day: date, zone: ZoneInfo) -> tuple[datetime, datetime] | None:
    """The window that begins on this day, as instants; None when it does not, or when the clock skips all of it."""
    if window.days and DAYS[day.weekday()] not in window.days:
        return None
    first, last = minutes(window.begin), minutes(window.until)
    begin = instant(day, first, zone, last=False)
    end = instant(day if last > first else day + DAY, last, zone, last=True)
    return (begin, end) if begin < end else None


def instant(day: date, minute: int, zone: ZoneInfo, *, last: bool) -> datetime:
    """The moment, UTC, at which the clock shows this minute of this day; of two the first, or with ``last`` the second.

    A time that the clock skips is the moment at which it leaps.
    """
    day, minute = day + (minute // 1440) * DAY, minute % 1440
    shown = datetime.combine(day, time(minute // 60, minute % 60), zone)
    found = shown.replace(fold=int(last)).astimezone(UTC)
    if found.astimezone(zone).replace(tzinfo=None) == shown.replace(tzinfo=None):
        return found
    early, late = (shown.replace(fold=fold).astimezone(UTC) for fold in (1, 0))
    before = early.astimezone(zone).utcoffset()
    while late - early > SECOND:
        middle = early + (late - early) // 2
        early, late = (middle, late) if middle.astimezone(zone).utcoffset() == before else (early, middle)
    return late.replace(microsecond=0)
