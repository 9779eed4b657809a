"""The rays of a box's pixels, from one call of the camera model."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Mask

if TYPE_CHECKING:
    from ptzd.geometry.types import Array, CameraModel
    from ptzd.model import Box

NODES = 7
"""Places along a side of the box between which rays are interpolated."""
INTERPOLATED_RAD = 0.8
"""Longest side that is interpolated: the error stays below 1e-6 rad."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RayField:
    """Unit rays of a box and its surroundings, fisheye frame."""

    camera: CameraModel
    centre: Array
    """(3,) ray of the box's centre, zero when it is outside the image circle."""
    corners: Array
    """(4, 3) rays of the box's corners; the centre's ray for corners outside the image circle."""
    seen: bool
    """Whether the centre and something around it are inside the image circle."""
    pixel_rad: float
    """Angle of a pixel at the centre, geometric mean of both directions."""
    nodes: tuple[Array, Array]
    """(7,) and (7,) places of the nodes, px."""
    node_rays: Array | None
    """(3, 7, 7) their rays; None when the box is too large or not all inside the image circle."""

    @classmethod
    def of(cls, camera: CameraModel, box: Box, margin_px: float) -> RayField:
        """Lift a box with a margin around it."""
        cx, cy = box.centre
        nodes = tuple(
            _chebyshev(low - margin_px, low + side + margin_px) for low, side in ((box.x, box.w), (box.y, box.h))
        )
        near = [(cx - 0.5, cy), (cx + 0.5, cy), (cx, cy - 0.5), (cx, cy + 0.5)]
        few = np.array([box.centre, *near, *box.corners])
        rays, valid = camera.lift(np.concatenate([few, np.stack(np.meshgrid(*nodes), axis=-1).reshape(-1, 2)]))
        pixel_rad = _pixel_rad(rays[:5], valid[:5])
        known = bool(valid[9:].all()) and (max(box.w, box.h) + 2 * margin_px) * pixel_rad <= INTERPOLATED_RAD
        return cls(
            camera=camera,
            centre=rays[0],
            corners=np.where(valid[5:9, None], rays[5:9], rays[0]),
            seen=bool(valid[0]) and pixel_rad > 0.0,
            pixel_rad=pixel_rad,
            nodes=(nodes[0], nodes[1]),
            node_rays=rays[9:].reshape(NODES, NODES, 3).transpose(2, 0, 1) if known else None,
        )

    def grid(self, x: Array, y: Array) -> tuple[Array, Mask]:
        """Return the rays ``(n, 3)`` of a grid of pixels, row by row, and where there are any."""
        (left, *_, right), (top, *_, bottom) = self.nodes
        inside = left <= x[0] and x[-1] <= right and top <= y[0] and y[-1] <= bottom
        if self.node_rays is None or not inside or x.size * y.size <= NODES * NODES:
            return self.camera.lift(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))
        rows = _lagrange(self.nodes[1], y) @ self.node_rays @ _lagrange(self.nodes[0], x).T
        return rows.reshape(3, -1).T, np.ones(x.size * y.size, bool)


def _pixel_rad(rays: Array, valid: Mask) -> float:
    """Angle of a pixel from the rays at its centre, left, right, upper and lower edge.

    At the rim of the image circle the half of a pixel that is inside stands for both, and one direction for the other
    where that has no half inside; 0 where there is nothing.
    """
    reach = np.where(valid[1:, None], rays[1:], rays[0])
    across, down = (reach[1::2] - reach[::2]) * (2.0 / np.maximum(1.0 * valid[1::2] + valid[2::2], 1.0))[:, None]
    (ax, ay, az), (bx, by, bz) = across.tolist(), down.tolist()
    area = math.hypot(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)
    return math.sqrt(area) if area > 0.0 else max(math.hypot(ax, ay, az), math.hypot(bx, by, bz))


def _chebyshev(low: float, high: float) -> Array:
    """Chebyshev's points on an interval, both ends included."""
    return np.asarray(0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.linspace(0.0, np.pi, NODES)))


def _lagrange(nodes: Array, along: Array) -> Array:
    """Matrix that carries values at Chebyshev's points to other places (Berrut & Trefethen 2004, barycentric form)."""
    sign = np.where(np.arange(NODES) % 2, -1.0, 1.0)
    sign[[0, -1]] *= 0.5
    away = along[:, None] - nodes
    share = sign / np.where(np.abs(away) < 1e-9, 1e-9, away)
    return np.asarray(share / share.sum(axis=1, keepdims=True))
