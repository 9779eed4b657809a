"""Poses of a flat board from rays, for any central camera."""

from __future__ import annotations

import numpy as np

from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import rotvec_from_rotation
from ptzd.geometry.types import Array


def plane_pose(points_m: Array, rays: Array) -> Array:
    """Return rotation vector and translation ``(6,)`` that put a board's points on their rays.

    Linear: ``ray × (r1 X + r2 Y + t) = 0`` for all points, then the nearest rotation. No depth is divided by, so points
    beyond 90° off the axis are as good as others.

    Parameters
    ----------
    points_m : Array
        ``(n, 3)`` with z = 0, n >= 4, not on one line.
    rays : Array
        ``(n, 3)`` unit.

    Raises
    ------
    CalibrationError
        When the points do not determine a pose.
    """
    scale = float(np.abs(points_m).max())
    flat = np.column_stack([points_m[:, 0] / scale, points_m[:, 1] / scale, np.ones(len(points_m))])
    zero = np.zeros_like(rays[:, :1])
    x, y, z = rays[:, :1], rays[:, 1:2], rays[:, 2:]
    rows = [
        np.concatenate([zero * flat, -z * flat, y * flat], axis=1),
        np.concatenate([z * flat, zero * flat, -x * flat], axis=1),
        np.concatenate([-y * flat, x * flat, zero * flat], axis=1),
    ]
    matrix = np.concatenate(rows)
    columns = np.linalg.svd(matrix.T @ matrix)[0][:, -1].reshape(3, 3)
    first, second, origin = columns[:, 0] / scale, columns[:, 1] / scale, columns[:, 2]
    length = float(np.sqrt(np.linalg.norm(first) * np.linalg.norm(second)))
    if not length > 1e-12:
        raise CalibrationError("board: its points lie on one line, or are too few, for a pose")
    if float(((flat @ columns.T) * rays).sum()) < 0.0:
        length = -length
    first, second, origin = first / length, second / length, origin / length
    left, _, right = np.linalg.svd(np.column_stack([first, second, np.cross(first, second)]))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.concatenate([rotvec_from_rotation(rotation), origin])
