"""Both cameras looking at the same boards: order of the points, metric bundle, R and T in metres."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NoReturn

import numpy as np

from ptzd.calibration.bundle import Problem, Solution, rotations, solve
from ptzd.calibration.intrinsics import turn_derivative
from ptzd.calibration.lens import Lens
from ptzd.calibration.pose import plane_pose
from ptzd.calibration.views import BoardView, Status, ViewVerdict, rms
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.types import Array, CameraModel

SAME_RAD = math.radians(10.0)
"""Pairs whose own R differs by less tell of one rig."""
MAX_RMS_PX = 3.0
MOST = 0.6
"""Share of the pairs that must tell of one rig."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """A camera that saw a board: its lens, and its place on the head."""

    lens: Lens
    values: Array
    camera: CameraModel
    view: BoardView
    head_from_camera: Array
    """``(3, 3)``; the identity for the fisheye."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardPair:
    """One board at one place, seen by the fisheye and by the PTZ at rest."""

    name: str
    fisheye: Seen
    ptz: Seen


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFit:
    """R and T, and how well they are known."""

    rotation: Array
    translation: Array
    covariance: Array
    """Of (turn on the left of R, T) ``(6, 6)``, rad and m."""
    rms_px: float
    fisheye_rms_px: float
    ptz_rms_px: float
    residuals: Array
    fisheye_px: Array
    """Points found in the fisheye ``(n, 2)``."""
    fisheye_residuals_px: Array
    """Found minus predicted ``(n, 2)``."""
    verdicts: tuple[ViewVerdict, ...]
    reversed_names: tuple[str, ...]
    """Pairs in which one camera's order of points was the other's turned by 180°."""
    poses: Array
    """Boards in the fisheye's frame ``(g, 6)``."""

    def fisheye_points(self) -> tuple[Array, Array]:
        """Points found in the fisheye and their residuals, px."""
        return self.fisheye_px, self.fisheye_residuals_px


@dataclass(frozen=True, slots=True)
class _Guess:
    rotation: Array
    translation: Array


def _own_motion(pair: BoardPair, ptz: BoardView) -> _Guess | None:
    """R and T from one pair alone: both cameras' poses of the board."""
    rays_f, valid_f = pair.fisheye.camera.lift(pair.fisheye.view.pixels)
    rays_c, valid_c = pair.ptz.camera.lift(ptz.pixels)
    if valid_f.sum() < 6 or valid_c.sum() < 6:
        return None
    board_f = plane_pose(pair.fisheye.view.points_m[valid_f], rays_f[valid_f])
    board_f = _polished(pair.fisheye, pair.fisheye.view, board_f)
    board_c = plane_pose(ptz.points_m[valid_c], rays_c[valid_c])
    board_c = _polished(pair.ptz, ptz, board_c)
    in_f, in_c = rotation_from_rotvec(board_f[:3]), rotation_from_rotvec(board_c[:3])
    rotation = pair.ptz.head_from_camera @ in_c @ in_f.T
    return _Guess(rotation, pair.ptz.head_from_camera @ board_c[3:] - rotation @ board_f[3:])


def _polished(seen: Seen, view: BoardView, pose: Array) -> Array:
    """The pose at the least reprojection error."""

    def linearise(shared: Array, poses: Array) -> tuple[Array, Array, Array]:
        turned = view.points_m @ rotations(poses[:, :3])[0].T
        predicted, _, by = seen.lens.project(seen.values, turned + poses[0, 3:])
        by_pose = np.concatenate([np.matmul(by, turn_derivative(turned)), by], axis=2)
        return predicted - view.pixels, np.zeros((len(turned), 2, 0)), by_pose

    bundle = Problem(
        linearise=linearise,
        group=np.zeros(len(view.pixels), np.int64),
        free=np.zeros(0, bool),
        local_rotations=(0,),
        steps=25,
    )
    return np.asarray(solve(bundle, np.zeros(0), pose[None]).local[0])


def _choose(pairs: Sequence[BoardPair]) -> tuple[list[BoardPair], list[str], _Guess]:
    """Fix the order of the points in every pair so that all pairs tell of one rig."""
    options = [[(view, _own_motion(pair, view)) for view in pair.ptz.view.orders()] for pair in pairs]
    guesses = [guess for row in options for _, guess in row if guess is not None]
    if not guesses:
        raise CalibrationError("boards: none can be placed in both cameras; check both intrinsic calibrations")
    costs = [sum(min(_distance(guess, other) for _, other in row) for row in options) for guess in guesses]
    best = guesses[int(np.argmin(costs))]
    chosen, swapped = [], []
    for pair, row in zip(pairs, options, strict=True):
        distances = [_distance(best, other) for _, other in row]
        index = int(np.argmin(distances))
        if distances[index] >= SAME_RAD:
            continue
        if index > 0:
            swapped.append(pair.name)
        chosen.append(replace(pair, ptz=replace(pair.ptz, view=row[index][0])))
    return chosen, swapped, best


def _distance(one: _Guess, other: _Guess | None) -> float:
    """Angle between rotations plus the angle by which T looks different at two baselines, at most `SAME_RAD`."""
    if other is None:
        return SAME_RAD
    turn = float(np.linalg.norm(rotvec_from_rotation(one.rotation @ other.rotation.T)))
    size = float(np.linalg.norm(one.translation) + np.linalg.norm(other.translation)) + 1e-12
    return min(turn + 0.2 * float(np.linalg.norm(one.translation - other.translation)) / size, SAME_RAD)


