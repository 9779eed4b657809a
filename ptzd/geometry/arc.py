"""The epipolar arc: where in the head's frame the target of one fisheye ray can be.

A fisheye ray P_f at inverse range s = 1/range is seen from the head along ``P_h(s) ∝ R P_f + s T``: a great-circle arc
from ``R P_f`` (s = 0, infinitely far) towards the epipole ``T/|T|`` (s to infinity, at the fisheye). The paper scans
the whole circle ``N · P = 0`` with ``N = T x R P_f`` (section 2.2, eq. 1); the rest of it is behind one of the cameras.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, cross, normalise
from ptzd.geometry.types import Array, checked

EPIPOLE_GUARD_RAD = 0.005
"""A ray closer to the baseline than this, with an arc shorter than this, is a point: about one pixel of a 640x480, 180°
fisheye."""
_COLLINEAR = 1e-9


def inverse_range_of(rotated: Array, bearings: Array, translation: Array) -> Array:
    """Return the inverse ranges ``(...)`` that put unit directions P ``(..., 3)`` on the arcs of rays r = R P_f.

    With ``f = T - (T·r) r``, at right angles to r in the epipolar plane,
    ``s = P·f / ((T·f)(P·r) - (T·r)(P·f))``. What P has across the plane drops out, so the answer belongs to the nearest
    point of the circle; on the circle it equals ``-((P x T)·(P x r)) / |P x T|²``. Infinite where P lies on the
    epipole or r on the baseline.
    """
    shift_r = rotated @ translation
    along_r = (bearings * rotated).sum(axis=-1)
    along_f = bearings @ translation - along_r * shift_r
    square = float(translation @ translation)
    below = (square - shift_r * shift_r) * along_r - shift_r * along_f
    sees = np.abs(below) > _COLLINEAR * square
    return np.where(sees, along_f / np.where(sees, below, 1.0), np.inf)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EpipolarArc:
    """The arc of one ray between two inverse ranges; made by `EpipolarArc.of`.

    Angles along the arc are measured from ``rotated`` towards the epipole:
    ``P_h = cos(u) rotated + sin(u) forward``, and by the law of sines ``s = sin(u) / (|T| sin(a - u))`` with ``a`` the
    angle between ``rotated`` and T. Inverse ranges are in the inverse unit of T and at least 0.
    """

    rotated: Array
    """R P_f, unit, shape (3,): the direction of the target were it infinitely far."""
    translation: Array
    """T, shape (3,)."""
    epipole: Array
    """T/|T|: where the head sees the fisheye."""
    normal: Array
    """Unit N along ``T x R P_f``; any unit normal of T when the ray lies on the baseline."""
    forward: Array
    """Unit vector at right angles to ``rotated`` along which the direction moves as s grows."""
    s_min: float
    s_max: float
    degenerate: bool
    """Whether the arc is a point: no range can be told from it, and one view shows it all."""

    @classmethod
    def of(cls, rig: Rig, ray_fisheye: ArrayLike, s_min: float, s_max: float) -> EpipolarArc:
        """Return the arc of a fisheye ray ``(3,)`` for inverse ranges ``0 <= s_min <= s_max < inf``.

        Raises
        ------
        GeometryError
            When the ray is zero or the interval is not as above.
        """
        ray = normalise(checked(ray_fisheye, 3, "ray_fisheye"))
        if ray.shape != (3,) or not ray.any() or not np.isfinite(ray).all():
            raise GeometryError(f"an arc needs one fisheye ray, finite and not zero; got {ray_fisheye!r}")
        if not 0.0 <= s_min <= s_max < math.inf:
            raise GeometryError(f"inverse ranges must satisfy 0 <= s_min <= s_max < inf; got {s_min:g}, {s_max:g}")
        rotated = rig.head_from_fisheye_rotation @ ray
        epipole = normalise(rig.head_from_fisheye_translation)
        normal = cross(epipole, rotated)
        sine = float(np.linalg.norm(normal))
        if sine < _COLLINEAR:
            normal = cross(epipole, np.eye(3)[int(np.argmin(np.abs(epipole)))])
        normal = normalise(normal)
        arc = cls(
            rotated=rotated,
            translation=rig.head_from_fisheye_translation,
            epipole=epipole,
            normal=normal,
            forward=normalise(cross(rotated, normal)),
            s_min=float(s_min),
            s_max=float(s_max),
            degenerate=False,
        )
        short = sine < math.sin(EPIPOLE_GUARD_RAD) and arc.length_rad < EPIPOLE_GUARD_RAD
        if short or sine < _COLLINEAR:
            object.__setattr__(arc, "degenerate", True)
        return arc

    def bearing(self, s: ArrayLike) -> Array:
        """Return the unit directions ``(..., 3)`` at inverse ranges ``(...)``.

        A target at the head's centre itself (``s T = -R P_f``) has no direction; it gets the epipole, the limit
        from the nearer side.
        """
        inverse = np.asarray(s, dtype=np.float64)[..., None]
        sums = self.rotated + inverse * self.translation
        nowhere = np.linalg.norm(sums, axis=-1, keepdims=True) <= _COLLINEAR
        return np.where(nowhere, self.epipole, normalise(sums))

    def inverse_range(self, bearing: ArrayLike) -> Array:
        """Return the inverse ranges ``(...)`` of the points of the circle nearest to directions ``(..., 3)``.

        Negative outside the half from ``rotated`` to the epipole, infinite at the epipole, and the same for a direction
        and its antipode. See `inverse_range_of`.
        """
        return inverse_range_of(self.rotated, normalise(checked(bearing, 3, "bearing")), self.translation)

    def across(self, bearing: ArrayLike) -> Array:
        """Return the angle of directions ``(..., 3)`` off the great circle, rad, positive on the side of ``normal``."""
        direction = normalise(checked(bearing, 3, "bearing"))
        return np.asarray(np.arcsin(np.clip(direction @ self.normal, -1.0, 1.0)))

    def head_inverse_range(self, s: ArrayLike) -> Array:
        """Return 1 / distance from the head, of targets at inverse ranges ``(...)`` from the fisheye."""
        inverse = np.asarray(s, dtype=np.float64)
        return inverse * self.magnification(inverse)

    def magnification(self, s: ArrayLike) -> Array:
        """Return how much larger the head sees a target than the fisheye does: the ratio of their distances to it."""
        inverse = np.asarray(s, dtype=np.float64)[..., None]
        ratio = np.linalg.norm(self.rotated + inverse * self.translation, axis=-1)
        return np.asarray(1.0 / np.maximum(ratio, _COLLINEAR))

    def angle_at(self, s: ArrayLike) -> Array:
        """Return the angles along the arc, rad, of inverse ranges ``(...)``."""
        inverse = np.asarray(s, dtype=np.float64)
        along, aside = self.translation @ self.rotated, self.translation @ self.forward
        return np.asarray(np.arctan2(inverse * aside, 1.0 + inverse * along))

    def inverse_range_at(self, angle_rad: ArrayLike) -> Array:
        """Return the inverse ranges of angles along the arc; the inverse of `angle_at` short of the epipole."""
        sine, cosine = np.sin(angle_rad), np.cos(angle_rad)
        along, aside = self.translation @ self.rotated, self.translation @ self.forward
        return np.asarray(sine / (aside * cosine - along * sine))

    @property
    def length_rad(self) -> float:
        """Angle between the two ends, rad."""
        return float(angle_between(self.bearing(self.s_min), self.bearing(self.s_max)))

    def steps(self, step_rad: float) -> Array:
        """Return inverse ranges from ``s_min`` to ``s_max``, both included, equally spaced in angle along the arc.

        Neighbours are at most ``step_rad`` apart. A degenerate arc gives its two ends, an arc of no length one value.
        """
        if not step_rad > 0.0:
            raise GeometryError(f"step_rad must be positive; got {step_rad}")
        if self.s_min == self.s_max:
            return np.array([self.s_min])
        if self.degenerate:
            return np.array([self.s_min, self.s_max])
        first, last = self.angle_at([self.s_min, self.s_max])
        count = max(1, math.ceil((last - first) / step_rad))
        values = self.inverse_range_at(np.linspace(first, last, count + 1))
        values[0], values[-1] = self.s_min, self.s_max
        return values
