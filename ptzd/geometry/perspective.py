"""The pinhole with Brown's distortion: a PTZ camera at one zoom."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.brown import distort, radius_limit, undistort
from ptzd.geometry.sphere import normalise
from ptzd.geometry.types import Array, Mask, checked


@dataclass(frozen=True, slots=True, kw_only=True)
class PerspectiveCamera:
    """A pinhole: ``(X/Z, Y/Z)``, Brown's distortion, then K (OpenCV's model with five coefficients).

    Valid set: angles off the axis up to `limit_rad`, the lesser of 89.43° and the fold of the distortion.
    """

    size_px: tuple[int, int]
    """Width and height, px."""
    fx: float
    """Focal length, px, > 0."""
    fy: float
    cx: float
    """Principal point, px."""
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """k1, k2, p1, p2, k3."""
    limit_rad: float = field(init=False, repr=False)
    """Largest angle off the axis in the valid set, rad."""

    def __post_init__(self) -> None:
        if self.fx <= 0.0 or self.fy <= 0.0:
            raise GeometryError(f"not a perspective camera: fx, fy > 0; got {self!r}")
        object.__setattr__(self, "limit_rad", math.atan(radius_limit(self.distortion)))

    @property
    def hfov_rad(self) -> float:
        """Horizontal field of view, rad: edge to edge through the principal point, as if without distortion."""
        return math.atan((self.cx + 0.5) / self.fx) + math.atan((self.size_px[0] - 0.5 - self.cx) / self.fx)

    def project(self, rays: ArrayLike) -> tuple[Array, Mask]:
        """Return pixels ``(..., 2)`` of rays ``(..., 3)`` of any length, and the mask of the valid set."""
        ray = checked(rays, 3, "rays")
        angle = np.arctan2(np.hypot(ray[..., 0], ray[..., 1]), ray[..., 2])
        valid = np.asarray((ray[..., 2] > 0.0) & np.isfinite(ray).all(axis=-1) & (angle <= self.limit_rad))
        ray = np.where(valid[..., None], ray, (0.0, 0.0, 1.0))
        ideal = ray[..., :2] / ray[..., 2:]
        pixels = distort(ideal, self.distortion) * (self.fx, self.fy) + (self.cx, self.cy)
        return np.where(valid[..., None], pixels, 0.0), valid

    def lift(self, pixels: ArrayLike) -> tuple[Array, Mask]:
        """Return unit rays ``(..., 3)`` of pixels ``(..., 2)``, and the mask of the valid set."""
        points = (checked(pixels, 2, "pixels") - (self.cx, self.cy)) / (self.fx, self.fy)
        ideal, valid = undistort(points, self.distortion)
        rays = normalise(np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=-1))
        return np.where(valid[..., None], rays, 0.0), valid
