"""The region in the fisheye: grey values, rays and weights on a grid tied to the fisheye's own pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.matching.arrays import Floats, Grey, Mask

if TYPE_CHECKING:
    from ptzd.geometry.types import Array
    from ptzd.matching.rays import RayField
    from ptzd.model import Box

SMOOTHING = 0.5
"""Sigma of the low-pass laid over both pictures before they are compared, in grid steps."""
CENTRE_WEIGHT = 0.75
"""Sigma of the centre weighting, in half sides of the box: the set point belongs to the centre."""
MARGIN_PX = 10.0
"""Around the box within which its grids lie, as a rule."""
LEAST_SIDE_PX = 14.0
"""Smaller boxes borrow a rim from their surroundings, in grid steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Patch:
    """A region sampled on a regular grid."""

    grey: Floats
    """(n,) grey values, low-passed to the grid."""
    rays: Floats
    """(n, 3) unit rays, rotated into the head frame (``R P_f``)."""
    weight: Floats
    """(n,) centre weighting, 0 where the fisheye shows nothing; sums to 1."""
    shape: tuple[int, int]
    """Rows and columns of the grid; n is their product."""
    step_px: int
    """Fisheye pixels per grid step."""
    angle_rad: float
    """Angle of one grid step at the box's centre."""


def step_for(box: Box, most_side: int, least_step: int) -> int:
    """Fisheye pixels per grid step so that the longer side has at most ``most_side`` steps."""
    return max(least_step, math.ceil(max(box.w, box.h) / most_side - 1e-6))


def cut_patch(grey: Grey, field: RayField, rotation: Array, box: Box, step: int) -> Patch:
    """Sample a box of the fisheye.

    Parameters
    ----------
    grey : uint8 (h, w)
        The fisheye picture.
    field : RayField
        Rays of the box.
    rotation : float64 (3, 3)
        ``head_from_fisheye`` rotation.
    box : Box
        The region, fisheye px; parts outside the picture or the image circle get weight 0.
    step : int
        Fisheye pixels per grid step; more than 1 averages over the pixels of a step.

    Returns
    -------
    Patch
        With ``weight`` all zero when nothing of the box can be seen.
    """
    cx, cy = box.centre
    columns = _count(box.w, step)
    rows = _count(box.h, step)
    left = round(cx + 0.5 - columns * step / 2)
    top = round(cy + 0.5 - rows * step / 2)
    values, inside = _cells(grey, left, top, columns, rows, step)
    x = left + (np.arange(columns, dtype=np.float64) + 0.5) * step - 0.5
    y = top + (np.arange(rows, dtype=np.float64) + 0.5) * step - 0.5
    rays, valid = field.grid(x, y)
    valid = _without_rim(valid & inside.ravel(), rows, columns)
    sigma_x = CENTRE_WEIGHT * max(box.w, columns * step) / 2
    sigma_y = CENTRE_WEIGHT * max(box.h, rows * step) / 2
    bell = np.exp(-0.5 * ((y - cy) / sigma_y) ** 2)[:, None] * np.exp(-0.5 * ((x - cx) / sigma_x) ** 2)
    weight = np.where(valid, bell.ravel(), 0.0)
    total = weight.sum()
    return Patch(
        grey=values.ravel().astype(np.float32),
        rays=np.where(valid[:, None], rays @ rotation.T, rotation[:, 2]).astype(np.float32),
        weight=(weight / total if total > 0 else weight).astype(np.float32),
        shape=(rows, columns),
        step_px=step,
        angle_rad=field.pixel_rad * step,
    )


def _count(side: float, step: int) -> int:
    return max(round(max(side / step, min(LEAST_SIDE_PX, 2 * side / step))), 4)


def _without_rim(valid: Mask, rows: int, columns: int) -> Mask:
    """Drop samples next to unseen ones: the low-pass has mixed the two."""
    if valid.all():
        return valid
    kept = cv2.erode(valid.reshape(rows, columns).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
    return np.asarray(kept.ravel() > 0)


def _cells(grey: Grey, left: int, top: int, columns: int, rows: int, step: int) -> tuple[Floats, Mask]:
    height, width = grey.shape
    margin = 3 * step
    x0, x1 = left - margin, left + columns * step + margin
    y0, y1 = top - margin, top + rows * step + margin
    crop = grey[max(y0, 0) : max(min(y1, height), 0), max(x0, 0) : max(min(x1, width), 0)]
    if crop.size == 0:
        return np.zeros((rows, columns), np.float32), np.zeros((rows, columns), bool)
    rim = (max(-y0, 0), max(y1 - height, 0), max(-x0, 0), max(x1 - width, 0))
    area = cv2.copyMakeBorder(crop, *rim, cv2.BORDER_REPLICATE).astype(np.float32)
    cells = cv2.resize(area, (columns + 6, rows + 6), interpolation=cv2.INTER_AREA) if step > 1 else area
    cells = cv2.GaussianBlur(cells, (0, 0), SMOOTHING)[3:-3, 3:-3]
    x = left + (np.arange(columns) + 0.5) * step - 0.5
    y = top + (np.arange(rows) + 0.5) * step - 0.5
    inside_x = (x > -0.5) & (x < width - 0.5)
    inside_y = (y > -0.5) & (y < height - 0.5)
    return cells, inside_y[:, None] & inside_x[None, :]
