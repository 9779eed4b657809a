"""The unified spherical camera model (Barreto & Araujo 2001; Mei & Rives 2007; paper, section 2.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.brown import distort, radius_limit, undistort
from ptzd.geometry.types import Array, Mask, checked

RIM_GUARD_RAD = 1e-3
"""Distance kept from the angle where the model folds: there the lift has no accuracy."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UnifiedCamera:
    """A fisheye or catadioptric camera: a unit sphere seen by a pinhole ξ behind its centre.

    Project a unit ray (X, Y, Z): ``m = (X, Y) / (Z + ξ)``, Brown's distortion, then K. Lift: undo K and the distortion,
    ``ω = |m|²``, and the paper's root with the factor 2 cancelled::

        Z = (-ξω + √(1 + ω (1 - ξ²))) / (ω + 1),   (X, Y) = m (Z + ξ)

    Valid set: angles off the axis up to `limit_rad`, which is the least of ``max_angle_rad``, the model's rim
    (``Z > -1/ξ`` for ξ > 1, ``Z > -ξ`` otherwise, less `RIM_GUARD_RAD`) and the fold of the distortion.
    """

    size_px: tuple[int, int]
    """Width and height, px."""
    fx: float
    """Focal length of the generalised pinhole, px; the focal length at the centre is ``fx / (1 + xi)``."""
    fy: float
    cx: float
    """Principal point, px."""
    cy: float
    xi: float
    """Mirror parameter ξ (the paper's l), >= 0; 0 = perspective, usually > 1 for a fisheye."""
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2."""
    max_angle_rad: float = math.pi / 2
    """Edge of the image circle, rad off the axis, in (0, π)."""
    limit_rad: float = field(init=False, repr=False)
    """Largest angle off the axis in the valid set, rad."""

    def __post_init__(self) -> None:
        if self.fx <= 0.0 or self.fy <= 0.0 or self.xi < 0.0 or not 0.0 < self.max_angle_rad < math.pi:
            raise GeometryError(f"not a unified camera: fx, fy > 0, xi >= 0, 0 < max_angle_rad < π; got {self!r}")
        rim = math.acos(-1.0 / self.xi if self.xi > 1.0 else -self.xi) - RIM_GUARD_RAD
        folds_at = self._angle(radius_limit(self.distortion))
        object.__setattr__(self, "limit_rad", min(self.max_angle_rad, rim, folds_at))

    def _angle(self, radius: float) -> float:
        """Return the angle off the axis at an ideal radius, rad; π where no ray has that radius."""
        square = radius * radius
        root = 1.0 + square * (1.0 - self.xi * self.xi)
        if root < 0.0:
            return math.pi
        return math.acos((-self.xi * square + math.sqrt(root)) / (square + 1.0))

    def project(self, rays: ArrayLike) -> tuple[Array, Mask]:
        """Return pixels ``(..., 2)`` of rays ``(..., 3)`` of any length, and the mask of the valid set."""
        ray = checked(rays, 3, "rays")
        angle = np.arctan2(np.hypot(ray[..., 0], ray[..., 1]), ray[..., 2])
        valid = np.asarray(np.isfinite(ray).all(axis=-1) & ray.any(axis=-1) & (angle <= self.limit_rad))
        ray = np.where(valid[..., None], ray, (0.0, 0.0, 1.0))
        ideal = ray[..., :2] / (ray[..., 2] + self.xi * np.linalg.norm(ray, axis=-1))[..., None]
        pixels = distort(ideal, self.distortion) * (self.fx, self.fy) + (self.cx, self.cy)
        return np.where(valid[..., None], pixels, 0.0), valid

    def lift(self, pixels: ArrayLike) -> tuple[Array, Mask]:
        """Return unit rays ``(..., 3)`` of pixels ``(..., 2)``, and the mask of the valid set."""
        points = (checked(pixels, 2, "pixels") - (self.cx, self.cy)) / (self.fx, self.fy)
        ideal, valid = undistort(points, self.distortion)
        square = (ideal * ideal).sum(axis=-1)
        root = 1.0 + square * (1.0 - self.xi * self.xi)
        z = (-self.xi * square + np.sqrt(np.maximum(root, 0.0))) / (square + 1.0)
        rays = np.concatenate([ideal * (z + self.xi)[..., None], z[..., None]], axis=-1)
        angle = np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), z)
        valid = np.asarray(valid & (root >= 0.0) & (angle <= self.limit_rad))
        return np.where(valid[..., None], rays, 0.0), valid
