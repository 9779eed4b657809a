"""What a matcher is given."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ptzd.errors import GeometryError
from ptzd.matching.arrays import Grey
from ptzd.model import MATCH_BUDGET_S

if TYPE_CHECKING:
    from ptzd.geometry.rig import Rig
    from ptzd.model import Box, HeadReading


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MatchInputs:
    """One region of a fisheye picture to be found in one PTZ view."""

    fisheye_grey: Grey
    """(h, w) the whole fisheye picture."""
    view_grey: Grey
    """(H, W) the whole PTZ picture."""
    rig: Rig
    box: Box
    """The region, fisheye px."""
    reading: HeadReading
    """The head's pose when the view was exposed."""
    inverse_range: tuple[float, float]
    """Interval to search, in the inverse unit of the rig's T; 0 = infinitely far."""
    band_rad: float
    """Half width to search across the arc, rad: 3 sigma of the predicted direction."""
    seed: int
    """Of the random choices (``harris`` only)."""
    budget_s: float = MATCH_BUDGET_S
    """Most work, see :mod:`ptzd.matching.budget`."""

    def __post_init__(self) -> None:
        low, high = self.inverse_range
        if not (0.0 <= low <= high < math.inf):
            raise GeometryError(f"inverse_range: must satisfy 0 <= low <= high < inf, got {low}, {high}")
        if not (0.0 <= self.band_rad < math.pi / 4):
            raise GeometryError(f"band_rad: must lie in [0, 0.785) rad, got {self.band_rad}")
        for name, picture, camera in (
            ("fisheye_grey", self.fisheye_grey, self.rig.fisheye.size_px),
            ("view_grey", self.view_grey, self.rig.zoom.size_px),
        ):
            if picture.shape != camera[::-1]:
                raise GeometryError(
                    f"{name}: the picture is {picture.shape[1]}x{picture.shape[0]} px, "
                    f"the calibration {camera[0]}x{camera[1]} px; use pictures of the calibrated size"
                )
