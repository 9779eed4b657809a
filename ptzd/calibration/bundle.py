"""Robust least squares with a block per view: Levenberg-Marquardt on the Schur complement of the blocks.

Parameters are shared ones ``(P,)`` and a row of local ones ``(G, K)`` for every group (a board's pose, a point); every
observation is a pair of numbers of one group. Robust by iterated weights on the length of a residual (Huber, Cauchy).
Triggs, McLauchlan, Hartley & Fitzgibbon 2000, "Bundle adjustment - a modern synthesis".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ptzd.geometry.types import Array, Mask

Index = NDArray[np.int64]
Linearised = tuple[Array, Array, Array]
"""Residuals ``(N, 2)``, derivatives by shared ``(N, 2, P)`` and local parameters ``(N, 2, K)``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """What to minimise."""

    linearise: Callable[[Array, Array], Linearised]
    group: Index
    """Group of every observation ``(N,)``, rising: observations of one group lie together."""
    free: Mask
    """Shared parameters to estimate ``(P,)`` bool."""
    shared_rotations: tuple[int, ...] = ()
    """Where triples of shared parameters are rotation vectors, changed by a rotation from the left."""
    local_rotations: tuple[int, ...] = ()
    loss: str = "huber"
    """``huber`` keeps small outliers, ``cauchy`` forgets large ones, ``square`` weighs all the same."""
    scale: float | None = None
    """Residual beyond which weights fall; None: from the residuals' median, each step anew."""
    prior_mean: Array | None = None
    """Of the shared parameters."""
    prior_sigma: Array | None = None
    """In the residuals' unit: a parameter this far off costs as much as a residual of 1; inf: no prior."""
    steps: int = 60
    tolerance: float = 1e-11
    """Relative gain of a step below which the minimum is reached; a lens' parameters trade against each other."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Solution:
    """The minimum found."""

    shared: Array
    local: Array
    residuals: Array
    """``(N, 2)``."""
    weights: Array
    """``(N,)``, 1 = fully counted."""
    covariance: Array
    """Of the shared parameters ``(P, P)``; zero for those that were held."""
    sigma: float
    """One sigma of a residual's component."""
    converged: bool
    steps: int = field(default=0)


def weights_of(residuals: Array, loss: str, scale: float | None) -> tuple[Array, Array]:
    """Weights ``(N,)`` and costs ``(N,)`` of residuals ``(N, 2)``."""
    square = np.einsum("ni,ni->n", residuals, residuals)
    if loss == "square":
        return np.ones_like(square), square
    width = scale if scale is not None else 3.0 * max(float(np.median(np.sqrt(square))) / 1.1774, 1e-9)
    if loss == "cauchy":
        ratio = square / width**2
        return 1.0 / (1.0 + ratio), width**2 * np.log1p(ratio)
    length = np.sqrt(square)
    far = length > width
    return np.where(far, width / np.maximum(length, 1e-300), 1.0), np.where(far, 2 * width * length - width**2, square)


def rotations(rotvecs: Array) -> Array:
    """Rotation matrices ``(n, 3, 3)`` of rotation vectors ``(n, 3)``."""
    return np.asarray(Rotation.from_rotvec(rotvecs).as_matrix())


def turned(rotvecs: Array, changes: Array) -> Array:
    """Rotation vectors of ``exp(change) · exp(rotvec)``, ``(3,)`` or ``(n, 3)``."""
    return np.asarray((Rotation.from_rotvec(changes) * Rotation.from_rotvec(rotvecs)).as_rotvec())


def _retract(values: Array, change: Array, starts: tuple[int, ...]) -> Array:
    moved = values + change
    for start in starts:
        part = np.s_[..., start : start + 3]
        moved[part] = turned(values[part], change[part])
    return moved


@dataclass(frozen=True, slots=True)
class _Normal:
    """Normal equations in blocks."""

    shared: Array
    cross: Array
    local: Array
    gradient_shared: Array
    gradient_local: Array


def _normal(problem: Problem, shared: Array, parts: Linearised, weights: Array, starts: Index) -> _Normal:
    residuals, by_shared, by_local = parts
    weighted = by_shared * weights[:, None, None]
    local = by_local * weights[:, None, None]

    def summed(products: Array) -> Array:
        return np.add.reduceat(products, starts, axis=0)

    flat = weighted.reshape(residuals.size, len(shared))
    block = flat.T @ by_shared.reshape(residuals.size, len(shared))
    gradient = flat.T @ residuals.ravel()
    if problem.prior_sigma is not None and problem.prior_mean is not None:
        information = 1.0 / problem.prior_sigma**2
        block = block + np.diag(information)
        gradient = gradient + information * (shared - problem.prior_mean)
    return _Normal(
        block,
        summed(np.matmul(by_shared.transpose(0, 2, 1), local)),
        summed(np.matmul(by_local.transpose(0, 2, 1), local)),
        gradient,
        summed(np.einsum("nik,ni->nk", local, residuals)),
    )