def calibrate_boards(pairs: Sequence[BoardPair]) -> RigFit:
    """R and T in metres from boards that both cameras see.

    The order of the points of a symmetric board is resolved per pair; a pair that contradicts the others is left out by
    name. Intrinsics are held.

    Raises
    ------
    CalibrationError
        When no pair is left, or the pairs contradict each other.
    """
    if not pairs:
        raise CalibrationError("boards: no board is seen by both cameras; hold it where both see it whole")
    fit = _attempt(pairs)
    if fit is None or fit.rms_px > MAX_RMS_PX:
        _explain(pairs, fit)
    assert fit is not None
    return fit


def _attempt(pairs: Sequence[BoardPair]) -> RigFit | None:
    """The rig of most pairs; None when fewer than `MOST` of them tell of one."""
    chosen, swapped, guess = _choose(pairs)
    if len(chosen) < max(1, math.ceil(MOST * len(pairs))):
        return None
    solution, fit_f, fit_p = _bundle(chosen, guess)
    names = {pair.name for pair in chosen}
    used = [
        ViewVerdict(
            name=pair.name,
            status=Status.USED,
            reason="order of points reversed" if pair.name in swapped else "",
            rms_px=rms(np.concatenate([fit_f[i], fit_p[i]])),
        )
        for i, pair in enumerate(chosen)
    ]
    left_out = [
        ViewVerdict(name=pair.name, status=Status.OUTLIER, reason="tells of another rig than the other pairs")
        for pair in pairs
        if pair.name not in names
    ]
    return RigFit(
        rotation=rotation_from_rotvec(solution.shared[:3]),
        translation=solution.shared[3:],
        covariance=solution.covariance,
        rms_px=rms(solution.residuals),
        fisheye_rms_px=rms(np.concatenate(fit_f)),
        ptz_rms_px=rms(np.concatenate(fit_p)),
        residuals=solution.residuals,
        fisheye_px=np.concatenate([pair.fisheye.view.pixels for pair in chosen]),
        fisheye_residuals_px=-np.concatenate(fit_f),
        verdicts=(*used, *left_out),
        reversed_names=tuple(swapped),
        poses=solution.local,
    )


def _explain(pairs: Sequence[BoardPair], fit: RigFit | None) -> NoReturn:
    """Raise with the reason why the pairs contradict each other."""
    width = pairs[0].ptz.camera.size_px[0]
    mirrored = [replace(p, ptz=replace(p.ptz, view=p.ptz.view.mirrored(width))) for p in pairs]
    other = _attempt(mirrored) if len(pairs) > 2 else None
    if other is not None and other.rms_px < min(MAX_RMS_PX, 0.3 * (fit.rms_px if fit else math.inf)):
        raise CalibrationError(
            "boards: the pictures of one of the two cameras are mirrored; switch mirroring off in it"
        )
    if fit is None:
        raise CalibrationError(
            f"boards: fewer than {MOST:.0%} of {len(pairs)} pairs tell of one rig; check that each pair was taken with "
            "the board at one place and the head's angles written down"
        )
    raise CalibrationError(
        f"boards: both cameras agree only to {fit.rms_px:.1f} px; check that each pair of pictures shows the board at "
        "one place, and both intrinsic calibrations"
    )


def _bundle(pairs: Sequence[BoardPair], guess: _Guess) -> tuple[Solution, list[Array], list[Array]]:
    seens = [seen for pair in pairs for seen in (pair.fisheye, pair.ptz)]
    counts = [len(seen.view.pixels) for seen in seens]
    cuts = np.cumsum([0, *counts])

    def linearise(shared: Array, poses: Array) -> tuple[Array, Array, Array]:
        rig = rotation_from_rotvec(shared[:3])
        residuals, by_shared = np.empty((cuts[-1], 2)), np.zeros((cuts[-1], 2, 6))
        by_pose = np.empty((cuts[-1], 2, 6))
        boards = rotations(poses[:, :3])
        for index, seen in enumerate(seens):
            rows = slice(cuts[index], cuts[index + 1])
            turned = seen.view.points_m @ boards[index // 2].T
            points = turned + poses[index // 2, 3:]
            if index % 2 == 0:
                predicted, _, by = seen.lens.project(seen.values, points)
            else:
                carried = points @ rig.T
                in_camera = seen.head_from_camera.T
                predicted, _, by = seen.lens.project(seen.values, (carried + shared[3:]) @ in_camera.T)
                by = by @ in_camera
                by_shared[rows] = np.concatenate([np.matmul(by, turn_derivative(carried)), by], axis=2)
                by = by @ rig
            residuals[rows] = predicted - seen.view.pixels
            by_pose[rows] = np.concatenate([np.matmul(by, turn_derivative(turned)), by], axis=2)
        return residuals, by_shared, by_pose

    bundle = Problem(
        linearise=linearise,
        group=np.repeat(np.arange(len(pairs)), [counts[2 * i] + counts[2 * i + 1] for i in range(len(pairs))]),
        free=np.ones(6, bool),
        shared_rotations=(0,),
        local_rotations=(0,),
    )
    poses = []
    for pair in pairs:
        rays, valid = pair.fisheye.camera.lift(pair.fisheye.view.pixels)
        pose = plane_pose(pair.fisheye.view.points_m[valid], rays[valid])
        poses.append(_polished(pair.fisheye, pair.fisheye.view, pose))
    start = np.concatenate([rotvec_from_rotation(guess.rotation), guess.translation])
    solution = solve(bundle, start, np.stack(poses))
    parts = np.split(solution.residuals, cuts[1:-1])
    return solution, parts[0::2], parts[1::2]
