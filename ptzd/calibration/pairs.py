"""Two cameras on their spheres: plane homography, essential matrix, geodesic refinement (paper, section 4.2).

``X_h = R X_f + T``; pairs are unit rays P_f of the fisheye and P_h of the head's frame, ``(n, 3)`` each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ptzd.calibration.bundle import Problem, Solution, rotations, solve, turned
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import normalise, rotvec_from_rotation
from ptzd.geometry.types import Array

DECIDED = 4.0
"""A motion counts as the one when the next carries the pairs so many times worse."""
MIN_SHIFT = 1e-4
"""|T|/d of a homography below which the cameras count as standing at one place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """One decomposition of a homography."""

    rotation: Array
    shift: Array
    """T / d ``(3,)``: T in units of the plane's distance from the fisheye."""
    normal: Array
    """Unit normal of the plane in the fisheye's frame, towards the plane."""


def sphere_homography(rays_f: Array, rays_h: Array) -> Array:
    """Return H ``(3, 3)`` with ``P_h ∝ H P_f``, its middle singular value 1.

    The inverse direction of the paper's eq. 5; linear from ``P_h × H P_f = 0``, n >= 4 rays of a plane, at any
    angle off the axis.

    Raises
    ------
    CalibrationError
        When the rays do not determine it.
    """
    if len(rays_f) < 4:
        raise CalibrationError(f"plane: {len(rays_f)} pairs; at least 4, better 20, are needed")
    x, y, z = rays_h[:, :1], rays_h[:, 1:2], rays_h[:, 2:]
    zero = np.zeros_like(rays_f)
    rows = np.concatenate(
        [
            np.concatenate([zero, -z * rays_f, y * rays_f], axis=1),
            np.concatenate([z * rays_f, zero, -x * rays_f], axis=1),
            np.concatenate([-y * rays_f, x * rays_f, zero], axis=1),
        ]
    )
    singular, vectors = np.linalg.svd(rows, full_matrices=False)[1:]
    if singular[7] < 1e-9 * singular[0]:
        raise CalibrationError("plane: its points lie on one line; take points spread over the plane")
    matrix = vectors[8].reshape(3, 3)
    matrix = matrix / np.linalg.svd(matrix, compute_uv=False)[1]
    sign = np.sign((rays_h * (rays_f @ matrix.T)).sum())
    return np.asarray(matrix * sign)


def decompose(matrix: Array, rays_f: Array) -> tuple[Motion, ...]:
    """Return the motions ``H = R + (T/d) nᵀ`` that keep the plane before the fisheye along all rays: two, or one.

    Through the eigenvectors of HᵀH (Ma, Soatto, Košecká & Sastry 2004, section 5.3).

    Raises
    ------
    CalibrationError
        When no parallax is seen: the cameras' distance is too small against the plane's.
    """
    values, vectors = np.linalg.eigh(matrix.T @ matrix)
    third, first = values[0], values[2]
    if first - third < MIN_SHIFT:
        raise CalibrationError("plane: it shows no parallax; take a plane nearer to the cameras")
    v1, v2, v3 = vectors[:, 2], vectors[:, 1], vectors[:, 0]
    v2 = v2 * np.sign(np.linalg.det(np.column_stack([v1, v2, v3])))
    low, high = np.sqrt(max(1 - third, 0.0)), np.sqrt(max(first - 1, 0.0))
    found = []
    for sign in (1.0, -1.0):
        u = (low * v1 + sign * high * v3) / np.sqrt(first - third)
        normal = np.cross(v2, u)
        one = np.column_stack([v2, u, normal])
        image = np.column_stack([matrix @ v2, matrix @ u, np.cross(matrix @ v2, matrix @ u)])
        rotation = image @ one.T
        if (rays_f @ normal).sum() < 0.0:
            normal = -normal
        if (rays_f @ normal > 0.0).mean() > 0.99:
            found.append(Motion(rotation=rotation, shift=(matrix - rotation) @ normal, normal=normal))
    if not found:
        raise CalibrationError("plane: no motion keeps it before both cameras; check the pairs")
    return tuple(found)


def join_planes(planes: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return R ``(3, 3)`` and the direction of T ``(3,)`` from the pairs of one plane or several.

    Of each plane's motions the one is kept whose epipolar circles carry the pairs of the other planes; a single plane
    keeps two motions and is refused.

    Raises
    ------
    CalibrationError
        When a single plane, or parallel ones, leave the choice open.
    """
    options = [motion for rays in planes for motion in decompose(sphere_homography(*rays), rays[0])]
    rays_f = np.concatenate([rays[0] for rays in planes])
    rays_h = np.concatenate([rays[1] for rays in planes])
    costs = []
    for option in options:
        off = geodesic(option.rotation, normalise(option.shift), rays_f, rays_h)
        costs.append(float(np.median(np.abs(off))))
    best = int(np.argmin(costs))
    other = min(
        (cost for cost, option in zip(costs, options, strict=True) if _apart(option, options[best])),
        default=np.inf,
    )
    if other < DECIDED * costs[best] + 1e-9:
        raise CalibrationError(
            "plane: two motions explain it equally well; add a second plane that is not parallel to the first"
        )
    return options[best].rotation, np.asarray(normalise(options[best].shift))


def _apart(one: Motion, other: Motion) -> bool:
    return bool(np.linalg.norm(one.rotation - other.rotation) > 0.02)


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
