"""Times as a person reads them."""

from __future__ import annotations

from datetime import UTC, datetime

from ptzd.log.protobuf import NS

_YEAR_9999_NS = 253_000_000_000 * NS


def clock_time(t_ns: int) -> str:
    """Time of day in UTC to the millisecond, e.g. ``2026-11-21 23:15:02.123Z``; the plain number where it is none."""
    if not 0 <= t_ns < _YEAR_9999_NS:
        return f"{t_ns} ns"
    whole = datetime.fromtimestamp(t_ns // NS, UTC)
    return f"{whole:%Y-%m-%d %H:%M:%S}.{t_ns % NS // 1_000_000:03d}Z"
