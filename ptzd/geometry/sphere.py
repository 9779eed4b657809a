"""Directions and rotations: bearings of pan and tilt, angles on the sphere, SO(3).

Pan is positive to the right (+x), tilt positive upwards (-y)::

    bearing(pan, tilt) = [sin pan · cos tilt, -sin tilt, cos pan · cos tilt]

The paper's φ and ψ (section 5.1) are the polar angles of its own frame: the same directions in other coordinates.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.types import Array, checked

POLE_GUARD = 1e-9
"""Sine of the distance from tilt ±90° below which pan has no meaning and is 0 by definition."""


def normalise(vectors: ArrayLike) -> Array:
    """Return vectors ``(..., n)`` at unit length; a zero vector stays zero, since it has no direction."""
    array = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(array, axis=-1, keepdims=True)
    return np.asarray(array / np.where(length > 0.0, length, 1.0))


def cross(a: Array, b: Array) -> Array:
    """Return the cross product of ``(..., 3)`` arrays, several times faster than numpy's for single vectors."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def wrap_angle(angle: ArrayLike) -> Array:
    """Return angles in rad wrapped to ``[-π, π)``, unchanged bit by bit when already there."""
    value = np.asarray(angle, dtype=np.float64)
    inside = (value >= -math.pi) & (value < math.pi)
    return np.where(inside, value, (value + math.pi) % (2.0 * math.pi) - math.pi)


def bearing(pan: ArrayLike, tilt: ArrayLike) -> Array:
    """Return the unit direction ``(..., 3)`` of pan and tilt in rad."""
    pan, tilt = np.broadcast_arrays(np.asarray(pan, dtype=np.float64), np.asarray(tilt, dtype=np.float64))
    return np.stack([np.sin(pan) * np.cos(tilt), -np.sin(tilt), np.cos(pan) * np.cos(tilt)], axis=-1)


def pan_tilt(direction: ArrayLike) -> tuple[Array, Array]:
    """Return pan in ``[-π, π]`` and tilt in ``[-π/2, π/2]``, rad, of directions ``(..., 3)`` of any length.

    At the poles (closer than `POLE_GUARD` to tilt ±90°) pan is undefined and returned as 0.
    """
    ray = normalise(checked(direction, 3, "direction"))
    x, y, z = ray[..., 0], ray[..., 1], ray[..., 2]
    horizontal = np.hypot(x, z)
    pan = np.where(horizontal > POLE_GUARD, np.arctan2(x, z), 0.0)
    return pan, np.asarray(np.arctan2(-y, horizontal))


def angle_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the angle in ``[0, π]`` rad between directions ``(..., 3)`` of any length, accurate at both ends.

    ``2 atan2(|a - b|, |a + b|)`` on unit vectors (Kahan 2006, "How futile are mindless assessments of roundoff").
    """
    left, right = normalise(checked(a, 3, "a")), normalise(checked(b, 3, "b"))
    apart, together = np.linalg.norm(left - right, axis=-1), np.linalg.norm(left + right, axis=-1)
    return np.asarray(2.0 * np.arctan2(apart, together))


def ry(angle: float) -> Array:
    """Return the rotation about y: ``ry(pan) @ z = bearing(pan, 0)``."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])


def rx(angle: float) -> Array:
    """Return the rotation about x: ``rx(tilt) @ z = bearing(0, tilt)``."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def rotation_from_rotvec(rotvec: ArrayLike) -> Array:
    """Return the 3x3 rotation of a rotation vector ``(3,)`` in rad (Rodrigues)."""
    vector = checked(rotvec, 3, "rotvec")
    angle = float(np.linalg.norm(vector))
    x, y, z = vector
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # sin(a)/a and (1 - cos(a))/a², through sinc so that a = 0 needs no case of its own
    first, half = float(np.sinc(angle / math.pi)), float(np.sinc(angle / (2.0 * math.pi)))
    return np.asarray(np.eye(3) + first * skew + 0.5 * half * half * (skew @ skew))


def rotvec_from_rotation(rotation: ArrayLike) -> Array:
    """Return the rotation vector ``(3,)`` in rad, of length in ``[0, π]``, of a 3x3 rotation.

    Through the quaternion's largest component (Shepperd 1978), so accurate at every angle.

    Raises
    ------
    GeometryError
        When the matrix is not a rotation (orthogonal to 1e-6, determinant +1).
    """
    matrix = checked(rotation, 3, "rotation")
    if matrix.shape != (3, 3) or np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-6 or np.linalg.det(matrix) < 0:
        raise GeometryError("not a rotation: a 3x3 orthogonal matrix of determinant +1 is needed")
    m = matrix
    outer = np.array(
        [
            [1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]],
        ]
    )
    quaternion = normalise(outer[int(np.argmax(np.diag(outer)))])
    if quaternion[0] < 0.0:
        quaternion = -quaternion
    sine = float(np.linalg.norm(quaternion[1:]))
    return np.asarray(quaternion[1:] * (2.0 * math.atan2(sine, quaternion[0]) / sine if sine > 0.0 else 2.0))
