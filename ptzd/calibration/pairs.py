"""Two cameras on their spheres: essential matrix and geodesic refinement (paper, section 4.2).

``X_h = R X_f + T``; pairs are unit rays P_f of the fisheye and P_h of the head's frame, ``(n, 3)`` each.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ptzd.calibration.bundle import Problem, Solution, rotations, solve, turned
from ptzd.geometry.sphere import normalise, rotvec_from_rotation
from ptzd.geometry.types import Array


def geodesic(rotation: Array, translation: Array, rays_f: Array, rays_h: Array) -> Array:
    """Signed angles ``(n, 2)``, rad, of P_h to the circle of P_f and of P_f to the circle of P_h."""
    carried = rays_f @ rotation.T
    one: Array = normalise(np.cross(translation, carried))
    other = normalise(np.cross(translation, rays_h))
    sines = np.stack([(rays_h * one).sum(1), (carried * other).sum(1)], axis=-1)
    return np.asarray(np.arcsin(np.clip(sines, -1.0, 1.0)))


def refine_pairs(
    rotation: Array, translation: Array, rays_f: Array, rays_h: Array, *, loss: str = "cauchy"
) -> tuple[Array, Array, Solution]:
    """Minimise the paper's geodesic distances over R in SO(3) and |T| = 1.

    Returns
    -------
    R, T : Array
        ``(3, 3)`` and ``(3,)`` of length 1.
    solution : Solution
        Shared parameters: the turn put on the left of R, and two coordinates of T across its start.
    """
    start = normalise(translation)
    helper = np.eye(3)[int(np.argmin(np.abs(start)))]
    first = normalise(np.cross(start, helper))
    second = np.cross(start, first)

    def parts(shared: Array) -> tuple[Array, Array]:
        return rotations(shared[None, :3])[0], normalise(start + shared[3] * first + shared[4] * second)

    def linearise(shared: Array, local: Array) -> tuple[Array, Array, Array]:
        value = geodesic(*parts(shared), rays_f, rays_h)
        by = np.empty((len(rays_f), 2, 5))
        step = 1e-6
        for column in range(5):
            change = np.zeros(5)
            change[column] = step
            ahead, behind = _moved(shared, change), _moved(shared, -change)
            by[:, :, column] = (geodesic(*parts(ahead), rays_f, rays_h) - geodesic(*parts(behind), rays_f, rays_h)) / (
                2 * step
            )
        return value, by, np.zeros((len(rays_f), 2, 0))

    bundle = Problem(
        linearise=linearise,
        group=np.zeros(len(rays_f), np.int64),
        free=np.ones(5, bool),
        shared_rotations=(0,),
        loss=loss,
    )
    solution = solve(bundle, np.append(rotvec_from_rotation(rotation), [0.0, 0.0]), np.zeros((1, 0)))
    refined, direction = parts(solution.shared)
    # both distances of a pair tell of the one offset across the plane of the two rays: half as much as two would
    return refined, direction, replace(solution, covariance=2.0 * solution.covariance)


def _moved(shared: Array, change: Array) -> Array:
    moved: Array = shared + change
    moved[:3] = turned(shared[:3], change[:3])
    return moved


def essential_linear(rays_f: Array, rays_h: Array) -> tuple[Array, Array]:
    """Return R and unit T of the essential matrix of n >= 8 pairs, the motion with most points before both cameras.

    ``P_hᵀ E P_f = 0`` with ``E = [T]× R``, solved by SVD and projected to two equal singular values.
    """
    rows = (rays_h[:, :, None] * rays_f[:, None, :]).reshape(-1, 9)
    matrix = np.linalg.svd(rows.T @ rows)[0][:, -1].reshape(3, 3)
    left, _, right = np.linalg.svd(matrix)
    left, right = left * np.sign(np.linalg.det(left)), right * np.sign(np.linalg.det(right))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    best, chosen = -1, (np.eye(3), np.array([1.0, 0.0, 0.0]))
    for rotation in (left @ quarter @ right, left @ quarter.T @ right):
        for translation in (left[:, 2], -left[:, 2]):
            count = before_both(rotation, translation, rays_f, rays_h)
            if count > best:
                best, chosen = count, (rotation, translation)
    return chosen


def before_both(rotation: Array, translation: Array, rays_f: Array, rays_h: Array) -> int:
    """Number of pairs whose rays meet before both cameras."""
    carried = rays_f @ rotation.T
    normal = np.cross(carried, rays_h)
    along_f = (np.cross(rays_h, translation) * normal).sum(1)
    along_h = (np.cross(carried, translation) * normal).sum(1)
    return int(((along_f > 0) & (along_h > 0)).sum())
