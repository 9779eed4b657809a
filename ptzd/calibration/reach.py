"""How far the rays of a camera reach, and how much of its picture has any."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ptzd.geometry.sphere import angle_between
from ptzd.geometry.types import CameraModel, Mask

_CELLS = 240
"""Along the longer side of the picture."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """The part of a picture in which a box can be aimed at."""

    angle_rad: float
    """Off the optical axis: where the rays end, or the farthest one of the picture."""
    share: float
    """Of the picture's area that has rays, 0 to 1."""
    covered: Mask
    """Cells of the picture, row by row, whose middle has a ray."""

    def told(self, ends: str = "") -> str:
        """One sentence; ``ends`` says where or why the rays end."""
        reach = f"rays reach {math.degrees(self.angle_rad):.1f}° off the axis"
        if self.share == 1.0:
            return f"{reach} and cover the whole picture (100 %)"
        between = f", {ends}, " if ends else " "
        return f"{reach}{between}and cover {percent(self.share)} of the picture; a box in the rest has no ray"

    def document(self) -> dict[str, float]:
        """For programs."""
        return {"rays_reach_deg": math.degrees(self.angle_rad), "rays_share": self.share}


def reach_of(camera: CameraModel) -> Reach:
    """Measure a camera on a grid of square cells and along the border of its picture."""
    width, height = camera.size_px
    cell = max(width, height) / _CELLS
    columns, rows = max(1, round(width / cell)), max(1, round(height / cell))
    across = (np.arange(columns) + 0.5) * width / columns - 0.5
    down = (np.arange(rows) + 0.5) * height / rows - 0.5
    _, covered = camera.lift(np.stack(np.meshgrid(across, down), axis=-1))
    ends = (np.linspace(-0.5, width - 0.5, columns + 1), np.linspace(-0.5, height - 0.5, rows + 1))
    whole = np.stack(np.meshgrid(*ends), axis=-1)
    rays, valid = camera.lift(whole)
    if valid.all() and covered.all():
        farthest = float(angle_between(rays, np.array([0.0, 0.0, 1.0])).max())
        return Reach(angle_rad=farthest, share=1.0, covered=covered)
    less = 1.0 - 0.5 / covered.size  # a corner smaller than a cell
    return Reach(angle_rad=camera.limit_rad, share=min(float(covered.mean()), less), covered=covered)


def percent(share: float) -> str:
    """A share in words: only the whole is 100 %."""
    return f"{100.0 * share:.0f} %" if share == 1.0 or share < 0.995 else f"{math.floor(1000.0 * share) / 10.0:.1f} %"
