"""What is expected of the range along one fisheye ray: a few humps over inverse range, and the rest anywhere.

Two kinds of witness speak. Each near lock says: here is my surface, the less surely the further I am away. And since
the inverse range of a plane is linear in the unit ray, ``s = N·P`` (the paper's N, eq. 6), three near locks that stand
on one wall or floor say where it goes on; of all such planes the one counts that most of the others agree with. Two
surfaces in one direction (somebody before a wall) are two humps. At least a quarter stays anywhere: what is looked for
may be something new.

Figures: ``python -m tests.bench.ranges``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import cross
from ptzd.geometry.types import Array

ANYWHERE_SHARE = 0.25
"""Least share that no hump has."""
TRUSTED_RAD = math.radians(8.0)
"""A lock this far away says half of what one in the very direction says."""
CLOSE_RAD = math.radians(1.0)
"""Among witnesses nearness counts by the square of the angle; below this all are the same."""
SLOPE = 1.0
"""How much of itself an inverse range commonly changes per rad: a floor's does so by the tangent of its obliqueness."""
AGREE_SHARE, AGREE_LEAST = 0.03, 0.003
"""A lock agrees with a plane within this share of its inverse range and this much of the inverse baseline beside."""
PLANE_SHARE = 0.7
"""Of the humps together, what a plane has with which all witnesses agree."""
FLAT = 2e-4
"""Determinant of three unit rays below which they are too near to one great circle to tell a plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hump:
    """Somewhere a surface is expected."""

    mean: float
    """Inverse range."""
    sigma: float
    share: float
    """Of all that is possible along the ray."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """The spread over inverse range along one ray; whatever the humps' shares leave is anywhere."""

    humps: tuple[Hump, ...]

    @property
    def known(self) -> float:
        """Share of the humps together, 0 (nothing is known) to 1 - `ANYWHERE_SHARE`."""
        return sum(hump.share for hump in self.humps)

    def along(self, arc: EpipolarArc) -> ExpectedOnArc:
        """The same over angles along an arc, cut to its ends."""
        return ExpectedOnArc(expected=self, arc=arc)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedOnArc:
    """Where on an arc the target is expected: "anywhere" is even in angle, which is what a look covers."""

    expected: Expected
    arc: EpipolarArc

    def mass(self, low: float, high: float) -> float:
        """Share in an interval of inverse range, 0 to 1; what humps have outside the arc is anywhere on it."""
        low, high = max(low, self.arc.s_min), min(high, self.arc.s_max)
        if low > high or (low == high and self.arc.s_min < self.arc.s_max):
            return 0.0
        first, last, here, there = self.arc.angle_at([self.arc.s_min, self.arc.s_max, low, high]).tolist()
        even = (there - here) / (last - first) if last > first else 1.0
        inside = sum(hump.share * _between(hump, self.arc.s_min, self.arc.s_max) for hump in self.expected.humps)
        humps = sum(hump.share * _between(hump, low, high) for hump in self.expected.humps)
        return float(humps + (1.0 - inside) * even)

    def density(self, inverse_range: float) -> float:
        """How much likelier a place is than if nothing were known; 1 where that is so, at least `ANYWHERE_SHARE`."""
        if self.arc.degenerate or self.arc.s_min == self.arc.s_max:
            return 1.0
        first, last = self.arc.angle_at([self.arc.s_min, self.arc.s_max]).tolist()
        inside = sum(hump.share * _between(hump, self.arc.s_min, self.arc.s_max) for hump in self.expected.humps)
        per_angle = self._per_angle(inverse_range)
        humps = sum(hump.share * _bell(hump, inverse_range) for hump in self.expected.humps)
        return float(1.0 - inside + humps * per_angle * (last - first))

    def likeliest(self) -> float | None:
        """Inverse range of the hump around which most is expected, within the arc; None when no hump lies on it."""
        inside = [hump for hump in self.expected.humps if self.arc.s_min <= hump.mean <= self.arc.s_max]
        return max((hump.mean for hump in inside), key=self.density, default=None)

    def _per_angle(self, inverse_range: float) -> float:
        """Change of inverse range per rad along the arc."""
        arc = self.arc
        point = arc.rotated + inverse_range * arc.translation
        return float(point @ point) / max(float(arc.translation @ arc.forward), 1e-12)


