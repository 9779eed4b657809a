"""Polygons on the sphere: what lies inside, how far away the rest is, and outlines that are none.

A polygon within a hemisphere is looked at in the gnomonic projection from its centre, in which great circles are
straight lines, so that inside, area and crossings are the plane's (Snyder 1987, *Map projections: a working manual*,
page 164).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.sphere import angle_between, cross, normalise
from ptzd.geometry.types import Array, Mask, checked

WIDEST_RAD = math.radians(80.0)
"""Farthest corner from the centre: near 90° the projection runs away."""
SMALLEST_RAD = math.radians(0.05)
"""Corners closer than this are one; a polygon thinner than this is a line."""
BLOCK = 4096
"""Directions measured at a time, so that many of them need little memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """A simple polygon of great-circle edges, no corner over 80° from its centre; either sense of turning.

    Raises
    ------
    GeometryError
        When there are fewer than three corners, two that follow each other are one, it has no area, crosses itself, or
        is too large; the message names the corners, counted from 1.
    """

    corners: Array
    """Unit directions, shape (n, 3)."""
    _axes: Array = field(init=False, repr=False)
    """Rows: right, down and centre of the projection."""
    _flat: Array = field(init=False, repr=False)
    """Corners in the projection, shape (n, 2)."""

    def __post_init__(self) -> None:
        given = checked(self.corners, 3, "corners")
        if given.ndim != 2 or len(given) < 3:
            raise GeometryError(f"a polygon needs three corners or more, got {len(np.atleast_2d(given))}")
        if not np.isfinite(given).all():
            raise GeometryError("a polygon needs finite corners")
        corners = normalise(given).copy()
        apart = angle_between(corners, np.roll(corners, -1, axis=0))
        if apart.min() < SMALLEST_RAD:
            twice = int(apart.argmin())
            raise GeometryError(f"corners {twice + 1} and {(twice + 1) % len(corners) + 1} are the same")
        centre = normalise(corners.mean(axis=0))
        farthest = float(angle_between(corners, centre).max()) if centre.any() else math.pi
        if farthest > WIDEST_RAD:
            raise GeometryError(
                f"corners lie up to {math.degrees(farthest):.0f}° from the polygon's middle, "
                f"at most {math.degrees(WIDEST_RAD):.0f}° can be handled: split it into smaller ones"
            )
        right = normalise(cross(np.eye(3)[int(np.abs(centre).argmin())], centre))
        axes = np.stack([right, cross(centre, right), centre])
        flat = (corners @ axes[:2].T) / (corners @ centre)[:, None]
        refuse_crossings(flat, SMALLEST_RAD)
        corners.flags.writeable = False
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "_axes", axes)
        object.__setattr__(self, "_flat", flat)

    def contains(self, directions: ArrayLike) -> Mask:
        """Tell which directions ``(..., 3)`` lie inside; the border may fall to either side."""
        rays = checked(directions, 3, "directions")
        along = rays @ self._axes[2]
        ahead = along > 1e-9
        points = (rays @ self._axes[:2].T) / np.where(ahead, along, 1.0)[..., None]
        inside = np.zeros(ahead.shape, dtype=bool)
        for (x0, y0), (x1, y1) in zip(self._flat, np.roll(self._flat, -1, axis=0), strict=True):
            if y0 != y1:
                straddles = (y0 > points[..., 1]) != (y1 > points[..., 1])
                inside ^= straddles & (points[..., 0] < x0 + (points[..., 1] - y0) * ((x1 - x0) / (y1 - y0)))
        return np.asarray(inside & ahead)

    def distance_rad(self, directions: ArrayLike) -> Array:
        """Return the angle in rad from directions ``(..., 3)`` to the polygon; 0 inside."""
        rays = normalise(checked(directions, 3, "directions"))
        flat = rays.reshape(-1, 3)
        blocks = range(0, len(flat), BLOCK)
        nearest = [_to_border_rad(flat[first : first + BLOCK], self.corners) for first in blocks]
        distance = np.concatenate(nearest) if nearest else np.zeros(0)
        return np.where(self.contains(rays), 0.0, distance.reshape(rays.shape[:-1]))


def _to_border_rad(rays: Array, corners: Array) -> Array:
    """Angle from unit rays ``(n, 3)`` to the nearest of the shorter great-circle arcs between neighbouring corners."""
    following = np.roll(corners, -1, axis=0)
    normals = normalise(cross(corners, following))
    beside = (rays @ cross(normals, corners).T >= 0.0) & (rays @ cross(following, normals).T >= 0.0)
    to_circles = np.arcsin(np.clip(np.abs(rays @ normals.T), 0.0, 1.0))
    to_corners = angle_between(rays[:, None], corners[None])
    ends = np.minimum(to_corners, np.roll(to_corners, -1, axis=1))
    return np.asarray(np.where(beside, to_circles, ends).min(axis=1))


def refuse_crossings(flat: Array, thinnest: float) -> None:
    """Raise GeometryError when a polygon of the plane, corners ``(n, 2)``, crosses itself or has no area.

    Parameters
    ----------
    flat : Array
        Corners in the order of a walk around.
    thinnest : float
        Width, in the unit of the corners, under which a polygon counts as a line.
    """
    count = len(flat)
    if count < 3:
        raise GeometryError(f"a polygon needs three corners or more, got {count}")
    following = np.roll(flat, -1, axis=0)
    area = 0.5 * float((flat[:, 0] * following[:, 1] - flat[:, 1] * following[:, 0]).sum())
    start_side, end_side = _sides(flat, following, flat), _sides(flat, following, following)
    straddles = start_side * end_side <= 0.0
    crosses = np.triu(straddles & straddles.T, 2)
    crosses[0, count - 1] = False
    if crosses.any():
        first, second = map(int, np.argwhere(crosses)[0])
        raise GeometryError(
            f"the edge from corner {first + 1} to {first + 2} crosses that from corner {second + 1} "
            f"to {(second + 1) % count + 1}: give the corners in the order of a walk around"
        )
    if abs(area) < float(np.linalg.norm(following - flat, axis=1).sum()) * thinnest / 4.0:
        raise GeometryError("the corners lie on one line: a polygon needs an area")


def _sides(start: Array, end: Array, points: Array) -> Array:
    """Signed area that edge i (row) spans with point j (column): its sign tells the side."""
    edge = end - start
    away = points[None] - start[:, None]
    return np.asarray(edge[:, None, 0] * away[..., 1] - edge[:, None, 1] * away[..., 0])
