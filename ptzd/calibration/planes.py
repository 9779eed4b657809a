"""Planes of a scene: they tell R from the lens where single features cannot (paper, section 4.2).

A feature alone is free to move along its arc, so a turn of R about the axis across the baseline and a shift of the
principal point look almost alike. On a plane ``M · X_h = 1`` the inverse range from the head is ``s = M · P_h`` for all
of its features: walls, floor and ceiling leave three numbers each, and the arcs count in full.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ptzd.calibration.bundle import Index, Problem, Solution, solve
from ptzd.calibration.intrinsics import turn_derivative
from ptzd.calibration.lens import UNIFIED, WIDE_RAD
from ptzd.calibration.scene_rig import (
    LENS_AND_RIG,
    SceneRigFit,
    enough,
    frame_of,
    inverse_ranges,
    lens_prior,
    lens_values,
    result,
)
from ptzd.geometry.sphere import rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.types import Array, Mask

MOST_PLANES = 10
LEAST_FEATURES = 40
LEAST_SHARE = 1 / 30
"""A wall holds so many of all features at least: with smaller ones relief passes for planes, and which of it does is
chance, so that two fits of one rig differ (``python -m tests.bench.boardless --seeds 5``)."""
TRIALS = 1500
NEAR_PX = (1.0, 1.0, 0.5, 0.5, 0.3, 0.3)
"""A feature belongs to a plane when it lies so near, along its arc; closer in every round."""
ALONG_SHARE = 0.1
"""Weight of a residual along the arc against one across it: walls have skirtings, posters and shelves, whose relief is
a pixel of parallax and shared by neighbours; across the arc a feature is right to a tenth of a pixel."""
NEGATIVE = -0.03
"""An inverse range below this is behind the cameras, even with its error."""
_SIGMA_PX = 0.15
"""What a residual is about: priors are weighed against it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Planes:
    """Planes of a scene, and which feature is on which."""

    normals: Array
    """M ``(k, 3)``: ``M · X_head = 1``."""
    owner: Index
    """``(n,)`` number of the plane, -1 on none."""


def find_planes(directions: Array, s: Array, sigma: Array, near: float, seed: int = 1) -> Planes:
    """Return the planes that hold most features, largest first.

    Parameters
    ----------
    directions : Array
        P_h ``(n, 3)``.
    s : Array
        Inverse range from the head ``(n,)``.
    sigma : Array
        What a pixel along the arc is in inverse range ``(n,)``.
    near : float
        Features so many pixels off a plane belong to it.
    """
    rng = np.random.default_rng(seed)
    owner = np.full(len(s), -1)
    normals: list[Array] = []
    least = max(LEAST_FEATURES, LEAST_SHARE * len(s))
    while len(normals) < MOST_PLANES:
        left = np.flatnonzero(owner < 0)
        if len(left) < least:
            break
        triples = left[rng.integers(0, len(left), (TRIALS, 3))]
        matrices = directions[triples]
        solvable = np.abs(np.linalg.det(matrices)) > 1e-3
        if not solvable.any():
            break
        trials = np.linalg.solve(matrices[solvable], s[triples[solvable]][..., None])[..., 0]
        off = np.abs(trials @ directions[left].T - s[left]) / sigma[left]
        scores = np.maximum(1.0 - off / near, 0.0).sum(axis=1)
        normal = trials[int(scores.argmax())]
        for _ in range(3):
            mine = left[np.abs(directions[left] @ normal - s[left]) < near * sigma[left]]
            if len(mine) < least:
                break
            weight = 1.0 / sigma[mine]
            normal = np.linalg.lstsq(directions[mine] * weight[:, None], s[mine] * weight, rcond=None)[0]
        if len(mine) < least:
            break
        owner[mine] = len(normals)
        normals.append(normal)
    return Planes(normals=np.array(normals).reshape(-1, 3), owner=owner)


def refine_by_planes(
    fit: SceneRigFit,
    size_px: tuple[int, int],
    *,
    held: bool,
    progress: Callable[[str], None] = lambda text: None,
    seed: int = 1,
) -> SceneRigFit:
    """The rig again with the planes of the scene; the lens too unless ``held``.

    A scene without planes gives the same as before. ``seed`` is that of the draws that find the planes.
    """
    for near in NEAR_PX:
        pairs = fit.pairs
        s, sigma, ahead = _along(fit)
        pairs, s, sigma = pairs.only(ahead), s[ahead], sigma[ahead]
        planes = find_planes(pairs.directions, s, sigma, near, seed)
        if len(planes.normals) == 0:
            return fit
        fit = replace(fit, pairs=pairs)
        solution, frame, residuals = _bundle(fit, planes, s, np.full(UNIFIED.size, not held))
        lengths, on = np.linalg.norm(residuals, axis=1), planes.owner >= 0
        limit = 4.0 * float(np.median(lengths[on])) / 1.1774
        kept = lengths < limit
        progress(f"{len(planes.normals)} planes with {int(on.sum())} of {len(on)} features, within {limit:.2f} px")
        enough(int(kept.sum()), len(kept))
        fit = result(solution, frame, pairs, size_px, residuals)
        fit = replace(
            fit,
            pairs=pairs.only(kept),
            residuals_px=fit.residuals_px[kept],
            across_rad=fit.across_rad[kept],
            planes=len(planes.normals),
        )
    return fit


