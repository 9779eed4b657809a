"""The rig without a board: features of the scene in the fisheye and in turned PTZ pictures (paper, section 4.2).

The calibrated PTZ gives a direction in the head's frame for every feature of its pictures. Partners in the fisheye obey
``P_h ∝ R P_f + s T``: a turn that fits many of them roughly (the parallax is a few degrees) separates matches from
chance; an essential matrix and the paper's geodesic refinement give R and the direction of T; a bundle over pixels,
with an inverse range for every feature, refines R, T and, when it is not known yet, the fisheye's lens. |T| = 1:
ranges are in baselines. What moves along the circles trades against the ranges: across them the rig is known several
times better.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ptzd.calibration.bundle import Problem, Solution, rotations, solve
from ptzd.calibration.intrinsics import turn_derivative
from ptzd.calibration.lens import UNIFIED, WIDE_RAD, Lens
from ptzd.calibration.pairs import essential_linear, geodesic, refine_pairs
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import normalise, rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.types import Array, CameraModel, Mask

MIN_PAIRS = 60
LENS_AND_RIG = 14
"""Shared numbers: the lens, the turn, two coordinates of T."""
PARALLAX_RAD = math.radians(14.0)
"""Widest parallax that the first turn tolerates: a third of a metre at 1.4 m."""
TRIALS = 3000
ACROSS_RAD = math.radians(0.8)
"""Matches farther off their circle are strays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenePairs:
    """Matched features."""

    fisheye_px: Array
    """``(n, 2)``."""
    directions: Array
    """``(n, 3)`` unit, head frame."""
    sigma_rad: Array
    """One sigma of every direction ``(n,)``."""

    def only(self, rows: Mask) -> ScenePairs:
        """Some of them."""
        return ScenePairs(
            fisheye_px=self.fisheye_px[rows], directions=self.directions[rows], sigma_rad=self.sigma_rad[rows]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRigFit:
    """R, direction of T, the fisheye's lens, and how well they are known."""

    lens: Lens
    values: Array
    rotation: Array
    translation: Array
    """Of length 1."""
    covariance: Array
    """Of the lens, the turn on the left of R and two coordinates across T."""
    pairs: ScenePairs
    residuals_px: Array
    """In the fisheye ``(n, 2)``, with each feature at its best range."""
    across_rad: Array
    """Signed angles off the circles ``(n,)``."""
    rms_px: float
    planes: int = 0
    """Planes of the scene that took part."""


def first_lens(size_px: tuple[int, int], circle_px: tuple[float, float, float] | None) -> list[Array]:
    """Lenses to try when nothing is known: ξ = 1, focal lengths about the one that sees 180° in the image circle."""
    width, height = size_px
    x, y, radius = circle_px or ((width - 1) / 2, (height - 1) / 2, 0.5 * min(width, height))
    return [np.array([radius * k, radius * k, x, y, 1.0, 0.0, 0.0, 0.0, 0.0]) for k in (0.8, 1.0, 1.25, 1.5)]


def first_turn(camera: CameraModel, pairs: ScenePairs, seed: int = 1) -> tuple[Array, Mask]:
    """The turn R that carries most fisheye rays to within `PARALLAX_RAD` of their partners, and which those are.

    Two pairs make a turn; the score falls linearly with the angle.
    """
    rays, valid = camera.lift(pairs.fisheye_px)
    index = np.flatnonzero(valid)
    if len(index) < MIN_PAIRS // 2:
        return np.eye(3), valid & False
    rng = np.random.default_rng(seed)
    p, h = rays[index], pairs.directions[index]
    a, b = rng.integers(0, len(index), (2, TRIALS))
    same = np.abs((p[a] * p[b]).sum(1) - (h[a] * h[b]).sum(1)) < 0.08
    far = (p[a] * p[b]).sum(1) < math.cos(math.radians(15.0))
    a, b = a[same & far], b[same & far]
    turns = _frames(h[a], h[b]) @ _frames(p[a], p[b]).transpose(0, 2, 1)
    best, chosen = -1.0, np.eye(3)
    for block in np.array_split(turns, max(1, len(turns) // 200)):
        cosines = np.einsum("tij,nj,ni->tn", block, p, h, optimize=True)
        scores = np.maximum(1.0 - np.arccos(np.clip(cosines, -1.0, 1.0)) / PARALLAX_RAD, 0.0).sum(axis=1)
        if len(scores) and scores.max() > best:
            best, chosen = float(scores.max()), block[int(scores.argmax())]
    near = valid & ((rays @ chosen.T * pairs.directions).sum(1) > math.cos(PARALLAX_RAD))
    return chosen, near


def _frames(a: Array, b: Array) -> Array:
    """Orthonormal frames ``(n, 3, 3)`` of pairs of directions."""
    middle, side = normalise(a + b), normalise(a - b)
    return np.stack([middle, side, np.cross(middle, side)], axis=-1)


def _epipolar(rotation: Array, rays: Array, directions: Array) -> tuple[Array, Array, float]:
    """R, T and the robust cost of the best of several starts for T."""
    starts = [
        np.array(v, float) for v in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, -1, 0), (0, 1, 1), (1, 0, 1))
    ]
    results = [_robust(rotation, start, rays, directions) for start in starts]
    linear = essential_linear(rays, directions)
    if np.linalg.norm(rotvec_from_rotation(linear[0] @ rotation.T)) < PARALLAX_RAD:
        results.append(_robust(*linear, rays, directions))
    return min(results, key=lambda result: result[2])


def _robust(rotation: Array, start: Array, rays: Array, directions: Array) -> tuple[Array, Array, float]:
    refined, unit, _ = refine_pairs(rotation, start, rays, directions)
    off = np.abs(geodesic(refined, unit, rays, directions)).max(axis=1)
    cost = float(np.minimum(off, ACROSS_RAD).mean())
    carried = rays @ refined.T
    ahead = ((directions - carried) * unit).sum(1)
    return refined, unit if np.median(ahead) > 0 else -unit, cost


def calibrate_scene_rig(
    pairs: ScenePairs,
    size_px: tuple[int, int],
    known: Array | None = None,
    circle_px: tuple[float, float, float] | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> SceneRigFit:
    """R, the direction of T and, unless known, the fisheye's lens from features of the scene.

    Parameters
    ----------
    pairs : ScenePairs
        With chance matches among them.
    size_px : (int, int)
        Of the fisheye's picture.
    known : Array, optional
        Parameters of a unified lens, held; None: estimated too.
    circle_px : (float, float, float), optional
        Centre and radius of the image circle, for the first guess of the lens.

    Raises
    ------
    CalibrationError
        When too few features agree.
    """
    lenses = first_lens(size_px, circle_px) if known is None else [known]
    tried = [(*first_turn(UNIFIED.camera(lens, size_px, WIDE_RAD), pairs), lens) for lens in lenses]
    rotation, near, values = max(tried, key=lambda item: int(item[1].sum()))
    progress(f"{int(near.sum())} of {len(near)} matches agree with one turn")
    enough(int(near.sum()), len(near))
    chosen = pairs.only(near)
    rays, valid = UNIFIED.camera(values, size_px, WIDE_RAD).lift(chosen.fisheye_px)
    chosen, rays = chosen.only(valid), rays[valid]
    rotation, unit, _ = _epipolar(rotation, rays, chosen.directions)
    stages = ("fx",), ("fx", "cx"), ("fx", "cx", "k1"), ("fx", "cx", "k1", "xi", "k2", "p1")
    solution: Solution | None = None
    for stage, limit in zip(stages, (4.0, 2.5, 1.5, 1.0), strict=True):
        free = np.zeros(UNIFIED.size, bool) if known is not None else _free(stage)
        solution, frame = _bundle(chosen, values, rotation, unit, free)
        values = lens_values(solution.shared)
        rotation = rotation_from_rotvec(solution.shared[9:12])
        unit = normalise(frame[:, 0] + frame[:, 1:] @ solution.shared[12:14])
        lengths = np.linalg.norm(solution.residuals[0::2], axis=1)
        size = max(3.0 * float(np.median(lengths)) / 0.6745, 0.4 * limit)
        kept = lengths < size
        progress(f"{int(kept.sum())} of {len(kept)} features within {size:.2f} px")
        chosen = chosen.only(kept)
        enough(len(chosen.directions), len(near))
    solution, frame = _bundle(chosen, values, rotation, unit, np.full(9, known is None))
    return result(solution, frame, chosen, size_px, solution.residuals[0::2])


def enough(count: int, total: int) -> None:
    """Raise when too few matches agree."""
    if count < MIN_PAIRS:
        raise CalibrationError(
            f"scene: only {count} of {total} matches between fisheye and PTZ agree; at least {MIN_PAIRS} are needed: "
            "point the PTZ at more parts of the scene that the fisheye sees, with texture, in even light"
        )


def _free(stage: tuple[str, ...]) -> Mask:
    names = {*stage, *({"fy"} if "fx" in stage else ()), *({"cy"} if "cx" in stage else ())}
    names |= {"p2"} if "p1" in stage else set()
    return np.array([name in names for name in UNIFIED.names])


def _bundle(pairs: ScenePairs, values: Array, rotation: Array, unit: Array, free: Mask) -> tuple[Solution, Array]:
    """Shared: lens, turn, two coordinates of T; local: two across the direction, and the inverse range from the head.

    With X = direction and the fisheye at T: ``P_f ∝ Rᵀ (direction - s T)``. The direction's own residual is put in
    fisheye pixels at its sigma, so both count by what they know.
    """
    frame = frame_of(unit)
    base = pairs.directions
    across = normalise(np.cross(base, np.where(np.abs(base[:, :1]) < 0.8, [[1.0, 0, 0]], [[0, 1.0, 0]])))
    plane = np.stack([across, np.cross(base, across)], axis=-1)
    count = len(base)
    weight = 0.3 / pairs.sigma_rad

    def linearise(shared: Array, local: Array) -> tuple[Array, Array, Array]:
        turn = rotation_from_rotvec(shared[9:12])
        shift = frame[:, 0] + frame[:, 1:] @ shared[12:14]
        points = base + np.einsum("nij,nj->ni", plane, local[:, :2]) - local[:, 2:] * shift
        predicted, by_lens, by_point = UNIFIED.project(lens_values(shared), points @ turn)
        by_lens[:, :, 0] += shared[1] * by_lens[:, :, 1]
        by_lens[:, :, 1] *= shared[0]
        by_head = by_point @ turn.T
        residuals = np.empty((2 * count, 2))
        residuals[0::2] = predicted - pairs.fisheye_px
        residuals[1::2] = local[:, :2] * weight[:, None]
        by_shared = np.zeros((2 * count, 2, 14))
        by_shared[0::2, :, :9] = by_lens
        by_shared[0::2, :, 9:12] = -np.matmul(by_head, turn_derivative(points))
        by_shared[0::2, :, 12:] = -local[:, 2, None, None] * (by_head @ frame[:, 1:])
        by_local = np.zeros((2 * count, 2, 3))
        by_local[0::2, :, :2] = np.matmul(by_head, plane)
        by_local[0::2, :, 2] = -by_head @ shift
        by_local[1::2, 0, 0] = by_local[1::2, 1, 1] = weight
        return residuals, by_shared, by_local

    middle, loose = lens_prior(values)
    bundle = Problem(
        linearise=linearise,
        group=np.repeat(np.arange(count), 2),
        free=np.append(free, np.ones(5, bool)),
        shared_rotations=(9,),
        loss="cauchy",
        prior_mean=np.concatenate([middle, np.zeros(5)]),
        prior_sigma=np.concatenate([loose, np.full(5, math.inf)]) / 0.15,
        steps=30,
        tolerance=1e-7,
    )
    start = np.concatenate(
        [values[:1], values[1:2] / values[0], values[2:], rotvec_from_rotation(rotation), [0.0, 0.0]]
    )
    rays, valid = UNIFIED.camera(values, (1, 1), WIDE_RAD).lift(pairs.fisheye_px)
    carried = np.where(valid[:, None], rays, [[0.0, 0.0, 1.0]]) @ rotation.T
    local = np.zeros((count, 3))
    local[:, 2] = inverse_ranges(base, carried, unit)
    return solve(bundle, start, local), frame


def frame_of(unit: Array) -> Array:
    """``(3, 3)``: a direction and two across it."""
    helper = np.eye(3)[int(np.argmin(np.abs(unit)))]
    first = normalise(np.cross(unit, helper))
    return np.stack([unit, first, np.cross(unit, first)], axis=-1)


def lens_prior(values: Array) -> tuple[Array, Array]:
    """Mean and sigma of a lens nobody measured: square pixels, little decentring, the principal point near a guess."""
    scale = float(values[0])
    mean = np.array([values[0], 1.0, *values[2:4], 1.1, 0.0, 0.0, 0.0, 0.0])
    return mean, np.array([math.inf, 0.002, 0.02 * scale, 0.02 * scale, 0.3, 0.3, 0.1, 3e-4, 3e-4])


def lens_values(shared: Array) -> Array:
    """Parameters of the lens; the second shared number is fy / fx."""
    values: Array = shared[:9].copy()
    values[1] *= values[0]
    return values


def inverse_ranges(directions: Array, carried: Array, unit: Array) -> Array:
    """S with ``direction - s T`` nearest to the fisheye's ray."""
    across = np.cross(unit, carried)
    square = np.maximum((across * across).sum(1), 1e-6)
    return np.asarray(np.clip((np.cross(directions, carried) * across).sum(1) / square, -0.2, 2.0))


def result(
    solution: Solution, frame: Array, pairs: ScenePairs, size_px: tuple[int, int], residuals: Array
) -> SceneRigFit:
    """The fit of a solution whose first shared numbers are lens, turn and two coordinates of T."""
    values = lens_values(solution.shared)
    rotation = rotations(solution.shared[None, 9:12])[0]
    unit = normalise(frame[:, 0] + frame[:, 1:] @ solution.shared[12:14])
    rays, valid = UNIFIED.camera(values, size_px, WIDE_RAD).lift(pairs.fisheye_px)
    normal: Array = normalise(np.cross(unit, rays @ rotation.T))
    across = np.where(valid, np.arcsin(np.clip((pairs.directions * normal).sum(1), -1, 1)), np.nan)
    return SceneRigFit(
        lens=UNIFIED,
        values=values,
        rotation=rotation,
        translation=np.asarray(unit),
        covariance=solution.covariance[:LENS_AND_RIG, :LENS_AND_RIG],
        pairs=pairs,
        residuals_px=-residuals,
        across_rad=across,
        rms_px=float(np.sqrt((residuals**2).sum(1).mean())),
    )
