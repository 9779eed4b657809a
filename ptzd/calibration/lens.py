"""The camera models as parameter vectors with derivatives, for least squares.

Order of the parameters: ``fx fy cx cy``, then ξ for the unified model, then the distortion in the file's order.
The formulas are those of `ptzd.geometry`; the derivatives are by hand.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import Array, CameraModel
from ptzd.geometry.unified import UnifiedCamera

_TINY = 1e-9
Projection = tuple[Array, Array, Array]
"""Pixels ``(n, 2)``, derivatives by parameters ``(n, 2, P)`` and by points ``(n, 2, 3)``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """One model."""

    name: str
    """As in the file: unified, kannala_brandt, perspective."""
    names: tuple[str, ...]
    """Of the parameters."""
    project: Callable[[Array, Array], Projection]
    """From parameters ``(P,)`` and points ``(n, 3)`` in the camera's frame."""

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.names)

    def camera(self, values: Array, size_px: tuple[int, int], max_angle_rad: float) -> CameraModel:
        """The camera of the parameters; a perspective one has no largest angle."""
        fx, fy, cx, cy, *rest = values.tolist()
        pinhole = {"size_px": size_px, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
        if self.name == "unified":
            return UnifiedCamera(**pinhole, xi=rest[0], distortion=tuple(rest[1:]), max_angle_rad=max_angle_rad)
        if self.name == "kannala_brandt":
            return KannalaBrandtCamera(**pinhole, distortion=tuple(rest), max_angle_rad=max_angle_rad)
        return PerspectiveCamera(**pinhole, distortion=tuple(rest))


def _brown(m: Array, k: Array) -> tuple[Array, Array, Array]:
    """Distorted coordinates ``(n, 2)``, derivatives by m ``(n, 2, 2)`` and by k1 k2 p1 p2 k3 ``(n, 2, 5)``."""
    k1, k2, p1, p2, k3 = k
    x, y = m[:, 0], m[:, 1]
    q = x * x + y * y
    scale = 1.0 + q * (k1 + q * (k2 + q * k3))
    slope = k1 + q * (2.0 * k2 + q * 3.0 * k3)
    moved_x = x * scale + 2 * p1 * x * y + p2 * (q + 2 * x * x)
    moved_y = y * scale + p1 * (q + 2 * y * y) + 2 * p2 * x * y
    by_m = np.empty((len(m), 2, 2))
    by_m[:, 0, 0] = scale + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    by_m[:, 1, 1] = scale + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    by_m[:, 0, 1] = by_m[:, 1, 0] = 2 * (x * y * slope + p1 * x + p2 * y)
    by_k = np.empty((len(m), 2, 5))
    for column, power in ((0, q), (1, q * q), (4, q * q * q)):
        by_k[:, 0, column], by_k[:, 1, column] = x * power, y * power
    by_k[:, 0, 2], by_k[:, 1, 2] = 2 * x * y, q + 2 * y * y
    by_k[:, 0, 3], by_k[:, 1, 3] = q + 2 * x * x, 2 * x * y
    return np.stack([moved_x, moved_y], axis=-1), by_m, by_k


def _pinhole(values: Array, plane: Array) -> tuple[Array, Array]:
    """Pixels ``(n, 2)`` and their derivatives by fx fy cx cy ``(n, 2, 4)``."""
    by = np.zeros((len(plane), 2, 4))
    by[:, 0, 0], by[:, 1, 1], by[:, 0, 2], by[:, 1, 3] = plane[:, 0], plane[:, 1], 1.0, 1.0
    return plane * values[:2] + values[2:4], by


def _unified(values: Array, points: Array) -> Projection:
    xi = values[4]
    length = np.linalg.norm(points, axis=1)
    depth = np.maximum(points[:, 2] + xi * length, _TINY * length)
    m = points[:, :2] / depth[:, None]
    grow = xi * points / length[:, None]
    grow[:, 2] += 1.0
    by_point = -m[:, :, None] * (grow / depth[:, None])[:, None, :]
    by_point[:, 0, 0] += 1.0 / depth
    by_point[:, 1, 1] += 1.0 / depth
    plane, by_m, by_k = _brown(m, np.append(values[5:9], 0.0))
    pixels, by_k0 = _pinhole(values, plane)
    focal = values[:2, None]
    by_xi = np.einsum("nij,nj->ni", by_m, -m * (length / depth)[:, None])
    by = np.concatenate([by_k0, (by_xi * values[:2])[:, :, None], by_k[:, :, :4] * focal], axis=2)
    return pixels, by, np.einsum("nij,njk->nik", by_m, by_point) * focal


def _perspective(values: Array, points: Array) -> Projection:
    depth = np.where(points[:, 2] > _TINY, points[:, 2], _TINY)
    m = points[:, :2] / depth[:, None]
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / depth
    by_point[:, :, 2] = -m / depth[:, None]
    plane, by_m, by_k = _brown(m, values[4:9])
    pixels, by_k0 = _pinhole(values, plane)
    focal = values[:2, None]
    return pixels, np.concatenate([by_k0, by_k * focal], axis=2), np.einsum("nij,njk->nik", by_m, by_point) * focal


def _kannala_brandt(values: Array, points: Array) -> Projection:
    k1, k2, k3, k4 = values[4:8]
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    r = np.maximum(np.hypot(x, y), _TINY)
    square = r * r + z * z
    angle = np.arctan2(r, z)
    q = angle * angle
    bent = angle * (1 + q * (k1 + q * (k2 + q * (k3 + q * k4))))
    slope = 1 + q * (3 * k1 + q * (5 * k2 + q * (7 * k3 + q * 9 * k4)))
    side = np.stack([x / r, y / r], axis=-1)
    pixels, by_k0 = _pinhole(values, side * bent[:, None])
    powers = np.stack([angle * q, angle * q**2, angle * q**3, angle * q**4], axis=-1)
    by_angle = np.stack([z * side[:, 0] / square, z * side[:, 1] / square, -r / square], axis=-1)
    by_point = side[:, :, None] * (slope[:, None] * by_angle)[:, None, :]
    turn = bent / r
    by_point[:, 0, 0] += turn * side[:, 1] ** 2
    by_point[:, 1, 1] += turn * side[:, 0] ** 2
    by_point[:, 0, 1] -= turn * side[:, 0] * side[:, 1]
    by_point[:, 1, 0] -= turn * side[:, 0] * side[:, 1]
    focal = values[:2, None]
    by_k = side[:, :, None] * powers[:, None, :]
    return pixels, np.concatenate([by_k0, by_k * focal], axis=2), by_point * focal


_PINHOLE = ("fx", "fy", "cx", "cy")
UNIFIED = Lens(name="unified", names=(*_PINHOLE, "xi", "k1", "k2", "p1", "p2"), project=_unified)
KANNALA_BRANDT = Lens(name="kannala_brandt", names=(*_PINHOLE, "k1", "k2", "k3", "k4"), project=_kannala_brandt)
PERSPECTIVE = Lens(name="perspective", names=(*_PINHOLE, "k1", "k2", "p1", "p2", "k3"), project=_perspective)
WIDE_RAD = math.radians(179.0)
"""A largest angle that no picture reaches: the model's own limit holds."""
