"""Where the head may be while it moves: a rectangle of pan and tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.model import HeadReading, HeadSpeed

EITHER_WAY_DEG = 179.0
"""Beyond it an endless axis may turn either way: a rounding decides."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A rectangle in the camera's degrees, pan not wrapped: the head is somewhere inside.

    Pan and tilt have a motor each, and nobody is told how one runs ahead of the other. Certain is only that an absolute
    move stays in the rectangle between its ends, and so does one that a stop or a newer move cuts short.
    """

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]

    @classmethod
    def at(cls, reading: HeadReading) -> Span:
        """The head rests there."""
        return cls(pan_deg=(reading.pan_deg, reading.pan_deg), tilt_deg=(reading.tilt_deg, reading.tilt_deg))

    @property
    def is_point(self) -> bool:
        """Whether it is known where the head is."""
        return self.pan_deg[0] == self.pan_deg[1] and self.tilt_deg[0] == self.tilt_deg[1]

    def to(self, end: HeadReading, *, endless_pan: bool) -> Span:
        """Where the head may be on an absolute move from somewhere in here; an endless axis turns the shorter way."""
        low, high = self.pan_deg
        tilts = (min(self.tilt_deg[0], end.tilt_deg), max(self.tilt_deg[1], end.tilt_deg))
        if not endless_pan:
            return Span(pan_deg=(min(low, end.pan_deg), max(high, end.pan_deg)), tilt_deg=tilts)
        turns = [math.remainder(end.pan_deg - pan, 360.0) for pan in (low, high)]
        ends = [low + turns[0], high + turns[1]]
        if max(map(abs, turns)) > EITHER_WAY_DEG or abs(ends[0] - ends[1]) > 1.0:
            return Span(pan_deg=(-180.0, 180.0), tilt_deg=tilts)
        return Span(pan_deg=(min(low, *ends), max(high, *ends)), tilt_deg=tilts)

    def drifted(self, speed: HeadSpeed, for_s: float) -> Span:
        """Where it may be after it turned at a speed, or any slower one of the same sense, for so long or less."""
        pan, tilt = speed.pan_deg_s * for_s, speed.tilt_deg_s * for_s
        return Span(
            pan_deg=(self.pan_deg[0] + min(pan, 0.0), self.pan_deg[1] + max(pan, 0.0)),
            tilt_deg=(self.tilt_deg[0] + min(tilt, 0.0), self.tilt_deg[1] + max(tilt, 0.0)),
        )
