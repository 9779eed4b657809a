"""How far a rig from a scene may be off where it points, before anybody relies on it: what its own features tell.

Two witnesses. The fit's covariance, carried to directions, knows the noise of single features. Fits to halves of the
scene know what neighbours share besides (relief taken for a wall, a wrong plane): the picture is cut into squares like
a chessboard, so that neighbours stay together, and each half is fitted anew. The larger of both counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ptzd.calibration.lens import UNIFIED, WIDE_RAD
from ptzd.calibration.planes import refine_by_planes
from ptzd.calibration.scene_rig import SceneRigFit, calibrate_scene_rig, frame_of, inverse_ranges, lens_values
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.sphere import angle_between, normalise, rotation_from_rotvec
from ptzd.geometry.types import Array, Mask

SQUARES = (6, 9)
"""Squares along the picture's longer side, one division after the other."""
GRID = 20
"""Pixels along each side at which directions are compared."""
DRAWS = 60
REACH_PERCENT = 99.5
"""Of the features are no farther from the fisheye's axis than what counts as its reach."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointingError:
    """95 % of the compared directions lie within these, rad."""

    covariance_rad: float
    halves_rad: float
    """Half of what the fits to both halves differ: each knows half as much, and both err.

    Infinite where half of the features determine no rig.
    """

    @property
    def p95_rad(self) -> float:
        """The larger one."""
        return max(self.covariance_rad, self.halves_rad)

    def document(self) -> dict[str, float | None]:
        """Both for ``rig.yaml``, deg; None where unknown."""
        halves = None if math.isinf(self.halves_rad) else math.degrees(self.halves_rad)
        return {"covariance_p95_deg": math.degrees(self.covariance_rad), "halves_p95_deg": halves}


def pointing_error(
    fit: SceneRigFit, size_px: tuple[int, int], *, held: bool, progress: Callable[[str], None] = lambda text: None
) -> PointingError:
    """What error to expect of the directions over the fisheye's picture, at the ranges of the nearest features."""
    pixels, inverse_range = _grid(fit, size_px)
    whole = _directions(fit, pixels, inverse_range)
    rng = np.random.default_rng(1)
    drawn = rng.multivariate_normal(np.zeros(len(fit.covariance)), fit.covariance, DRAWS, method="eigh")
    spread = [angle_between(_directions(_moved(fit, change), pixels, inverse_range), whole) for change in drawn]
    covariance_rad = float(np.nanpercentile(np.stack(spread), 95))
    apart = []
    for squares in SQUARES:
        cells = np.floor(fit.pairs.fisheye_px * squares / max(size_px)).astype(int).sum(axis=1) % 2
        try:
            ends = [
                _directions(_refitted(fit, cells == half, size_px, held=held), pixels, inverse_range) for half in (0, 1)
            ]
        except (CalibrationError, GeometryError) as error:
            progress(f"halves of the scene: {error}")
            return PointingError(covariance_rad=covariance_rad, halves_rad=math.inf)
        apart.append(0.5 * angle_between(ends[0], ends[1]))
        progress(f"halves of the scene point {math.degrees(2.0 * float(np.nanpercentile(apart[-1], 95))):.3f}° apart")
    return PointingError(covariance_rad=covariance_rad, halves_rad=float(np.nanpercentile(np.stack(apart), 95)))


def _refitted(fit: SceneRigFit, rows: Mask, size_px: tuple[int, int], *, held: bool) -> SceneRigFit:
    """The fit to some features: with their own planes, or without where they show none."""
    start = replace(
        fit, pairs=fit.pairs.only(rows), residuals_px=fit.residuals_px[rows], across_rad=fit.across_rad[rows]
    )
    found = refine_by_planes(start, size_px, held=held)
    return calibrate_scene_rig(start.pairs, size_px, fit.values if held else None) if found is start else found


def _grid(fit: SceneRigFit, size_px: tuple[int, int]) -> tuple[Array, Array]:
    """Pixels ``(n, 2)`` as far from the axis as features are, and 1/range from the fisheye of the nearest one.

    Also where there are none: boxes will be drawn there.
    """
    width, height = size_px
    step = max(size_px) / GRID
    grid = np.stack(np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, height, step)), axis=-1)
    camera = UNIFIED.camera(fit.values, size_px, WIDE_RAD)
    rays, known = camera.lift(fit.pairs.fisheye_px)
    own, valid = camera.lift(grid.reshape(-1, 2))
    axis = np.array([0.0, 0.0, 1.0])
    reach = np.percentile(angle_between(rays[known], axis), REACH_PERCENT)
    pixels = grid.reshape(-1, 2)[valid & (angle_between(own, axis) <= reach)]
    s = np.maximum(inverse_ranges(fit.pairs.directions, rays @ fit.rotation.T, fit.translation), 0.0)
    away = np.linalg.norm(fit.pairs.directions - s[:, None] * fit.translation, axis=1)
    nearest = np.linalg.norm(pixels[:, None] - fit.pairs.fisheye_px[None], axis=-1).argmin(axis=1)
    return pixels, (s / np.maximum(away, 1e-6))[nearest]


def _directions(fit: SceneRigFit, pixels: Array, inverse_range: Array) -> Array:
    """Where a fit points for pixels at their ranges ``(n, 3)``; NaN where its lens does not reach."""
    rays, valid = UNIFIED.camera(fit.values, (1, 1), WIDE_RAD).lift(pixels)
    pointed = normalise(rays @ fit.rotation.T + inverse_range[:, None] * fit.translation)
    return np.where(valid[:, None], pointed, np.nan)


def _moved(fit: SceneRigFit, change: Array) -> SceneRigFit:
    """The fit with its shared numbers changed."""
    shared = fit.values.copy()
    shared[1] /= shared[0]
    frame = frame_of(fit.translation)
    return replace(
        fit,
        values=lens_values(shared + change[:9]),
        rotation=rotation_from_rotvec(change[9:12]) @ fit.rotation,
        translation=np.asarray(normalise(fit.translation + frame[:, 1:] @ change[12:14])),
    )
