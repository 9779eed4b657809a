"""How far away things are in a scene, learned: the ranges of confirmed locks, by direction of the fisheye.

A scene stands still for hours, what moves in it does not. So every lock is kept as it was measured, newer ones count
more, and what is expected in a direction is worked out when it is asked for (`ptzd.control.planning.expected`). All
ages are in the daemon's steady time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ptzd.control.planning.expected import Expected, expect
from ptzd.geometry.types import Array, Mask

MOST_LOCKS = 512
"""Kept at most; a look-up stays under a millisecond, a snapshot under 100 kB."""
SAME_DIRECTION_RAD = 0.02
"""Once the map is full, a new lock displaces the oldest one within about five fisheye pixels, if there is one."""
HOUR_NS = 3_600_000_000_000


NEAREST = 10
"""Locks that have a say in one direction."""
REACH_RAD = math.radians(30.0)
"""Locks further away say nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeLock:
    """One confirmed lock, as far as it teaches a range."""

    id: str
    """Of its request."""
    ray: tuple[float, float, float]
    """Unit, fisheye frame."""
    inverse_range: float
    """1/range along the ray, in the inverse unit of T, at least 0."""
    sigma: float
    """One sigma of it, from the triangulation."""
    t_ns: int
    """When it was confirmed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownRange:
    """What one lock has taught, for a person."""

    id: str
    x_px: float
    """Where it lies in the fisheye's picture."""
    y_px: float
    range_m: float | None
    """In baselines on a rig without scale; None: infinite."""
    sigma_share: float
    """One sigma, as a share of the range."""
    learned_ns: int
    weight: float
    """What it still counts, in (0, 1]."""


@dataclass(slots=True, kw_only=True)
class RangeMap:
    """All that is known, oldest first; plain values, so that a snapshot holds it."""

    locks: list[RangeLock] = field(default_factory=list)

    def learn(self, lock: RangeLock) -> None:
        """Take a lock in; a full map loses the oldest one of this direction, or else the oldest of all."""
        if len(self.locks) >= MOST_LOCKS:
            near = np.flatnonzero(self._apart_rad(lock.ray) <= SAME_DIRECTION_RAD)
            del self.locks[int(near[0]) if len(near) else 0]
        self.locks.append(lock)

    def forget_last(self, count: int) -> list[RangeLock]:
        """Take back what the newest locks taught; returns them, oldest first."""
        kept = max(len(self.locks) - count, 0)
        forgotten, self.locks[:] = self.locks[kept:], self.locks[:kept]
        return forgotten

    def forget_where(self, inside: Callable[[Array], Mask]) -> list[RangeLock]:
        """Take back what was learned in the directions, rays ``(n, 3)``, that this says yes to; returns it."""
        gone = inside(self._rays())
        forgotten = [lock for lock, is_gone in zip(self.locks, gone, strict=True) if is_gone]
        self.locks[:] = [lock for lock, is_gone in zip(self.locks, gone, strict=True) if not is_gone]
        return forgotten

    def weights(self, t_ns: int, half_life_h: float) -> Array:
        """What each lock still counts at a time, ``(n,)`` in (0, 1]: half after every half-life.

        One from a later time than this counts in full: nothing is worth more than what was just seen.
        """
        return _weights(self.locks, t_ns, half_life_h)

    def at(self, ray: tuple[float, float, float], t_ns: int, *, half_life_h: float, baseline: float) -> Expected:
        """What is expected along a fisheye ray, unit, at a time; the baseline is in the unit of the ranges."""
        apart_rad = self._apart_rad(ray)
        order = np.argsort(apart_rad, kind="stable")[:NEAREST]
        order = order[apart_rad[order] <= REACH_RAD]
        near = [self.locks[index] for index in order]
        if not near:
            return Expected(humps=())
        return expect(
            apart_rad=apart_rad[order],
            ray=np.array(ray),
            rays=np.array([lock.ray for lock in near]),
            inverse_ranges=np.array([lock.inverse_range for lock in near]),
            sigmas=np.array([lock.sigma for lock in near]),
            weights=_weights(near, t_ns, half_life_h),
            baseline=baseline,
        )

    def _rays(self) -> Array:
        return np.array([lock.ray for lock in self.locks]).reshape(-1, 3)

    def _apart_rad(self, ray: tuple[float, float, float]) -> Array:
        """Angles ``(n,)`` between a ray and those of the locks: by the chord, which is exact also for small ones."""
        chords = self._rays() - np.array(ray)
        return np.asarray(2.0 * np.arcsin(np.minimum(np.sqrt((chords * chords).sum(axis=1)) / 2.0, 1.0)))


def _weights(locks: Sequence[RangeLock], t_ns: int, half_life_h: float) -> Array:
    ages_h = np.array([max(t_ns - lock.t_ns, 0) / HOUR_NS for lock in locks])
    return np.asarray(np.exp2(-ages_h / half_life_h))
