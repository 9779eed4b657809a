"""Where along and across the epipolar arc a region may be, and the warp each place implies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ptzd.geometry.plane import homography
from ptzd.geometry.sphere import cross, normalise

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array

_DENSE = 257


def skew(vectors: Array) -> Array:
    """Return the cross-product matrices (k, 3, 3) of vectors (k, 3)."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, 2, 1], matrices[:, 0, 2], matrices[:, 1, 0] = vectors.T
    matrices -= matrices.transpose(0, 2, 1)
    return matrices


def turns(arc: EpipolarArc, inverse_range: Array, offset: Array, roll: Array) -> Array:
    """Return rotations (k, 3, 3): the roll about the arc's point, then the offset across the arc, rad."""
    return turns_at(_points(arc, inverse_range), arc.normal, offset, roll)


def turns_at(points: Array, normal: Array, offset: Array, roll: Array) -> Array:
    """Return the rotations of `turns` for points (k, 3) of the arc with its normal (3,): Rodrigues, twice.

    The offset turns in the plane of point p and normal n: ``I + sin (n pᵀ - p nᵀ) + (cos - 1)(p pᵀ + n nᵀ)``.
    """
    outer = normal[:, None] * points[:, None, :]
    own = points[:, :, None] * points[:, None, :]
    sine, lost = np.sin(offset)[:, None, None], (np.cos(offset) - 1.0)[:, None, None]
    turn = np.eye(3) + sine * (outer - outer.transpose(0, 2, 1)) + lost * (own + normal[:, None] * normal)
    if not roll.any():
        return np.asarray(turn)
    sine, cosine = np.sin(roll)[:, None, None], np.cos(roll)[:, None, None]
    return np.asarray(turn @ (cosine * np.eye(3) + sine * skew(points) + (1.0 - cosine) * own))


def _points(arc: EpipolarArc, inverse_range: Array) -> Array:
    sums = arc.rotated + inverse_range[:, None] * arc.translation
    return np.asarray(sums / np.sqrt((sums * sums).sum(axis=1))[:, None])


def warps(arc: EpipolarArc, planes: Array, offset: Array, roll: Array) -> Array:
    """Return the head-frame directions of pre-rotated fisheye rays: ``turns · (I + T Nᵀ)``, (k, 3, 3).

    Parameters
    ----------
    arc : EpipolarArc
        Of the box's centre.
    planes : float64 (k, 3)
        N of each hypothesis (paper, eq. 6).
    offset : float64 (k,)
        Across the arc, rad: what is wrong with the extrinsics.
    roll : float64 (k,)
        About the line of sight, rad: likewise.
    """
    return np.asarray(turns(arc, planes @ arc.rotated, offset, roll) @ homography(arc.translation, planes))


def motions(arc: EpipolarArc, planes: Array, offset: Array, roll: Array, warp: Array) -> tuple[Array, Array, Array]:
    """Return how the warped rays change at a warp that these parameters gave.

    Returns
    -------
    (float64 (k, 3), float64 (k, 3, 3), float64 (k, 3, 3))
        Change per inverse range of a ray; matrices that give the change per offset and per roll from the ray.
    """
    points = _points(arc, planes @ arc.rotated)
    aimed = np.cos(offset)[:, None] * points + np.sin(offset)[:, None] * arc.normal
    along = turns_at(points, arc.normal, offset, roll) @ arc.translation
    return along, skew(cross(points, arc.normal)) @ warp, skew(aimed) @ warp


def bearings(arc: EpipolarArc, planes: Array, offset: Array) -> Array:
    """Return the head-frame directions (k, 3) of the box's centre."""
    points = _points(arc, planes @ arc.rotated)
    return np.asarray(np.cos(offset)[:, None] * points + np.sin(offset)[:, None] * arc.normal)


def speed(arc: EpipolarArc, inverse_range: Array) -> Array:
    """Return the angle that the centre moves per unit of inverse range, (k,)."""
    point = arc.rotated + inverse_range[:, None] * arc.translation
    sine = float(np.linalg.norm(cross(arc.rotated, arc.translation)))
    return np.asarray(sine / np.maximum((point * point).sum(axis=1), 1e-12))


def sample_inverse_ranges(probes: Array, translation: Array, interval: tuple[float, float], step_rad: float) -> Array:
    """Return inverse ranges so that no probe moves further than a step between neighbours.

    Parameters
    ----------
    probes : float64 (m, 3)
        Pre-rotated unit rays: the box's centre and corners, so that a region around the epipole, whose centre stays,
        is searched by its rim.
    translation : float64 (3,)
        T.
    interval : (float, float)
        Least and greatest inverse range; 0 is infinitely far.
    step_rad : float
        Greatest angle between neighbours.

    Returns
    -------
    float64 (k,)
        Growing, ends included; one value when the interval or the motion is nil.
    """
    low, high = interval
    baseline = float(np.linalg.norm(translation))
    share = np.linspace(low * baseline / (1 + low * baseline), high * baseline / (1 + high * baseline), _DENSE)
    dense = share / (1 - share) / baseline
    path = normalise(probes[None] + dense[:, None, None] * translation)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=-1).max(axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    count = math.ceil(travelled[-1] / step_rad) + 1
    if count == 1:
        return np.array([0.5 * (low + high)])
    return np.interp(np.linspace(0.0, travelled[-1], count), travelled, dense)


def sample_offsets(band_rad: float, step_rad: float) -> Array:
    """Return offsets across the arc, symmetric about 0, no further than a step apart, ends included."""
    half = math.ceil(band_rad / step_rad - 1e-9)
    return np.linspace(-band_rad, band_rad, 2 * half + 1) if half > 0 else np.zeros(1)
