"""Gauss-Newton over range, two plane slopes, offset and roll, for many candidates at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.matching.arrays import Floats
from ptzd.matching.hypotheses import motions, speed
from ptzd.matching.place import Place

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import Samples, WorkingView


ROBUST_SCALE = 2.5
"""Residuals beyond this many sigmas lose half their weight and more."""
SLOPE_SIGMA = 1.5
"""Tangent of the obliqueness of the surfaces that are expected, one sigma."""
DAMPING = 0.02
LARGEST_MOVE_STEPS = 1.5
"""Grid steps that the centre may move in one iteration."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bounds:
    """What is known before looking."""

    inverse_range: tuple[float, float]
    band_rad: float
    noise: float
    """One sigma of a sample, grey levels."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refined:
    """Outcome of a refinement of k candidates."""

    place: Place
    sigma_rad: Array
    """(k,) one sigma of the centre's direction from the residuals."""
    support: Floats
    """(k, n) robust weight of each sample in [0, 1]."""


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
        Gauss-Newton steps.
    hold : bool
        Leave offset and roll as they are.
    """
    gradients = _gradients(view.image)
    basis = _basis(arc.rotated)
    coefficients = patch.rays @ basis.astype(np.float32)
    place, precision = start, _prior_precision(start.planes @ arc.rotated, bounds)
    for _ in range(iterations):
        samples = view.sample(place.warps(arc), patch.rays)
        columns = _columns(view, arc, place, samples, gradients, coefficients, patch.rays)
        normal, right, scale, support = _normal_equations(patch, samples, columns, bounds.noise)
        step, covariance = _solve(normal, right, scale, place, basis, precision, 3 if hold else 5)
        place = _moved(place, step, basis, arc, bounds, patch.angle_rad)
    slide = speed(arc, place.planes @ arc.rotated)
    sigma = np.sqrt(slide**2 * covariance[:, 0, 0] + covariance[:, 3, 3])
    return Refined(place=place, sigma_rad=sigma, support=support)


def _gradients(image: Floats) -> Floats:
    return cv2.merge(
        [
            cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125),
            cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=3, scale=0.125),
        ]
    )


def _basis(ray: Array) -> Array:
    helper = np.eye(3)[int(np.argmin(np.abs(ray)))]
    first = np.cross(ray, helper)
    first /= np.linalg.norm(first)
    return np.stack([ray, first, np.cross(ray, first)], axis=1)


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
    view: WorkingView,
    arc: EpipolarArc,
    place: Place,
    samples: Samples,
    gradients: Floats,
    coefficients: Floats,
    rays: Floats,
) -> Floats:
    """Derivatives of the sampled grey values, (k, 5, n)."""
    slopes = cv2.remap(gradients, samples.x, samples.y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    slope_x, slope_y = np.nan_to_num(slopes[..., 0]), np.nan_to_num(slopes[..., 1])
    axial = -(slope_x * samples.x + slope_y * samples.y)
    # d grey = [gx, gy, -(gx x + gy y)] · dh / depth with dh the change of the homogeneous pixel
    slope_x, slope_y, axial = (part * samples.inverse_depth for part in (slope_x, slope_y, axial))
    along, across, roll = motions(arc, place.planes, place.offset, place.roll)
    drift = (view.pixels_from_head @ along[..., None])[..., 0].astype(np.float32)
    per_range = slope_x * drift[:, :1] + slope_y * drift[:, 1:2] + axial * drift[:, 2:]
    turned = []
    for matrices in (across, roll):
        moved = ((view.pixels_from_head @ matrices).astype(np.float32).reshape(-1, 3) @ rays.T).reshape(
            len(along), 3, -1
        )
        turned.append(slope_x * moved[:, 0] + slope_y * moved[:, 1] + axial * moved[:, 2])
    return np.stack([*(per_range * coefficients[:, i] for i in range(3)), *turned], axis=1)


def _normal_equations(
    patch: Patch, samples: Samples, columns: Floats, noise: float
) -> tuple[Array, Array, Array, Floats]:
    """Normal equations (k, 5, 5), (k, 5) without gain and offset, their scale (k,), robust weights (k, n)."""
    base = samples.inside * patch.weight
    _, _, residual = photometric(base, samples.grey, patch.grey)
    support = _support(residual, base, patch.shape, noise)
    weight = base * support
    gain, _, residual = photometric(weight, samples.grey, patch.grey)
    jacobian = columns * gain[:, None, None]
    total = np.maximum(weight.sum(axis=1), 1e-9)
    nuisance = np.stack([samples.grey, np.ones_like(samples.grey)], axis=1)
    full = np.concatenate([jacobian, nuisance], axis=1)
    weighted = full * weight[:, None, :]
    hessian = (weighted @ full.transpose(0, 2, 1)).astype(np.float64)
    gradient = (weighted @ residual[..., None])[..., 0].astype(np.float64)
    inner = hessian[:, 5:, 5:] + np.eye(2) * 1e-9
    mixed = np.linalg.solve(inner, hessian[:, 5:, :5])
    normal = hessian[:, :5, :5] - hessian[:, :5, 5:] @ mixed
    right = gradient[:, :5] - (mixed.transpose(0, 2, 1) @ gradient[:, 5:, None])[..., 0]
    variance = (weight * residual * residual).sum(axis=1) / total + noise * noise
    effective = total**2 / np.maximum((weight * weight).sum(axis=1), 1e-12)
    return normal, right, effective / (variance * total), support


def photometric(weight: Floats, seen: Floats, wanted: Floats) -> tuple[Floats, Floats, Floats]:
    """Gain and offset (k,) that bring the view to the patch, and what is left (k, n)."""
    total = np.maximum(weight.sum(axis=1), 1e-9)
    mean_seen = (weight * seen).sum(axis=1) / total
    mean_wanted = (weight @ wanted) / total
    centred = seen - mean_seen[:, None]
    power = (weight * centred * centred).sum(axis=1) / total
    gain = ((weight * centred) @ wanted) / total / np.maximum(power, 1e-6)
    offset = mean_wanted - gain * mean_seen
    return gain, offset, wanted - gain[:, None] * seen - offset[:, None]


def _support(residual: Floats, base: Floats, shape: tuple[int, int], noise: float) -> Floats:
    """Robust weight of each sample: Geman-McClure on squares averaged over the neighbours, since occluders are wide."""
    square = residual * residual
    smooth = np.stack([cv2.blur(item.reshape(shape), (3, 3)).ravel() for item in square])
    visible = base > 0
    middle = np.array([np.median(row[mask]) if mask.any() else 0.0 for row, mask in zip(smooth, visible, strict=True)])
    scale = ROBUST_SCALE**2 * np.maximum(middle, noise * noise)[:, None]
    return np.asarray(1.0 / (1.0 + smooth / scale) ** 2, dtype=np.float32)


def _solve(
    normal: Array, right: Array, scale: Array, place: Place, basis: Array, precision: Array, free: int
) -> tuple[Array, Array]:
    """Step (k, 5), zero but for the first ``free`` parameters, and covariance (k, 5, 5)."""
    information = normal * scale[:, None, None]
    state = np.concatenate([place.planes @ basis, place.offset[:, None], place.roll[:, None]], axis=1)
    centre = np.zeros_like(state)
    centre[:, 0] = state[:, 0]
    posterior = information + precision[:, :, None] * np.eye(5)
    diagonal = np.diagonal(posterior, axis1=1, axis2=2)[:, :, None] * np.eye(5)
    wanted = right * scale[:, None] + precision * (centre - state)
    damped = (posterior + DAMPING * diagonal)[:, :free, :free]
    step = np.zeros_like(state)
    step[:, :free] = np.linalg.solve(damped, wanted[:, :free, None])[..., 0]
    return step, np.asarray(np.linalg.inv(posterior), dtype=np.float64)


def _moved(place: Place, step: Array, basis: Array, arc: EpipolarArc, bounds: Bounds, step_rad: float) -> Place:
    travel = np.abs(step[:, 0]) * speed(arc, place.planes @ arc.rotated) + np.abs(step[:, 3])
    share = np.minimum(1.0, LARGEST_MOVE_STEPS * step_rad / np.maximum(travel, 1e-12))[:, None]
    step = step * share
    local = place.planes @ basis + step[:, :3]
    slack = step_rad / np.maximum(speed(arc, local[:, 0]), 1e-3)
    low, high = bounds.inverse_range
    local[:, 0] = np.clip(local[:, 0], low - slack, high + slack)
    band = bounds.band_rad + step_rad
    return Place(
        planes=local @ basis.T, offset=np.clip(place.offset + step[:, 3], -band, band), roll=place.roll + step[:, 4]
    )
