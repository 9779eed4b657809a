"""Gauss-Newton over range, two plane slopes, offset and roll, for many candidates at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.geometry.sphere import cross
from ptzd.matching.arrays import Floats
from ptzd.matching.hypotheses import motions, speed
from ptzd.matching.place import Place

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import Samples, WorkingView

ROBUST_SCALE = 1.2
"""Residuals of this many sigmas have a quarter of the full weight (Geman-McClure)."""
SLOPE_SIGMA = 1.5
"""Tangent of the obliqueness of the surfaces that are expected, one sigma."""
DAMPING = 0.02
RIDGE = 1e-4
"""Share of the diagonal that keeps the normal equations definite: their sums are in single precision."""
LARGEST_MOVE_STEPS = 1.5
"""Grid steps that the centre may move in one iteration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """What is known before looking."""

    inverse_range: tuple[float, float]
    band_rad: float
    noise: float
    """One sigma of a sample's residual from noise, grey levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """Outcome of a refinement of k candidates."""

    place: Place
    sigma_rad: Array
    """(k,) one sigma of the centre's direction from the residuals."""
    gain: Floats
    """(k,) what brings the view's grey values to the patch's, at the last step."""


def refine(
    patch: Patch,
    view: WorkingView,
    arc: EpipolarArc,
    start: Place,
    bounds: Bounds,
    iterations: int,
    *,
    hold: bool = False,
) -> Refined:
    """Move candidates until the view's pixels explain the patch up to gain and offset.

    Parameters
    ----------
    patch : Patch
        The region.
    view : WorkingView
        Low-passed to the patch's grid.
    arc : EpipolarArc
        Of the box's centre.
    start : Place
        Of k candidates, within about a grid step of an optimum.
    bounds : Bounds
        Interval, band and noise; they enter as priors.
    iterations : int
        Gauss-Newton steps, at least one.
    hold : bool
        Leave offset and roll as they are.
    """
    basis = _basis(arc.rotated)
    coefficients = np.ascontiguousarray((patch.rays @ basis.astype(np.float32)).T)
    place, precision = start, _prior_precision(start.planes @ arc.rotated, bounds)
    free = 3 if hold else 5
    for _ in range(iterations):
        matrices, along = motions(arc, place.planes, place.offset, place.roll)
        samples = view.sample(matrices[:, 0], patch.rays)
        columns = _columns(view, matrices[:, 1:] if free > 3 else None, along, samples, coefficients, patch.rays)
        normal, right, scale, gain = _normal_equations(patch, samples, columns, bounds.noise)
        step, posterior = _solve(normal, right, scale, place, basis, precision[:, :free])
        place = _moved(place, step, basis, arc, bounds, patch.angle_rad)
    covariance = np.linalg.inv(posterior)
    across = covariance[:, 3, 3] if free > 3 else 0.0
    sigma = np.sqrt(speed(arc, place.planes @ arc.rotated) ** 2 * covariance[:, 0, 0] + across)
    return Refined(place=place, sigma_rad=sigma, gain=gain)


def photometric(
    weight: Floats, seen: Floats, wanted: Floats, gains: tuple[Floats, Floats] | None = None
) -> tuple[Floats, Floats]:
    """Fit gain and offset that bring the view to the patch.

    Parameters
    ----------
    weight, seen : float32 (k, n)
        Weights and the view's grey values.
    wanted : float32 (n,)
        The patch's grey values.
    gains : (float32 (k,), float32 (k,)), optional
        Least and greatest gain allowed.

    Returns
    -------
    (float32 (k,), float32 (k, n))
        The gain, and what of the patch is left unexplained.
    """
    weighted = weight * seen
    wanted_once = np.ones((len(wanted), 2), np.float32)
    wanted_once[:, 1] = wanted
    total, mean_wanted = (weight @ wanted_once).T
    total = np.maximum(total, np.float32(1e-9))
    mean_seen, product = (weighted @ wanted_once).T / total
    mean_wanted = mean_wanted / total
    power = np.einsum("kn,kn->k", weighted, seen) / total - mean_seen * mean_seen
    gain = (product - mean_seen * mean_wanted) / np.maximum(power, np.float32(1e-3))
    if gains is not None:
        gain = np.minimum(np.maximum(gain, gains[0]), gains[1])
    residual = wanted - gain[:, None] * seen
    residual -= (mean_wanted - gain * mean_seen)[:, None]
    return gain, residual


