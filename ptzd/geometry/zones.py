"""Zones: parts of the surroundings that the head must not enter, must not look into, or that boxes may not name.

Drawn in the fisheye's picture, or given as bearings of the head frame. Fisheye and head stand apart, so that each sees
what is drawn for the other at another place for every range: a zone is what its polygon passes over between its nearest
and its farthest range, on the head's sphere and on the fisheye's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ptzd.errors import GeometryError
from ptzd.geometry.outline import Outline, refuse_crossings
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, bearing, normalise
from ptzd.geometry.types import Array, Mask, in_picture
from ptzd.model import ZoneKind

STEP_RAD = math.radians(0.5)
"""Between two outlines of a zone seen from elsewhere; what lies in between is off by half of it."""
EDGE_PX = 8.0
"""An edge drawn straight in the fisheye's picture is bent on the sphere; pieces of this length follow it."""
THINNEST_PX = 0.5
"""A drawn polygon thinner than this is a line."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Zone:
    """One zone; made by `drawn` or `of_bearings`."""

    name: str
    kind: ZoneKind
    head_outlines: tuple[Outline, ...]
    """In the head frame, one for every step of range."""
    fisheye_outlines: tuple[Outline, ...]
    """In the fisheye's frame."""

    def holds_ray(self, ray_fisheye: Array) -> bool:
        """Whether a ray ``(3,)`` of the fisheye lies inside."""
        return bool(covers(self.fisheye_outlines, ray_fisheye[None])[0])


def covers(outlines: tuple[Outline, ...], directions: Array) -> Mask:
    """Which unit directions ``(n, 3)`` lie inside any of the outlines of a zone, taken one by one."""
    corners = np.concatenate([outline.corners for outline in outlines])
    middle = normalise(corners.mean(axis=0))
    found = directions @ middle >= (corners @ middle).min() - 1e-9
    inside, near = np.zeros(int(found.sum()), dtype=bool), directions[found]
    for outline in outlines:
        left = ~inside
        inside[left] = outline.contains(near[left])
    found[found] = inside
    return np.asarray(found)


def along(outlines: tuple[Outline, ...], step_rad: float) -> Array:
    """Directions ``(n, 3)`` along all edges, corners among them, no two neighbours further apart than a step."""
    points = []
    for outline in outlines:
        following = np.roll(outline.corners, -1, axis=0)
        lengths = angle_between(outline.corners, following)
        for start, end, length in zip(outline.corners, following, lengths, strict=True):
            count = max(math.ceil(float(length) / step_rad), 1)
            points.append(start + np.arange(count)[:, None] / count * (end - start))
    return normalise(np.concatenate(points))


def of_bearings(
    name: str,
    kind: ZoneKind,
    pan_tilt_rad: Iterable[tuple[float, float]],
    inverse_range: tuple[float, float],
    rig: Rig,
) -> Zone:
    """Return a zone whose corners are given as pan and tilt in the head frame, rad; its edges are great circles.

    Raises
    ------
    GeometryError
        When the corners are no polygon, see `Outline`.
    """
    corners = np.array(list(pan_tilt_rad), dtype=np.float64).reshape(-1, 2)
    if (np.abs(corners[:, 1]) > math.pi / 2).any():
        raise GeometryError("tilt beyond ±90°")
    directions = bearing(corners[:, 0], corners[:, 1])
    outline = Outline(directions)
    rotation, translation = rig.head_from_fisheye_rotation, rig.head_from_fisheye_translation

    def from_fisheye(inverse: float) -> Array:
        return normalise((directions - inverse * translation) @ rotation)

    seen = _outlines(from_fisheye, inverse_range, "the fisheye")
    return Zone(name=name, kind=kind, head_outlines=(outline,), fisheye_outlines=seen)


def drawn(
    name: str, kind: ZoneKind, corners_px: Iterable[tuple[float, float]], inverse_range: tuple[float, float], rig: Rig
) -> Zone:
    """Return a zone whose corners are pixels of the fisheye's picture.

    Parameters
    ----------
    name, kind
        As in the file.
    corners_px : iterable of (float, float)
        In the order of a walk around; edges are straight in the picture.
    inverse_range : (float, float)
        Of what is drawn, far end first, in the inverse unit of the rig's T.
    rig : Rig
        The calibration.

    Raises
    ------
    GeometryError
        When a corner lies outside the picture or the image circle, or the corners are no polygon.
    """
    corners = np.array(list(corners_px), dtype=np.float64).reshape(-1, 2)
    refuse_crossings(corners, THINNEST_PX)
    border = _bent(corners)
    rays, valid = rig.fisheye.lift(border)
    inside = valid & in_picture(rig.fisheye, border)
    if not inside.all():
        x, y = border[int(np.argmin(inside))]
        raise GeometryError(f"({x:.0f}, {y:.0f}) px lies outside the fisheye's image circle")
    outline = Outline(rays)
    rotated = rays @ rig.head_from_fisheye_rotation.T

    def from_head(inverse: float) -> Array:
        return normalise(rotated + inverse * rig.head_from_fisheye_translation)

    seen = _outlines(from_head, inverse_range, "the head")
    return Zone(name=name, kind=kind, head_outlines=seen, fisheye_outlines=(outline,))


def _outlines(seen: Callable[[float], Array], inverse_range: tuple[float, float], where: str) -> tuple[Outline, ...]:
    """One outline for every inverse range between which no corner moves by more than `STEP_RAD`."""
    fine = np.linspace(*inverse_range, 257)
    moved = np.array([seen(float(inverse)) for inverse in fine])
    passed = np.concatenate([[0.0], angle_between(moved[1:], moved[:-1]).max(axis=1).cumsum()])
    count = max(math.ceil(passed[-1] / STEP_RAD), 1) + 1
    outlines = []
    for inverse in np.interp(np.linspace(0.0, passed[-1], count), passed, fine):
        try:
            outlines.append(Outline(seen(float(inverse))))
        except GeometryError as error:
            far = f"{1.0 / inverse:.3g}" if inverse > 0.0 else "infinity"
            raise GeometryError(f"seen from {where}, at range {far}: {error}; or give its range_m") from None
    return tuple(outlines)


def _bent(corners: Array) -> Array:
    """Corners with points in between, no two further apart than `EDGE_PX`."""
    pieces = []
    for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        count = max(math.ceil(float(np.hypot(*(end - start))) / EDGE_PX), 1)
        pieces.append(start + np.arange(count)[:, None] / count * (end - start))
    return np.concatenate(pieces) if pieces else corners
