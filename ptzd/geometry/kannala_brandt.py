"""The equidistant polynomial model of Kannala & Brandt (2006), as in OpenCV's ``fisheye`` module."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.brown import FOLD_GUARD, largest_positive_root
from ptzd.geometry.types import Array, Mask, checked

_MAX_STEPS = 60
_TARGET = 1e-15


@dataclass(frozen=True, slots=True, kw_only=True)
class KannalaBrandtCamera:
    """A fisheye whose radius is ``θ_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`` of the angle θ off the axis.

    Valid set: θ up to `limit_rad`, the lesser of ``max_angle_rad`` and the angle where θ_d stops growing.
    """

    size_px: tuple[int, int]
    """Width and height, px."""
    fx: float
    """Focal length, px per rad at the centre, > 0."""
    fy: float
    cx: float
    """Principal point, px."""
    cy: float
    distortion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """k1, k2, k3, k4."""
    max_angle_rad: float = math.pi / 2
    """Edge of the image circle, rad off the axis, in (0, π)."""
    limit_rad: float = field(init=False, repr=False)
    """Largest angle off the axis in the valid set, rad."""

    def __post_init__(self) -> None:
        if self.fx <= 0.0 or self.fy <= 0.0 or not 0.0 < self.max_angle_rad < math.pi:
            raise GeometryError(f"not a Kannala-Brandt camera: fx, fy > 0, 0 < max_angle_rad < π; got {self!r}")
        k1, k2, k3, k4 = self.distortion
        # the slope's zero in 1/θ², where the leading coefficient is 1
        fold = largest_positive_root([1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4]) ** -0.5
        object.__setattr__(self, "limit_rad", min(self.max_angle_rad, FOLD_GUARD * fold))

    def _radius(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        square = angle * angle
        return np.asarray(angle * (1.0 + square * (k1 + square * (k2 + square * (k3 + square * k4)))))

    def _slope(self, angle: Array) -> Array:
        k1, k2, k3, k4 = self.distortion
        square = angle * angle
        return np.asarray(1.0 + square * (3 * k1 + square * (5 * k2 + square * (7 * k3 + square * 9 * k4))))

    def _angle(self, radius: Array) -> Array:
        """Return θ of θ_d by Newton steps kept inside a shrinking bracket; θ_d grows on the whole bracket."""
        low, high = np.zeros_like(radius), np.full_like(radius, self.limit_rad)
        angle = np.minimum(radius, high)
        steps, error = 0, self._radius(angle) - radius
        while np.abs(error).max(initial=0.0) > _TARGET and steps < _MAX_STEPS:
            low, high = np.where(error < 0.0, angle, low), np.where(error > 0.0, angle, high)
            newton = angle - error / self._slope(angle)
            angle = np.where((newton >= low) & (newton <= high), newton, 0.5 * (low + high))
            steps, error = steps + 1, self._radius(angle) - radius
        return angle

    def project(self, rays: ArrayLike) -> tuple[Array, Mask]:
        """Return pixels ``(..., 2)`` of rays ``(..., 3)`` of any length, and the mask of the valid set."""
        ray = checked(rays, 3, "rays")
        side = np.hypot(ray[..., 0], ray[..., 1])
        angle = np.arctan2(side, ray[..., 2])
        valid = np.asarray(np.isfinite(ray).all(axis=-1) & ray.any(axis=-1) & (angle <= self.limit_rad))
        scale = self._radius(np.where(valid, angle, 0.0)) / np.where(valid & (side > 0.0), side, 1.0)
        ideal = np.where(valid[..., None], ray[..., :2], 0.0) * scale[..., None]
        return np.where(valid[..., None], ideal * (self.fx, self.fy) + (self.cx, self.cy), 0.0), valid

    def lift(self, pixels: ArrayLike) -> tuple[Array, Mask]:
        """Return unit rays ``(..., 3)`` of pixels ``(..., 2)``, and the mask of the valid set."""
        points = (checked(pixels, 2, "pixels") - (self.cx, self.cy)) / (self.fx, self.fy)
        radius = np.hypot(points[..., 0], points[..., 1])
        # one rounding error of slack, so that a projection of the rim lifts again
        valid = np.asarray(radius <= float(self._radius(np.array(self.limit_rad))) * (1.0 + 1e-14))
        radius = np.where(valid, radius, 0.0)
        angle = self._angle(radius)
        side = (
            np.where(valid[..., None], points, 0.0) * (np.sin(angle) / np.where(radius > 0.0, radius, 1.0))[..., None]
        )
        rays = np.concatenate([side, np.cos(angle)[..., None]], axis=-1)
        return np.where(valid[..., None], rays, 0.0), valid