def _along(fit: SceneRigFit) -> tuple[Array, Array, Mask]:
    """Inverse range of every feature, what a fisheye pixel is in it, and which are before both cameras."""
    camera = UNIFIED.camera(fit.values, (1, 1), WIDE_RAD)
    rays, valid = camera.lift(fit.pairs.fisheye_px)
    carried = np.where(valid[:, None], rays, [[0.0, 0.0, 1.0]]) @ fit.rotation.T
    s = inverse_ranges(fit.pairs.directions, carried, fit.translation)
    steps = []
    for axis in np.eye(2):
        moved, also = camera.lift(fit.pairs.fisheye_px + axis)
        steps.append(np.where((valid & also)[:, None], moved - rays, 1e-2))
    pixel = np.sqrt(np.linalg.norm(steps[0], axis=1) * np.linalg.norm(steps[1], axis=1))
    across = np.linalg.norm(np.cross(fit.translation, fit.pairs.directions), axis=1)
    return s, pixel / np.maximum(across, 0.1), valid & (s > NEGATIVE)


def _bundle(fit: SceneRigFit, planes: Planes, s: Array, free: Mask) -> tuple[Solution, Array, Array]:
    """Shared: lens, turn, two coordinates of T, the planes; local: the inverse range of features on none."""
    pairs, frame = fit.pairs, frame_of(fit.translation)
    base, owner = pairs.directions, planes.owner
    on = np.flatnonzero(owner >= 0)
    count, size = len(base), LENS_AND_RIG + planes.normals.size

    def linearise(shared: Array, local: Array) -> tuple[Array, Array, Array]:
        turn = rotation_from_rotvec(shared[9:12])
        shift = frame[:, 0] + frame[:, 1:] @ shared[12:14]
        near = local[:, 0].copy()
        near[on] = np.einsum("ni,ni->n", shared[LENS_AND_RIG:].reshape(-1, 3)[owner[on]], base[on])
        points = base - near[:, None] * shift
        predicted, by_lens, by_point = UNIFIED.project(lens_values(shared), points @ turn)
        by_lens[:, :, 0] += shared[1] * by_lens[:, :, 1]
        by_lens[:, :, 1] *= shared[0]
        by_head = by_point @ turn.T
        by_near = -by_head @ shift
        by_shared = np.zeros((count, 2, size))
        by_shared[:, :, :9] = by_lens
        by_shared[:, :, 9:12] = -np.matmul(by_head, turn_derivative(points))
        by_shared[:, :, 12:14] = -near[:, None, None] * (by_head @ frame[:, 1:])
        for axis in range(3):
            column = LENS_AND_RIG + 3 * owner[on] + axis
            by_shared[on, 0, column] = by_near[on, 0] * base[on, axis]
            by_shared[on, 1, column] = by_near[on, 1] * base[on, axis]
        by_local = by_near[:, :, None].copy()
        by_local[on] = 0.0
        residuals = predicted - pairs.fisheye_px
        along = by_near[on] / np.maximum(np.linalg.norm(by_near[on], axis=1, keepdims=True), 1e-9)
        soft = np.eye(2) - (1.0 - ALONG_SHARE) * along[:, :, None] * along[:, None, :]
        residuals[on] = np.einsum("nij,nj->ni", soft, residuals[on])
        by_shared[on] = np.matmul(soft, by_shared[on])
        return residuals, by_shared, by_local

    mean, sigma = lens_prior(fit.values)
    plane_free = np.full(planes.normals.size, math.inf)
    start = np.concatenate(
        [
            fit.values[:1], fit.values[1:2] / fit.values[0], fit.values[2:], rotvec_from_rotation(fit.rotation),
            [0.0, 0.0], planes.normals.ravel(),
        ]
    )  # fmt: skip
    bundle = Problem(
        linearise=linearise,
        group=np.arange(count),
        free=np.concatenate([free, np.ones(size - UNIFIED.size, bool)]),
        shared_rotations=(9,),
        loss="cauchy",
        scale=3.0 * _SIGMA_PX,
        prior_mean=np.concatenate([mean, np.zeros(5), np.zeros(planes.normals.size)]),
        prior_sigma=np.concatenate([sigma, np.full(5, math.inf), plane_free]) / _SIGMA_PX,
        steps=15,
        tolerance=1e-6,
    )
    solution = solve(bundle, start, s[:, None])
    return solution, frame, solution.residuals
