"""What the box's centre itself shows, where the box holds surfaces at several ranges.

The set point is the surface seen at the centre, but the whole box votes for its largest surface. Smaller windows around
the centre are searched along the arc, offset and roll kept (they belong to the calibration, not to the surface); a
window moves the answer only when its pixels say so beyond what trying many ranges gives by chance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Floats, Index
from ptzd.matching.place import Place, in_blocks
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
LEAST_THINNED = 12
"""Grid steps along the shorter side."""
CORRELATED = 5.0
"""Samples that carry one independent piece of evidence: the low-pass ties neighbours together."""
OTHERS_COST = 3.0
COSTS = (0.0, 2.0, OTHERS_COST, 12.0)
"""Log-likelihood that a window must add to move the answer: stay; slopes and range of its own nearby; the range of any
candidate of the whole region; any range at all, of which there are many and most windows fit somewhere by chance."""
MODEL_ERROR = 0.1
"""Residual that a true match leaves (bent surfaces, other light, sampling), as a share of the window's contrast."""
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
    gains = np.sort(np.stack([outer.gain / GAIN_SPAN, outer.gain * GAIN_SPAN]), axis=0)
    own = np.tile(place.planes @ arc.rotated, (count, 1))
    anywhere = np.tile(ranges, (count, 1))
    for share in WINDOWS:
        window = central_window(patch, share)
        if window is None:
            break
        look = Look(window=window, view=view, arc=arc, noise=bounds.noise, gains=gains)
        quick = replace(look, window=_thinned(window))
        costs = [cost for cost in COSTS if count > 1 or cost != OTHERS_COST]
        start = place if count == 1 else place.join(quick.best_range(place, own))
        start = start.join(quick.best_range(place, anywhere))
        tried = refine(window, view, arc, start, bounds, ITERATIONS, hold=True)
        everything = place.join(tried.place)
        evidence = look.evidence(everything).reshape(len(costs), count) - np.array(costs)[:, None]
        pick = np.argmax(evidence, axis=0) * count + np.arange(count)
        sigma = np.concatenate([sigma, tried.sigma_rad])[pick]
        place = everything.take(pick)
    return place, sigma


def _thinned(window: Patch) -> Patch:
    """Every second sample both ways of a window that has plenty: enough to choose a range to start from."""
    rows, columns = window.shape
    if min(window.shape) < LEAST_THINNED:
        return window
    index = (np.arange(0, rows, 2)[:, None] * columns + np.arange(0, columns, 2)).ravel()
    weight = window.weight[index]
    return replace(
        window,
        grey=window.grey[index],
        rays=window.rays[index],
        weight=weight / weight.sum(),
        shape=(-(-rows // 2), -(-columns // 2)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """A window and how well places explain it."""

    window: Patch
    view: WorkingView
    arc: EpipolarArc
    noise: float
    gains: Floats
    """(2, k) least and greatest gain of each candidate."""

    def best_range(self, place: Place, ranges: Array) -> Place:
        """Put each of k candidates at the one of its inverse ranges (k, m) that explains the window best."""
        count, tried = ranges.shape
        everything = Place(
            planes=ranges.reshape(-1, 1) * self.arc.rotated,
            offset=np.repeat(place.offset, tried),
            roll=np.repeat(place.roll, tried),
        )
        order = np.repeat(np.arange(count), tried)
        chosen = self.evidence(everything, order).reshape(count, tried).argmax(axis=1)
        return Place(
            planes=ranges[np.arange(count), chosen][:, None] * self.arc.rotated, offset=place.offset, roll=place.roll
        )

    def evidence(self, place: Place, owner: Index | None = None) -> Floats:
        """Log-likelihood of the window's grey values up to gain and offset; -inf where half is out of view.

        Cauchy's distribution: of two surfaces in the window the one that is matched counts, the other costs little.

        ``owner`` says whose gains apply to each place; without it the places are the k candidates several times.
        """
        if owner is None:
            owner = np.arange(len(place.offset)) % self.gains.shape[1]
        whose = owner
        return in_blocks(lambda part: self._evidence(place.take(part), whose[part]), len(whose), len(self.window.rays))

    def _evidence(self, place: Place, owner: Index) -> Floats:
        samples = self.view.sample(place.warps(self.arc), self.window.rays)
        weight = samples.inside * self.window.weight
        total = weight.sum(axis=1)
        low, high = self.gains[:, owner]
        width = 2.0 * (self.noise**2 + (MODEL_ERROR * float(self.window.grey.std())) ** 2)
        _, residual = photometric(weight, samples.grey, self.window.grey, (low, high))
        trusted = weight / (1.0 + residual * residual / width)
        _, residual = photometric(trusted, samples.grey, self.window.grey, (low, high))
        lost = np.einsum("kn,kn->k", weight, np.log(1.0 + residual * residual / width)) / np.maximum(total, 1e-9)
        independent = 1.0 / float((self.window.weight**2).sum()) / CORRELATED
        return np.where(total > 0.5, -independent * lost, -np.inf)
