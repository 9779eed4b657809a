"""Drift in service: every confirmed lock is a correspondence, and its offset across the arc should stay in the band.

Nothing here changes a rig by itself: the monitor says when the median has left the band, and `refined` returns another
rig, which somebody has to put in place and can take back.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ptzd.calibration.bundle import Problem, rotations, solve
from ptzd.calibration.pairs import geodesic
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import normalise
from ptzd.geometry.types import Array

WINDOW = 40
LEAST = 12
"""Fewer locks say nothing about a drift."""
MIN_SPREAD_RAD = 0.3
"""Locks closer together than this leave a turn open."""
MAX_TURN_RAD = np.radians(5.0)
"""A larger turn is no drift: somebody moved a camera."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lock:
    """A confirmed lock."""

    ray: Array
    """Of the box's centre ``(3,)``, fisheye frame."""
    direction: Array
    """Where it was found ``(3,)``, head frame."""
    band_rad: float
    """Half width of the band that the calibration promised for it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """What the last locks tell."""

    count: int
    median_rad: float
    """Of the signed offsets across the arc."""
    sigma_rad: float
    """One sigma of that median."""
    band_rad: float
    drifted: bool
    """The median is off by more than a third of the band and its own three sigma; or, since a turn may push one half of
    the field up and the other down, half of the locks are off by more than half of the band."""


def offset_rad(rig: Rig, lock: Lock) -> float:
    """Signed angle of a lock across its arc, rad."""
    unit = normalise(rig.head_from_fisheye_translation)
    pair = geodesic(rig.head_from_fisheye_rotation, unit, lock.ray[None], lock.direction[None])
    return float(pair[0, 0])


class DriftMonitor:
    """Keeps the last locks.

    Parameters
    ----------
    rig : Rig
        The calibration in use.
    window : int
        How many locks count.
    """

    def __init__(self, rig: Rig, window: int = WINDOW) -> None:
        self._rig = rig
        self._locks: deque[Lock] = deque(maxlen=window)

    @property
    def locks(self) -> tuple[Lock, ...]:
        """The locks kept."""
        return tuple(self._locks)

    def add(self, lock: Lock) -> Drift:
        """Take a confirmed lock and say what all kept ones tell."""
        self._locks.append(lock)
        offsets = np.array([offset_rad(self._rig, one) for one in self._locks])
        median = float(np.median(offsets))
        spread = 1.4826 * float(np.median(np.abs(offsets - median)))
        sigma = 1.2533 * spread / float(np.sqrt(len(offsets)))
        band = float(np.median([one.band_rad for one in self._locks]))
        aside = abs(median) - 3.0 * sigma > band / 3.0
        apart = float(np.median(np.abs(offsets))) > band / 2.0
        drifted = len(offsets) >= LEAST and (aside or apart)
        return Drift(count=len(offsets), median_rad=median, sigma_rad=sigma, band_rad=band, drifted=drifted)


def refined(rig: Rig, locks: Sequence[Lock]) -> tuple[Rig, float]:
    """Return the rig with R turned so that the locks lie on their circles, and by how much, rad.

    T, intrinsics and head are held. The part of the turn that moves directions along their arcs is not seen by locks
    and comes from the calibration: R is held to it within its sigma.

    Raises
    ------
    CalibrationError
        When the locks are too few or too close together, or ask for more than `MAX_TURN_RAD`.
    """
    if len(locks) < LEAST:
        raise CalibrationError(f"drift: {len(locks)} locks; at least {LEAST} are needed to turn the rig")
    rays, directions = np.stack([one.ray for one in locks]), np.stack([one.direction for one in locks])
    spread = float(np.linalg.svd(normalise(directions) - normalise(directions).mean(axis=0), compute_uv=False)[1])
    if spread / np.sqrt(len(locks)) < MIN_SPREAD_RAD / 3.0:
        raise CalibrationError("drift: the locks lie too close together; wait for some in other parts of the picture")
    unit, start = normalise(rig.head_from_fisheye_translation), rig.head_from_fisheye_rotation

    def offsets(turn: Array) -> Array:
        return geodesic(rotations(turn[None])[0] @ start, unit, rays, directions)

    def linearise(shared: Array, local: Array) -> tuple[Array, Array, Array]:
        steps = np.eye(3) * 1e-6
        by = np.stack([(offsets(shared + step) - offsets(shared - step)) / 2e-6 for step in steps], axis=-1)
        return offsets(shared), by, np.zeros((len(rays), 2, 0))

    known = rig.uncertainty.rotation_rad if rig.uncertainty is not None else 0.01
    noise = float(np.median([one.band_rad for one in locks])) / 3.0
    bundle = Problem(
        linearise=linearise,
        group=np.zeros(len(rays), np.int64),
        free=np.ones(3, bool),
        loss="cauchy",
        prior_mean=np.zeros(3),
        prior_sigma=np.full(3, max(known, 1e-3) * 10.0 / noise),
    )
    turn = solve(bundle, np.zeros(3), np.zeros((1, 0))).shared
    size = float(np.linalg.norm(turn))
    if size > MAX_TURN_RAD:
        raise CalibrationError(
            f"drift: the locks ask for a turn of {np.degrees(size):.1f}°; a camera was moved, calibrate the rig again"
        )
    return replace(rig, head_from_fisheye_rotation=rotations(turn[None])[0] @ start), size
