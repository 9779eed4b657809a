"""The head from boards at rest, seen at several pans and tilts: sign, scale, offset, seat of the camera, and T_ptz.

T_ptz is where the camera's viewpoint sits against the crossing of the axes; the rig's model neglects it, as the paper
does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ptzd.calibration.boards import Seen
from ptzd.calibration.bundle import Index, Problem, rotations, solve
from ptzd.calibration.intrinsics import turn_derivative
from ptzd.calibration.pose import plane_pose
from ptzd.calibration.turning import ALL_SIGNS, NEUTRAL, PRIOR_SIGMA, Signs, head_derivatives, head_rotations
from ptzd.calibration.views import rms
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.types import Array
from ptzd.model import HeadReading

MIN_VIEWS = 4
MIN_TURN_RAD = math.radians(8.0)
MAX_RMS_PX = 3.0
_SIZE = len(NEUTRAL) + 3


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnedBoard:
    """A board in one picture of the turned PTZ; boards of one place have one number."""

    place: int
    reading: HeadReading
    seen: Seen
    """Its ``head_from_camera`` is not used."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadFit:
    """The head, and how well it is known."""

    signs: Signs
    values: Array
    """Numbers of `ptzd.calibration.turning`."""
    offset_m: Array
    """T_ptz ``(3,)`` in the camera's frame, m."""
    covariance: Array
    """Of the numbers and T_ptz ``(8, 8)``."""
    rms_px: float
    residuals: Array

    def offset_error_rad(self, range_m: float) -> float:
        """Pointing error that neglecting T_ptz makes at a range, rad."""
        return math.atan2(math.hypot(float(self.offset_m[0]), float(self.offset_m[1])), range_m)


def calibrate_head(boards: Sequence[TurnedBoard]) -> HeadFit:
    """Estimate the head.

    Parameters
    ----------
    boards : sequence of TurnedBoard
        At least four, turned over at least 8° with both axes; ordered by place.

    Raises
    ------
    CalibrationError
        When an axis does not turn, or angles and pictures contradict each other.
    """
    ordered = sorted(boards, key=lambda board: board.place)
    angles = np.radians([[board.reading.pan_deg, board.reading.tilt_deg] for board in ordered])
    if len(ordered) < MIN_VIEWS:
        raise CalibrationError(f"head: {len(ordered)} pictures with a board; take at least {MIN_VIEWS}, better 10")
    place = np.unique([board.place for board in ordered], return_inverse=True)[1]
    for axis, column in (("pan", 0), ("tilt", 1)):
        turn = max(np.ptp(angles[place == index, column]) for index in range(place.max() + 1))
        if turn < MIN_TURN_RAD:
            raise CalibrationError(
                f"head: {axis} turns by {math.degrees(turn):.1f}° only while a board stays in view; turn it by at "
                f"least {math.degrees(MIN_TURN_RAD):.0f}°"
            )
    poses = np.stack([_pose(board.seen) for board in ordered])
    signs, starts = min((_spread(poses, place, angles, signs) for signs in ALL_SIGNS), key=lambda item: item[2])[:2]
    problem = _problem(ordered, place, angles, signs)
    solution = solve(problem, np.append(NEUTRAL, np.zeros(3)), starts)
    total = rms(solution.residuals)
    if total > MAX_RMS_PX:
        raise CalibrationError(
            f"head: angles and boards agree only to {total:.1f} px; check that the angles belong to the pictures, "
            "that the board did not move, and the zoom's intrinsics"
        )
    return HeadFit(
        signs=signs,
        values=solution.shared[: len(NEUTRAL)],
        offset_m=solution.shared[len(NEUTRAL) :],
        covariance=solution.covariance,
        rms_px=total,
        residuals=solution.residuals,
    )


def _pose(seen: Seen) -> Array:
    rays, valid = seen.camera.lift(seen.view.pixels)
    return plane_pose(seen.view.points_m[valid], rays[valid])


def _spread(poses: Array, place: Index, angles: Array, signs: Signs) -> tuple[Signs, Array, float]:
    """Boards of each place in the head's frame, and by how much their pictures disagree."""
    turned = head_rotations(NEUTRAL, signs, angles)
    positions = np.einsum("nij,nj->ni", turned, poses[:, 3:])
    starts, spread = [], 0.0
    for index in range(int(place.max()) + 1):
        rows = np.flatnonzero(place == index)
        spread += float(np.linalg.norm(positions[rows] - positions[rows].mean(axis=0), axis=1).sum())
        first = int(rows[0])
        rotation = turned[first] @ rotation_from_rotvec(poses[first, :3])
        starts.append(np.append(rotvec_from_rotation(rotation), positions[first]))
    return signs, np.stack(starts), spread


def _problem(boards: Sequence[TurnedBoard], place: Index, angles: Array, signs: Signs) -> Problem:
    counts = [len(board.seen.view.pixels) for board in boards]
    cuts = np.cumsum([0, *counts])

    def linearise(shared: Array, poses: Array) -> tuple[Array, Array, Array]:
        turned = head_rotations(shared[: len(NEUTRAL)], signs, angles)
        by_head = head_derivatives(shared[: len(NEUTRAL)], signs, angles)
        at = rotations(poses[:, :3])
        residuals, by_shared = np.empty((cuts[-1], 2)), np.empty((cuts[-1], 2, _SIZE))
        by_pose = np.empty((cuts[-1], 2, 6))
        for index, board in enumerate(boards):
            rows = slice(cuts[index], cuts[index + 1])
            seen, group = board.seen, int(place[index])
            carried = seen.view.points_m @ at[group].T
            points = carried + poses[group, 3:]
            in_frame = points @ turned[index] - shared[len(NEUTRAL) :]
            predicted, _, by = seen.lens.project(seen.values, in_frame)
            residuals[rows] = predicted - seen.view.pixels
            moved = np.einsum("kji,nj->nik", by_head[:, index], points)
            by_shared[rows] = np.concatenate([np.matmul(by, moved), -by], axis=2)
            by = by @ turned[index].T
            by_pose[rows] = np.concatenate([np.matmul(by, turn_derivative(carried)), by], axis=2)
        return residuals, by_shared, by_pose

    return Problem(
        linearise=linearise,
        group=np.repeat(place, counts),
        free=np.ones(_SIZE, bool),
        local_rotations=(0,),
        prior_mean=np.append(NEUTRAL, np.zeros(3)),
        prior_sigma=np.append(PRIOR_SIGMA, np.full(3, 0.2)) / 0.3,
    )
