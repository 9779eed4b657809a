"""Pictures of a board as the estimators see them, and what became of each."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ptzd.geometry.types import Array, Mask


class Status(StrEnum):
    """What became of a picture."""

    USED = "used"
    NOT_FOUND = "not found"
    EDGE = "too close to the edge"
    OUTLIER = "outlier"
    UNREADABLE = "not a picture"
    MIRRORED = "mirrored"


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """Points of a board in one picture."""

    name: str
    points_m: Array
    """``(n, 3)`` in the board's frame, m."""
    pixels: Array
    """``(n, 2)``, px."""
    about_m: Array | None = None
    """Sum of a point and its partner on the board turned by 180°, ``(3,)``; None: the order cannot be reversed."""

    remark: str = ""
    """For the verdict."""

    def only(self, good: Mask) -> BoardView:
        """The same picture, with the points of a mask ``(n,)``."""
        left_out = f"{int((~good).sum())} of {len(good)} points left out"
        remark = f"{self.remark}; {left_out}" if self.remark else left_out
        return replace(self, points_m=self.points_m[good], pixels=self.pixels[good], remark=remark)

    def orders(self) -> tuple[BoardView, ...]:
        """The view as it is, and with the board turned by 180° where a detector cannot tell."""
        if self.about_m is None:
            return (self,)
        return self, replace(self, points_m=self.about_m - self.points_m)

    def mirrored(self, width_px: int) -> BoardView:
        """The view that a mirrored picture would have given."""
        return replace(self, pixels=self.pixels * (-1.0, 1.0) + (width_px - 1.0, 0.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewVerdict:
    """What became of one picture, for a person."""

    name: str
    status: Status
    reason: str = ""
    rms_px: float = math.nan
    held_out_rms_px: float = math.nan
    """Rms when the lens is estimated without this picture and only its pose with it."""

    @property
    def used(self) -> bool:
        """Whether it took part in the result."""
        return self.status is Status.USED


def rms(residuals: Array) -> float:
    """Root of the mean squared length of residuals ``(n, 2)``."""
    return float(np.sqrt((residuals**2).sum(axis=-1).mean())) if len(residuals) else math.nan
