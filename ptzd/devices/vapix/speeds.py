"""From deg/s to the percent of continuous moves, and the forms in which cameras take them. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.model import HeadSpeed

FULL_PERCENT = 100.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedCurve:
    """Speed of a camera's continuous moves: ``top · (percent / 100) ** exponent``, pan and tilt alike but for the top.

    Domes are linear; articulated heads were found to follow a power of about 2.4.
    """

    top_deg_s: tuple[float, float] | None
    """Of pan and tilt at 100 %; None: not known, and neither is turned."""
    exponent: float

    def percents(self, speed: HeadSpeed) -> tuple[float, float, float]:
        """Pan, tilt and zoom in signed percent of the fastest.

        Raises
        ------
        ValueError
            A turn where the top speed is not known, or above it.
        """
        top_pan, top_tilt = self.top_deg_s or (0.0, 0.0)
        pan, tilt = self._percent(speed.pan_deg_s, top_pan), self._percent(speed.tilt_deg_s, top_tilt)
        return pan, tilt, FULL_PERCENT * speed.zoom_rate

    def _percent(self, deg_s: float, top_deg_s: float) -> float:
        if deg_s == 0.0:
            return 0.0
        if abs(deg_s) > top_deg_s * (1 + 1e-9):
            raise ValueError(f"{deg_s:g}°/s is more than the {top_deg_s:g}°/s of this axis")
        return math.copysign(FULL_PERCENT * (abs(deg_s) / top_deg_s) ** (1 / self.exponent), deg_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedForm:
    """How a camera wants its percents."""

    fractions: bool
    """Whether it takes hundredths of a percent; documented are whole ones."""
    unproportional: bool
    """Whether it can be told not to slow down with the zoom; documented since version 1.1 of its interface."""

    def text(self, percent: float) -> str:
        """A percent for the request; what is no rest stays none."""
        if self.fractions:
            return f"{percent:.2f}".rstrip("0").rstrip(".")
        whole = round(percent)
        return str(whole if whole or not percent else int(math.copysign(1, percent)))


SPEED_FORMS = (
    SpeedForm(fractions=True, unproportional=True),
    SpeedForm(fractions=False, unproportional=True),
    SpeedForm(fractions=False, unproportional=False),
)
"""Tried in this order until the camera takes one."""
