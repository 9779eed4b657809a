"""Intrinsics of the PTZ over its zoom, interpolated and never extrapolated."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ptzd.errors import GeometryError
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import Array

ZOOM_TOLERANCE = 0.5
"""Zoom units beyond either end that still are that end: cameras report whole units."""
_HFOV_TOLERANCE_RAD = 1e-9
_SECTIONS = 128
_PASSES = 3


def pchip_slopes(x: Array, y: Array) -> Array:
    """Return the slopes ``(n, m)`` at nodes ``x`` ``(n,)`` of values ``y`` ``(n, m)``, n >= 2, for a monotone cubic.

    Fritsch & Butland's weighted harmonic mean inside, the three-point formula kept monotone at the ends
    (Fritsch & Carlson 1980; Moler, "Numerical Computing with MATLAB", section 3.6).
    """
    width = np.diff(x)[:, None]
    secant = np.diff(y, axis=0) / width
    if len(x) == 2:
        return np.repeat(secant, 2, axis=0)
    left, right = secant[:-1], secant[1:]
    same = left * right > 0.0
    heavy, light = 2.0 * width[1:] + width[:-1], width[1:] + 2.0 * width[:-1]
    mean = (heavy + light) / (heavy / np.where(same, left, 1.0) + light / np.where(same, right, 1.0))
    first = _end_slope(width[0], width[1], secant[0], secant[1])
    last = _end_slope(width[-1], width[-2], secant[-1], secant[-2])
    return np.vstack([first, np.where(same, mean, 0.0), last])


def _end_slope(near: Array, far: Array, secant: Array, following: Array) -> Array:
    slope = ((2.0 * near + far) * secant - near * following) / (near + far)
    overshoots = (np.sign(secant) != np.sign(following)) & (np.abs(slope) > 3.0 * np.abs(secant))
    slope = np.where(overshoots, 3.0 * secant, slope)
    return np.where(np.sign(slope) == np.sign(secant), slope, 0.0)


def hermite(x: Array, y: Array, slopes: Array, at: Array) -> Array:
    """Return the cubic Hermite interpolant ``(k, m)`` at points ``at`` ``(k,)`` inside the nodes."""
    cell = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    width = (x[cell + 1] - x[cell])[:, None]
    t = (at - x[cell])[:, None] / width
    rest = 1.0 - t
    return np.asarray(
        y[cell] * (1.0 + 2.0 * t) * rest * rest
        + slopes[cell] * width * t * rest * rest
        + y[cell + 1] * t * t * (3.0 - 2.0 * t)
        - slopes[cell + 1] * width * t * t * rest
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomEntry:
    """Intrinsics at one zoom."""

    zoom: float
    """VAPIX zoom units, 1 = widest."""
    fx: float
    """Focal length, px, > 0."""
    fy: float
    cx: float
    """Principal point, px."""
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomTable:
    """Entries by increasing zoom; in between, log focal length, principal point and distortion are PCHIP over zoom."""

    size_px: tuple[int, int]
    """Width and height of the PTZ's picture, px."""
    entries: tuple[ZoomEntry, ...]
    """At least one; zoom and focal length strictly increasing. A single entry serves that zoom only."""
    _nodes: Array = field(init=False, repr=False, compare=False)
    _values: Array = field(init=False, repr=False, compare=False)
    _slopes: Array = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.entries:
            raise GeometryError("zoom table: no entries")
        nodes = np.array([entry.zoom for entry in self.entries])
        columns = [(math.log(e.fx), math.log(e.fy), e.cx, e.cy, *e.distortion) for e in self.entries]
        values = np.array(columns, dtype=np.float64)
        if (np.diff(nodes) <= 0.0).any() or (np.diff(values[:, 0]) <= 0.0).any():
            raise GeometryError("zoom table: zoom and focal length must both increase strictly from entry to entry")
        slopes = pchip_slopes(nodes, values) if len(nodes) > 1 else np.zeros_like(values)
        for name, array in (("_nodes", nodes), ("_values", values), ("_slopes", slopes)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def zoom_range(self) -> tuple[float, float]:
        """First and last zoom of the table."""
        return self.entries[0].zoom, self.entries[-1].zoom

    @property
    def hfov_range_rad(self) -> tuple[float, float]:
        """Narrowest and widest horizontal field of view of the table, rad."""
        low, high = self.zoom_range
        return self.camera_at(high).hfov_rad, self.camera_at(low).hfov_rad

    def _at(self, zooms: Array) -> Array:
        """Return rows (log fx, log fy, cx, cy, k1, k2, p1, p2, k3) at zooms ``(k,)`` inside the range."""
        if len(self.entries) == 1:
            return np.repeat(self._values, len(zooms), axis=0)
        return hermite(self._nodes, self._values, self._slopes, zooms)

    def camera_at(self, zoom: float) -> PerspectiveCamera:
        """Return the camera at a zoom.

        Raises
        ------
        GeometryError
            When the zoom is over `ZOOM_TOLERANCE` outside the table: nothing is extrapolated.
        """
        low, high = self.zoom_range
        if not low - ZOOM_TOLERANCE <= zoom <= high + ZOOM_TOLERANCE:
            raise GeometryError(f"zoom {zoom:g} is outside the calibrated range {low:g} to {high:g}")
        row = self._at(np.array([min(max(zoom, low), high)]))[0].tolist()
        k1, k2, p1, p2, k3 = row[4:]
        return PerspectiveCamera(
            size_px=self.size_px,
            fx=math.exp(row[0]),
            fy=math.exp(row[1]),
            cx=row[2],
            cy=row[3],
            distortion=(k1, k2, p1, p2, k3),
        )

    def zoom_for_hfov(self, hfov_rad: float) -> float:
        """Return the zoom whose horizontal field of view is ``hfov_rad``, to 1e-9 rad.

        Raises
        ------
        GeometryError
            When no calibrated zoom has that field of view; `hfov_range_rad` says which have.
        """
        narrow, wide = self.hfov_range_rad
        if not narrow - _HFOV_TOLERANCE_RAD <= hfov_rad <= wide + _HFOV_TOLERANCE_RAD:
            raise GeometryError(
                f"field of view {math.degrees(hfov_rad):.2f}° is outside the calibrated range "
                f"{math.degrees(narrow):.2f}° to {math.degrees(wide):.2f}°"
            )
        return self._zoom_where(self._hfov, hfov_rad)

    def zoom_for_focal(self, fx: float) -> float:
        """Return the zoom whose focal length is ``fx`` px, to a relative 1e-9.

        Raises
        ------
        GeometryError
            When no calibrated zoom has that focal length.
        """
        shortest, longest = self.entries[0].fx, self.entries[-1].fx
        if not shortest <= fx <= longest:
            raise GeometryError(f"fx {fx:.2f} px is outside the calibrated range {shortest:.2f} to {longest:.2f} px")
        return self._zoom_where(lambda zooms: -self._at(zooms)[:, 0], -math.log(fx))

    def _zoom_where(self, falling: Callable[[Array], Array], wanted: float) -> float:
        """Return the zoom where a function that falls over zoom has the wanted value, by sections and a last chord."""
        low, high = self.zoom_range
        for _ in range(_PASSES):
            zooms = np.linspace(low, high, _SECTIONS + 1)
            cell = int(np.argmax(np.append(falling(zooms[1:-1]) <= wanted, True)))
            low, high = float(zooms[cell]), float(zooms[cell + 1])
        above, below = falling(np.array([low, high])).tolist()
        share = (above - wanted) / (above - below) if above > below else 0.0
        return low + min(max(share, 0.0), 1.0) * (high - low)

    def _hfov(self, zooms: Array) -> Array:
        rows = self._at(zooms)
        focal, centre = np.exp(rows[:, 0]), rows[:, 2]
        return np.asarray(np.arctan((centre + 0.5) / focal) + np.arctan((self.size_px[0] - 0.5 - centre) / focal))
