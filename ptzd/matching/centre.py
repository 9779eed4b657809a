"""What the box's centre itself shows, where the box holds surfaces at several ranges.

The set point is the surface seen at the centre, but the whole box votes for its largest surface. Smaller windows around
the centre are searched along the arc, offset and roll kept (they belong to the calibration, not to the surface); a
window moves the answer only when its pixels say so beyond what trying many ranges gives by chance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Floats
from ptzd.matching.place import Place
from ptzd.matching.refine import Bounds, Refined, photometric, refine

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import WorkingView

WINDOWS = (0.5, 0.3)
"""Sides of the windows, in sides of the box."""
LEAST_SIDE = 8
"""Grid steps."""
CORRELATED = 5.0
"""Samples that carry one independent piece of evidence: the low-pass ties neighbours together."""
EVIDENCE_TO_ADJUST = 2.0
"""Log-likelihood by which a window must prefer its own range and slopes near the whole region's."""
EVIDENCE_TO_JUMP = 12.0
"""Log-likelihood by which it must prefer a surface at quite another range: many were tried."""
GAIN_SPAN = 1.7
"""How much the gain of a window may differ from that of the region."""
ITERATIONS = 2


def central_window(patch: Patch, share: float) -> Patch | None:
    """Return the middle of a patch, weighted anew, or nothing when that is too small or unseen."""
    rows, columns = patch.shape
    high, wide = (max(round(side * share), min(side, LEAST_SIDE)) for side in patch.shape)
    if high >= rows and wide >= columns:
        return None
    top, left = (rows - high) // 2, (columns - wide) // 2
    index = (np.arange(top, top + high)[:, None] * columns + np.arange(left, left + wide)).ravel()
    x, y = np.meshgrid(np.linspace(-1, 1, wide), np.linspace(-1, 1, high))
    weight = np.where(patch.weight[index] > 0, np.exp(-(x * x + y * y).ravel()), 0.0)
    total = float(weight.sum())
    if total <= 0.0:
        return None
    return replace(
        patch,
        grey=patch.grey[index],
        rays=patch.rays[index],
        weight=(weight / total).astype(np.float32),
        shape=(high, wide),
    )


def settle_on_centre(
    patch: Patch, view: WorkingView, arc: EpipolarArc, outer: Refined, bounds: Bounds, ranges: Array
) -> tuple[Place, Array]:
    """Move candidates to the surface at the box's centre where smaller windows say so.

    Parameters
    ----------
    patch : Patch
        The whole region.
    view : WorkingView
        Low-passed to the patch's grid.
    arc : EpipolarArc
        Of the box's centre.
    outer : Refined
        k candidates refined on the whole region.
    bounds : Bounds
        Interval and noise.
    ranges : float64 (m,)
        Inverse ranges to try, less than a grid step apart.

    Returns
    -------
    (Place, float64 (k,))
        The candidates where the centre's surface is, and one sigma of their directions, rad.
    """
    place, sigma = outer.place, outer.sigma_rad
    count = len(sigma)
    gains = _allowed_gains(patch, view, arc, place)
    for share in WINDOWS:
        window = central_window(patch, share)
        if window is None:
            break
        start = place.join(_best_range(window, view, arc, place, ranges, bounds.noise, gains))
        tried = refine(window, view, arc, start, bounds, ITERATIONS, hold=True)
        evidence = _evidence(window, view, arc, place.join(tried.place), bounds.noise, np.tile(gains, 3)).reshape(
            3, count
        )
        evidence -= np.array([[0.0], [EVIDENCE_TO_ADJUST], [EVIDENCE_TO_JUMP]])
        pick = np.argmax(evidence, axis=0) * count + np.arange(count)
        sigma = np.concatenate([sigma, tried.sigma_rad])[pick]
        place = place.join(tried.place).take(pick)
    return place, sigma


def _allowed_gains(patch: Patch, view: WorkingView, arc: EpipolarArc, place: Place) -> Floats:
    """Least and greatest gain of a window, (2, k): near the whole region's: light and camera are the same."""
    samples = view.sample(place.warps(arc), patch.rays)
    gain, _ = photometric(samples.inside * patch.weight, samples.grey, patch.grey)
    return np.sort(np.stack([gain / GAIN_SPAN, gain * GAIN_SPAN]), axis=0)


def _best_range(
    window: Patch, view: WorkingView, arc: EpipolarArc, place: Place, ranges: Array, noise: float, gains: Floats
) -> Place:
    count = len(place.offset)
    everything = Place(
        planes=np.tile(ranges[:, None] * arc.rotated, (count, 1)),
        offset=np.repeat(place.offset, len(ranges)),
        roll=np.repeat(place.roll, len(ranges)),
    )
    evidence = _evidence(window, view, arc, everything, noise, np.repeat(gains, len(ranges), axis=1)).reshape(
        count, len(ranges)
    )
    chosen = evidence.argmax(axis=1)
    return Place(planes=ranges[chosen][:, None] * arc.rotated, offset=place.offset, roll=place.roll)


def _evidence(window: Patch, view: WorkingView, arc: EpipolarArc, place: Place, noise: float, gains: Floats) -> Floats:
    """Log-likelihood of the window's grey values up to gain and offset; -inf where half is out of view."""
    samples = view.sample(place.warps(arc), window.rays)
    weight = samples.inside * window.weight
    total = weight.sum(axis=1)
    _, residual = photometric(weight, samples.grey, window.grey, (gains[0], gains[1]))
    variance = (weight * residual * residual).sum(axis=1) / np.maximum(total, 1e-9) + noise * noise
    independent = 1.0 / float((window.weight**2).sum()) / CORRELATED
    return np.where(total > 0.5, -0.5 * independent * np.log(variance), -np.inf)