def _basis(ray: Array) -> Array:
    first = cross(ray, np.eye(3)[int(np.argmin(np.abs(ray)))])
    first = first / np.sqrt(first @ first)
    return np.stack([ray, first, cross(ray, first)], axis=1)


def _prior_precision(inverse_range: Array, bounds: Bounds) -> Array:
    """(k, 5) inverse variances of range, slopes, offset and roll."""
    low, high = bounds.inverse_range
    interval = max(high - low, 1e-6)
    slope = SLOPE_SIGMA * np.maximum(np.abs(inverse_range), 0.1 * interval)
    offset = max(bounds.band_rad / 2.0, 1e-6)
    roll = max(bounds.band_rad / 3.0, 1e-6)
    ones = np.ones_like(inverse_range)
    return np.stack([ones / interval**2, slope**-2, slope**-2, ones / offset**2, ones / roll**2], axis=1)


def _columns(
    view: WorkingView, turning: Array | None, along: Array, samples: Samples, coefficients: Floats, rays: Floats
) -> Floats:
    """Derivatives of the sampled grey values by the parameters, then those values and 1: (k, p + 2, n).

    ``turning`` holds the changes per offset and per roll (k, 2, 3, 3), nothing when both are held.
    """
    slope_x, slope_y = view.slopes(samples)
    slope_x, slope_y = slope_x * samples.inverse_depth, slope_y * samples.inverse_depth
    axial = -(slope_x * samples.x + slope_y * samples.y)
    # d grey = [gx, gy, -(gx x + gy y)] · dh / depth, dh the change of the homogeneous pixel
    drift = (along @ view.pixels_from_head.T).astype(np.float32)[:, :, None]
    free = 3 if turning is None else 5
    columns = np.empty((len(drift), free + 2, slope_x.shape[1]), np.float32)
    per_range = slope_x * drift[:, 0] + slope_y * drift[:, 1] + axial * drift[:, 2]
    np.multiply(per_range[:, None], coefficients, out=columns[:, :3])
    if turning is not None:
        moved = (view.pixels_from_head @ turning).astype(np.float32).reshape(-1, 3) @ rays.T
        moved = moved.reshape(len(drift), 2, 3, -1)
        np.multiply(moved[:, :, 0], slope_x[:, None], out=columns[:, 3:5])
        columns[:, 3:5] += moved[:, :, 1] * slope_y[:, None]
        columns[:, 3:5] += moved[:, :, 2] * axial[:, None]
    columns[:, free] = samples.grey - samples.grey.mean(axis=1, keepdims=True)
    columns[:, free + 1] = 1.0
    return columns


def _normal_equations(
    patch: Patch, samples: Samples, columns: Floats, noise: float
) -> tuple[Array, Array, Array, Floats]:
    """Normal equations (k, p, p) and (k, p) without gain and offset, what makes them information, the gain, (k,)."""
    base = samples.inside * patch.weight
    _, residual = photometric(base, samples.grey, patch.grey)
    weight = base * _support(residual, patch.shape, noise)
    gain, residual = photometric(weight, samples.grey, patch.grey)
    free = columns.shape[1] - 2
    weighted = columns * weight[:, None, :]
    hessian = (weighted @ columns.transpose(0, 2, 1)).astype(np.float64)
    gradient = (weighted @ residual[..., None])[..., 0].astype(np.float64)
    mixed = _two_by_two(hessian[:, free:, free:]) @ hessian[:, free:, :free]
    by_gain = gain.astype(np.float64)
    index = np.arange(free)
    hessian[:, index, index] *= 1.0 + RIDGE
    normal = (hessian[:, :free, :free] - hessian[:, :free, free:] @ mixed) * (by_gain * by_gain)[:, None, None]
    # the residual is what a fit of gain and offset left: nothing of it lies along those two columns
    right = gradient[:, :free] * by_gain[:, None]
    total = np.maximum(hessian[:, -1, -1], 1e-9)
    variance = (weight * residual)[:, None, :] @ residual[..., None]
    variance = variance[:, 0, 0] / total + noise * noise
    effective = total * total / np.maximum(np.einsum("kn,kn->k", weight, weight), 1e-12)
    return normal, right, effective / (variance * total), gain


