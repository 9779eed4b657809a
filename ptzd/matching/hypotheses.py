"""Where along and across the epipolar arc a region may be, and the warp each place implies."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.geometry.sphere import normalise

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array

_DENSE = 257


def skew(vectors: Array) -> Array:
    """Return the cross-product matrices (..., 3, 3) of vectors (..., 3)."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    matrices = np.zeros((*vectors.shape, 3))
    matrices[..., 2, 1], matrices[..., 0, 2], matrices[..., 1, 0] = x, y, z
    matrices[..., 1, 2], matrices[..., 2, 0], matrices[..., 0, 1] = -x, -y, -z
    return matrices


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Rotations at k points of the arc: the roll about the point, then the offset across the arc."""

    axes: Array
    """(k, 3, 3) rows: the point p, the arc's normal n, p x n."""
    turned: Array
    """(k, 3, 3) rows: where the rotation takes the axes; the first is the bearing of the box's centre."""

    @property
    def rotation(self) -> Array:
        """The rotations (k, 3, 3)."""
        return np.asarray(self.turned.transpose(0, 2, 1) @ self.axes)


def turns(arc: EpipolarArc, inverse_range: Array, offset: Array, roll: Array) -> Turned:
    """Return the rotations at inverse ranges (k,) with offsets and rolls (k,), rad."""
    points = _points(arc, inverse_range)
    axes = np.empty((len(points), 3, 3))
    axes[:, 0], axes[:, 1], axes[:, 2] = points, arc.normal, points @ _crossing(arc.normal)
    mix = np.zeros_like(axes)
    sine, cosine = np.sin(offset), np.cos(offset)
    mix[:, 0, 0], mix[:, 0, 1] = cosine, sine
    if roll.any():
        roll_sine, roll_cosine = np.sin(roll), np.cos(roll)
        mix[:, 1, 0], mix[:, 1, 1], mix[:, 1, 2] = -roll_cosine * sine, roll_cosine * cosine, roll_sine
        mix[:, 2, 0], mix[:, 2, 1], mix[:, 2, 2] = roll_sine * sine, -roll_sine * cosine, roll_cosine
    else:
        mix[:, 1, 0], mix[:, 1, 1], mix[:, 2, 2] = -sine, cosine, 1.0
    return Turned(axes=axes, turned=mix @ axes)


def _crossing(vector: Array) -> Array:
    """Matrix (3, 3) that takes the row x to ``x x vector``."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


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
    rotation = turns(arc, planes @ arc.rotated, offset, roll).rotation
    return np.asarray(rotation + (rotation @ arc.translation)[:, :, None] * planes[:, None, :])


def motions(arc: EpipolarArc, planes: Array, offset: Array, roll: Array) -> tuple[Array, Array]:
    """Return warps and how the warped rays change with the parameters.

    Returns
    -------
    (float64 (k, 3, 3, 3), float64 (k, 3))
        Three matrices each: the warp, the change per offset and per roll of the ray it is applied to; change per
        inverse range of a ray.
    """
    turn = turns(arc, planes @ arc.rotated, offset, roll)
    rotation = turn.rotation
    along = np.asarray(rotation @ arc.translation)
    matrices = np.empty((len(along), 3, 3, 3))
    matrices[:, 0] = rotation + along[:, :, None] * planes[:, None, :]
    matrices[:, 1:] = skew(np.stack([turn.axes[:, 2], turn.turned[:, 0]], axis=1)) @ matrices[:, :1]
    return matrices, along


def bearings(arc: EpipolarArc, planes: Array, offset: Array) -> Array:
    """Return the head-frame directions (k, 3) of the box's centre."""
    points = _points(arc, planes @ arc.rotated)
    return np.asarray(np.cos(offset)[:, None] * points + np.sin(offset)[:, None] * arc.normal)


def speed(arc: EpipolarArc, inverse_range: Array) -> Array:
    """Return the angle that the centre moves per unit of inverse range, (k,)."""
    point = arc.rotated + inverse_range[:, None] * arc.translation
    along = float(arc.rotated @ arc.translation)
    sine = math.sqrt(max(float(arc.translation @ arc.translation) - along * along, 0.0))
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