def expect(
    *,
    apart_rad: Array,
    ray: Array,
    rays: Array,
    inverse_ranges: Array,
    sigmas: Array,
    weights: Array,
    baseline: float,
) -> Expected:
    """What the n nearest locks say of one ray.

    Parameters
    ----------
    apart_rad : float64 (n,)
        Angle of each from the ray.
    ray : float64 (3,)
        Unit, fisheye frame.
    rays : float64 (n, 3)
        Theirs.
    inverse_ranges, sigmas, weights : float64 (n,)
        What they measured, how well, and what they still count, in (0, 1].
    baseline : float
        Between the two cameras, in the unit of the ranges.
    """
    trust = weights * np.exp2(-((apart_rad / TRUSTED_RAD) ** 2))
    known = (1.0 - ANYWHERE_SHARE) * -math.expm1(-2.0 * float(trust.sum()))
    if known < 1e-3:
        return Expected(humps=())
    nearness = weights / (apart_rad * apart_rad + CLOSE_RAD * CLOSE_RAD)
    shares = nearness / nearness.sum()
    errors = np.hypot(sigmas, AGREE_LEAST / baseline)
    plane = _plane(ray, rays, inverse_ranges, errors, trust / trust.sum())
    spread = np.hypot(errors, SLOPE * inverse_ranges * apart_rad)
    left = 1.0 - (0.0 if plane is None else plane.share)
    humps = [
        Hump(mean=float(mean), sigma=float(sigma), share=float(known * left * share))
        for mean, sigma, share in zip(inverse_ranges, spread, shares, strict=True)
    ]
    if plane is not None:
        humps.append(Hump(mean=plane.mean, sigma=plane.sigma, share=known * plane.share))
    return Expected(humps=tuple(humps))


def _plane(ray: Array, rays: Array, means: Array, errors: Array, trust: Array) -> Hump | None:
    """Where the plane that most witnesses agree with meets the ray; its share is one of all humps."""
    triples = np.array(list(combinations(range(len(means)), 3)), dtype=np.intp).reshape(-1, 3)
    first, second, third = (rays[triples[:, k]] for k in range(3))
    crossed = np.stack([cross(second, third), cross(third, first), cross(first, second)], axis=1)
    determinant = (first * crossed[:, 0]).sum(axis=1)
    steep = np.abs(determinant) > FLAT
    if len(means) < 4 or not steep.any():
        return None
    # Cramer's rule: N·P = s for each of the three
    normals = (means[triples[steep]][:, :, None] * crossed[steep]).sum(axis=1) / determinant[steep][:, None]
    tolerance = np.hypot(AGREE_SHARE * means, errors)
    off = (normals @ rays.T - means) / tolerance
    support = (trust * np.exp(-0.5 * off * off)).sum(axis=1)
    best = int(np.argmax(support))
    agree = np.abs(off[best]) < 2.0
    scale = np.sqrt(trust[agree]) / tolerance[agree]
    normal = np.linalg.lstsq(rays[agree] * scale[:, None], means[agree] * scale, rcond=None)[0]
    mean = float(normal @ ray)
    if mean < 0.0:
        return None
    sigma = math.hypot(AGREE_SHARE * mean, float(errors[agree].min()))
    return Hump(mean=mean, sigma=sigma, share=PLANE_SHARE * float(support[best]))


def _bell(hump: Hump, inverse_range: float) -> float:
    off = (inverse_range - hump.mean) / hump.sigma
    return math.exp(-0.5 * off * off) / (hump.sigma * math.sqrt(2.0 * math.pi))


def _between(hump: Hump, low: float, high: float) -> float:
    """Share of a hump between two inverse ranges."""
    scale = hump.sigma * math.sqrt(2.0)
    return 0.5 * (math.erf((high - hump.mean) / scale) - math.erf((low - hump.mean) / scale))
