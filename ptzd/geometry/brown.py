"""Brown's radial and tangential distortion of normalised coordinates, its inverse and its fold.

With ``r² = x² + y²`` and ``L = 1 + k1 r² + k2 r⁴ + k3 r⁶`` (Brown 1971, in OpenCV's order k1 k2 p1 p2 k3)::

    x_d = x L + 2 p1 x y + p2 (r² + 2 x²)
    y_d = y L + p1 (r² + 2 y²) + 2 p2 x y

The Jacobian is symmetric, ``J = L I + 2 L' X Xᵀ + 2 ((q·X) I + q Xᵀ + X qᵀ)`` with ``X = (x, y)``, ``q = (p2, p1)`` and
``L' = dL/d(r²)``. Where it is positive definite on a disc the map is one-to-one there; the first radius where it is not
is `fold_radius`.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ptzd.geometry.types import Array, Mask

FOLD_GUARD = 0.999
"""Share of the fold radius that is used: at the fold itself the inverse has no accuracy."""
MAX_RADIUS = 100.0
"""Largest ideal radius used, 89.43° of a pinhole: no picture plane is wider, and the horizon has no pixel."""
TOLERANCE = 1e-10
"""Largest residual of an accepted inverse, relative to 1 + the radius."""
_TARGET = 1e-13
_MAX_STEPS = 100
_OVERFLOW = 1e30
_SMALLEST_DAMPING = 1e-4
_REAL = 1e-6


def _unpack(coefficients: tuple[float, ...]) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, *rest = coefficients
    return k1, k2, p1, p2, rest[0] if rest else 0.0


def distort(points: Array, coefficients: tuple[float, ...]) -> Array:
    """Return the distorted normalised coordinates ``(..., 2)`` of ideal ones ``(..., 2)``."""
    k1, k2, p1, p2, k3 = _unpack(coefficients)
    x, y = points[..., 0], points[..., 1]
    square = x * x + y * y
    scale = 1.0 + square * (k1 + square * (k2 + square * k3))
    return np.stack(
        [
            x * scale + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x),
            y * scale + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y,
        ],
        axis=-1,
    )


@lru_cache(maxsize=256)
def fold_radius(coefficients: tuple[float, ...]) -> float:
    """Return the first ideal radius at which the distortion folds back in some direction; 1e300 when it never does.

    The worst direction is against ``q``; there the eigenvalues of J are ``1 + 3 k1 r² + 5 k2 r⁴ + 7 k3 r⁶ - 6 |q| r``
    along and ``L - 2 |q| r`` across the radius.
    """
    k1, k2, p1, p2, k3 = _unpack(coefficients)
    tangential = float(np.hypot(p1, p2))
    # in 1/r the leading coefficient is 1, so that tiny coefficients are as good as none
    along = [1.0, -6.0 * tangential, 3.0 * k1, 0.0, 5.0 * k2, 0.0, 7.0 * k3]
    across = [1.0, -2.0 * tangential, k1, 0.0, k2, 0.0, k3]
    return 1.0 / max(largest_positive_root(along), largest_positive_root(across))


def largest_positive_root(polynomial: list[float]) -> float:
    """Return the largest positive root of a monic polynomial, highest power first; 1e-300 when there is none."""
    roots = np.roots(polynomial)
    real = roots.real[np.abs(roots.imag) <= _REAL * np.abs(roots)]
    return float(real.max(initial=1e-300))


def radius_limit(coefficients: tuple[float, ...]) -> float:
    """Return the largest ideal radius that is used: inside the fold and finite."""
    return min(MAX_RADIUS, FOLD_GUARD * fold_radius(coefficients))


def _newton_step(points: Array, errors: Array, coefficients: tuple[float, ...]) -> Array:
    """Return J⁻¹ · error for points and errors of shape ``(n, 2)``."""
    k1, k2, p1, p2, k3 = _unpack(coefficients)
    x, y = points[:, 0], points[:, 1]
    square = x * x + y * y
    scale = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = k1 + square * (2.0 * k2 + square * 3.0 * k3)
    xx = scale + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    yy = scale + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    xy = 2.0 * (x * y * slope + p1 * x + p2 * y)
    determinant = xx * yy - xy * xy
    solved = np.stack([yy * errors[:, 0] - xy * errors[:, 1], xx * errors[:, 1] - xy * errors[:, 0]], axis=-1)
    return solved / determinant[:, None]


def undistort(points: Array, coefficients: tuple[float, ...]) -> tuple[Array, Mask]:
    """Return the ideal coordinates ``(..., 2)`` of distorted ones ``(..., 2)`` and where there are any.

    Damped Newton steps inside the disc of `radius_limit`, where the solution is unique; an entry is valid when its
    residual is at most `TOLERANCE` times 1 + radius. Invalid entries are zero.
    """
    limit = radius_limit(coefficients)
    flat = points.reshape(-1, 2)
    sane = np.asarray((np.abs(flat) < _OVERFLOW).all(axis=-1))
    target = np.where(sane[:, None], flat, 0.0)
    if any(coefficients):
        found, error = _solve(target, coefficients, limit)
        sane &= error <= TOLERANCE
    else:
        found = target
    sane &= np.hypot(found[:, 0], found[:, 1]) <= limit
    return np.where(sane[:, None], found, 0.0).reshape(points.shape), sane.reshape(points.shape[:-1])


def _solve(target: Array, coefficients: tuple[float, ...], limit: float) -> tuple[Array, Array]:
    """Return the solutions ``(n, 2)`` and their residuals ``(n,)``, relative to 1 + the radius of the target."""
    radius = np.hypot(target[:, 0], target[:, 1])
    weight = 1.0 / (1.0 + radius)
    found = target * np.minimum(1.0, 0.9 * limit / np.maximum(radius, 1e-300))[:, None]
    error = distort(found, coefficients) - target
    size = np.hypot(error[:, 0], error[:, 1]) * weight
    damping = np.ones_like(size)
    steps, active = 0, np.flatnonzero(size > _TARGET)
    while active.size > 0 and steps < _MAX_STEPS:
        trial = found[active] - damping[active, None] * _newton_step(found[active], error[active], coefficients)
        trial_error = distort(trial, coefficients) - target[active]
        trial_size = np.hypot(trial_error[:, 0], trial_error[:, 1]) * weight[active]
        better = (trial_size < size[active]) & (np.hypot(trial[:, 0], trial[:, 1]) < limit / FOLD_GUARD)
        won = active[better]
        found[won], error[won], size[won] = trial[better], trial_error[better], trial_size[better]
        damping[active] = np.where(better, 1.0, 0.5 * damping[active])
        steps, active = steps + 1, np.flatnonzero((size > _TARGET) & (damping > _SMALLEST_DAMPING))
    return found, size