def _two_by_two(matrices: Array) -> Array:
    """Inverses of symmetric positive matrices (k, 2, 2)."""
    a, b, c = matrices[:, 0, 0] + 1e-9, matrices[:, 0, 1], matrices[:, 1, 1] + 1e-9
    inverse = np.empty_like(matrices)
    inverse[:, 0, 0], inverse[:, 1, 1] = c, a
    inverse[:, 0, 1] = inverse[:, 1, 0] = -b
    return np.asarray(inverse / np.maximum(a * c - b * b, 1e-18)[:, None, None])


def _support(residual: Floats, shape: tuple[int, int], noise: float) -> Floats:
    """Robust weight of each sample: Geman-McClure on squares averaged over the neighbours, since occluders are wide."""
    square = residual * residual
    stacked = square.reshape(-1, shape[1])
    smooth: Floats = cv2.blur(stacked, (3, 1)).reshape(-1, *shape)
    smooth[:, 1:-1] = (smooth[:, :-2] + smooth[:, 1:-1] + smooth[:, 2:]) / 3.0
    flat = smooth.reshape(len(square), -1)
    half = flat.shape[1] // 2
    scale = ROBUST_SCALE**2 * np.maximum(np.partition(flat, half, axis=1)[:, half], noise * noise)
    lost = 1.0 + flat / scale[:, None]
    return np.asarray(1.0 / (lost * lost))


def _solve(
    normal: Array, right: Array, scale: Array, place: Place, basis: Array, precision: Array
) -> tuple[Array, Array]:
    """Step (k, 5), zero for what is held, and inverse covariance (k, p, p)."""
    free = normal.shape[1]
    state = np.concatenate([place.planes @ basis, place.offset[:, None], place.roll[:, None]], axis=1)
    pull = -precision * state[:, :free]
    pull[:, 0] = 0.0
    posterior = normal * scale[:, None, None]
    diagonal = np.arange(free)
    posterior[:, diagonal, diagonal] += precision
    damped = posterior.copy()
    damped[:, diagonal, diagonal] *= 1.0 + DAMPING
    step = np.zeros_like(state)
    step[:, :free] = np.linalg.solve(damped, (right * scale[:, None] + pull)[..., None])[..., 0]
    return step, posterior


def _moved(place: Place, step: Array, basis: Array, arc: EpipolarArc, bounds: Bounds, step_rad: float) -> Place:
    rate = speed(arc, place.planes @ arc.rotated)
    travel = np.abs(step[:, 0]) * rate + np.abs(step[:, 3])
    step = step * np.minimum(1.0, LARGEST_MOVE_STEPS * step_rad / np.maximum(travel, 1e-12))[:, None]
    local = place.planes @ basis + step[:, :3]
    slack = step_rad / np.maximum(rate, 1e-3)
    low, high = bounds.inverse_range
    local[:, 0] = np.minimum(np.maximum(local[:, 0], low - slack), high + slack)
    band = bounds.band_rad + step_rad
    offset = np.minimum(np.maximum(place.offset + step[:, 3], -band), band)
    return Place(planes=local @ basis.T, offset=offset, roll=place.roll + step[:, 4])