def _schur(normal: _Normal, free: Index, damping: float) -> tuple[Array, Array, Array, Array]:
    """Reduced matrix and gradient of the free shared parameters, inverse local blocks, W V⁻¹."""
    size = normal.local.shape[-1]
    diagonal = np.einsum("gkk->gk", normal.local)
    local = normal.local + np.eye(size) * (damping * diagonal + 1e-12 * (1 + diagonal))[:, None, :]
    inverse = np.linalg.inv(local)
    through = np.matmul(normal.cross, inverse)
    flat = through.transpose(1, 0, 2).reshape(len(normal.shared), normal.local.shape[0] * normal.local.shape[1])
    reduced = (
        normal.shared
        - flat
        @ normal.cross.transpose(1, 0, 2).reshape(len(normal.shared), normal.local.shape[0] * normal.local.shape[1]).T
    )
    gradient = normal.gradient_shared - flat @ normal.gradient_local.ravel()
    reduced = reduced + np.diag(damping * np.diag(normal.shared))
    return reduced[np.ix_(free, free)], gradient[free], inverse, through


def _prior_cost(problem: Problem, shared: Array) -> float:
    if problem.prior_sigma is None or problem.prior_mean is None:
        return 0.0
    return float((((shared - problem.prior_mean) / problem.prior_sigma) ** 2).sum())


def _inverse(matrix: Array) -> Array:
    """Inverse of a symmetric matrix of badly scaled rows; infinite where it is singular."""
    if matrix.size == 0:
        return matrix
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
    kept = np.where(values > 1e-13, 1.0 / np.maximum(values, 1e-13), 1e13)
    return np.asarray((vectors * kept) @ vectors.T / scale[:, None] / scale)


def solve(problem: Problem, shared: Array, local: Array) -> Solution:
    """Minimise from a start.

    Parameters
    ----------
    problem : Problem
        What to minimise.
    shared, local : Array
        The start, ``(P,)`` and ``(G, K)``; every group must have an observation.
    """
    starts = np.flatnonzero(np.diff(problem.group, prepend=-1))
    free = np.flatnonzero(problem.free)
    parts = problem.linearise(shared, local)
    damping, converged, step = 1e-3, False, 0
    weights, costs = weights_of(parts[0], problem.loss, problem.scale)
    while step < problem.steps and not converged:
        step += 1
        scale = _scale(problem, parts[0])
        weights, costs = weights_of(parts[0], problem.loss, scale)
        normal = _normal(problem, shared, parts, weights, starts)
        before = float(costs.sum()) + _prior_cost(problem, shared)
        accepted = False
        while not accepted and damping < 1e12:
            reduced, gradient, inverse, through = _schur(normal, free, damping)
            change = np.zeros_like(shared)
            change[free] = -_inverse(reduced) @ gradient
            local_change = -np.einsum("gkl,gl->gk", inverse, normal.gradient_local) - np.einsum(
                "gpk,p->gk", through, change
            )
            trial = _retract(shared, change, problem.shared_rotations)
            trial_local = _retract(local, local_change, problem.local_rotations)
            trial_parts = problem.linearise(trial, trial_local)
            after = float(weights_of(trial_parts[0], problem.loss, scale)[1].sum()) + _prior_cost(problem, trial)
            accepted = bool(np.isfinite(after)) and after <= before
            damping = max(damping / 10, 1e-9) if accepted else damping * 8
        if accepted:
            converged = before - after <= problem.tolerance * max(before, 1e-30)
            shared, local, parts = trial, trial_local, trial_parts
        else:
            converged = True
    weights, _ = weights_of(parts[0], problem.loss, _scale(problem, parts[0]))
    return _finished(problem, shared, local, parts, weights, starts, free, converged=converged, steps=step)


def _scale(problem: Problem, residuals: Array) -> float | None:
    if problem.loss == "square" or problem.scale is not None:
        return problem.scale
    return 3.0 * max(float(np.median(np.linalg.norm(residuals, axis=1))) / 1.1774, 1e-9)


def _finished(
    problem: Problem,
    shared: Array,
    local: Array,
    parts: Linearised,
    weights: Array,
    starts: Index,
    free: Index,
    *,
    converged: bool,
    steps: int,
) -> Solution:
    residuals = parts[0]
    share = max(1.0 - (len(free) + local.size) / (2.0 * len(residuals)), 1.0 / (2.0 * len(residuals)))
    variance = float((weights * np.einsum("ni,ni->n", residuals, residuals)).sum()) / (2.0 * weights.sum() * share)
    reduced = _schur(_normal(problem, shared, parts, weights, starts), free, 0.0)[0]
    covariance = np.zeros((len(shared), len(shared)))
    covariance[np.ix_(free, free)] = _inverse(reduced) * variance
    return Solution(
        shared=shared,
        local=local,
        residuals=residuals,
        weights=weights,
        covariance=covariance,
        sigma=float(np.sqrt(variance)),
        converged=converged,
        steps=steps,
    )
