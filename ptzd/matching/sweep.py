"""The default matcher: every pixel of the region votes for one inverse range (a search along equation (A))."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import pan_tilt
from ptzd.matching.arrays import Floats
from ptzd.matching.centre import settle_on_centre
from ptzd.matching.hypotheses import sample_inverse_ranges, speed
from ptzd.matching.noise import noise_sigma, texture_ratio
from ptzd.matching.patch import SMOOTHING, Patch, cut_patch, pixel_angle, step_for
from ptzd.matching.place import Place, box_in_view, make_grid, peaks, separate
from ptzd.matching.refine import Bounds, refine
from ptzd.matching.score import Scores, Template, make_template, score
from ptzd.matching.view import WorkingView, prepare_view, view_pixel_angle
from ptzd.model import Candidate

if TYPE_CHECKING:
    from ptzd.matching.inputs import MatchInputs

COARSE_SIDE = 16
FINE_SIDE = 40
STEP_SHARE = 0.7
"""Grid steps between neighbouring hypotheses."""
PEAKS = 10
"""Separate peaks that are refined coarsely."""
CANDIDATES = 6
"""Separate peaks that are refined finely and reported."""
LEAST_IN_VIEW = 0.35
"""Of the best share any hypothesis has in the view."""
SEPARATION = 2.0
"""Grid steps between separate peaks."""
COARSE_ITERATIONS = 4
FINE_ITERATIONS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """A patch, the view at its resolution, and the template of its score."""

    patch: Patch
    view: WorkingView
    template: Template
    bounds: Bounds

    def score(self, place: Place, arc: EpipolarArc) -> Scores:
        """Compare the patch with the view at k places."""
        return score(self.template, self.view.sample(place.warps(arc), self.patch.rays))


def sweep(inputs: MatchInputs) -> tuple[float, tuple[Candidate, ...], tuple[float, float]]:
    """Search the arc and its band.

    Returns
    -------
    (float, tuple of Candidate, (float, float))
        Texture, separate peaks best first, and the interval of inverse range that the view could show.
    """
    rig, box = inputs.rig, inputs.box
    centre, valid = rig.fisheye.lift(np.array(box.centre))
    if not valid:
        return 0.0, (), (0.0, 0.0)
    arc = EpipolarArc.of(rig, centre, *inputs.inverse_range)
    noise = noise_sigma(inputs.fisheye_grey)
    finest = max(1, int(view_pixel_angle(rig.camera(inputs.reading)) / pixel_angle(rig.fisheye, box.centre)))
    coarse = _level(inputs, step_for(box, COARSE_SIDE, finest), noise)
    patch = coarse.patch
    if patch.weight.sum() == 0.0:
        return 0.0, (), (0.0, 0.0)
    texture = texture_ratio(patch.grey.reshape(patch.shape), noise / patch.step_px)
    grid = make_grid(inputs, arc, patch, coarse.view, STEP_SHARE * patch.angle_rad)
    if len(grid.cell) == 0:
        return texture, (), grid.coverage
    found = coarse.score(grid.place, arc)
    usable = np.where(found.in_view >= LEAST_IN_VIEW * found.in_view.max(), found.total, -np.inf)
    start = grid.place.take(peaks(grid, usable, arc, SEPARATION * patch.angle_rad, PEAKS))
    rough = refine(patch, coarse.view, arc, start, coarse.bounds, COARSE_ITERATIONS).place
    step = step_for(box, FINE_SIDE, finest)
    fine = coarse if step == patch.step_px else _level(inputs, step, noise)
    scores = fine.score(rough, arc).total
    rough = rough.take(separate(rough, scores, arc, SEPARATION * fine.patch.angle_rad, CANDIDATES))
    return texture, _finish(fine, arc, rough, inputs), grid.coverage


def _level(inputs: MatchInputs, step: int, noise: float) -> Level:
    rig = inputs.rig
    patch = cut_patch(inputs.fisheye_grey, rig.fisheye, rig.head_from_fisheye_rotation, inputs.box, step)
    camera_from_head = rig.head_from_camera(inputs.reading).T
    view = prepare_view(inputs.view_grey, rig.camera(inputs.reading), camera_from_head, patch.angle_rad)
    # what the averaging over a step and the low-pass leave of a pixel's noise
    sample_noise = max(noise / step, 0.3) / np.sqrt(4.0 * np.pi) / SMOOTHING
    bounds = Bounds(inverse_range=inputs.inverse_range, band_rad=inputs.band_rad, noise=sample_noise)
    return Level(patch=patch, view=view, template=make_template(patch, sample_noise), bounds=bounds)


def _finish(level: Level, arc: EpipolarArc, start: Place, inputs: MatchInputs) -> tuple[Candidate, ...]:
    patch = level.patch
    refined = refine(patch, level.view, arc, start, level.bounds, FINE_ITERATIONS)
    ranges = sample_inverse_ranges(
        arc.rotated[None], arc.translation, inputs.inverse_range, STEP_SHARE * patch.angle_rad
    )
    place, sigma = settle_on_centre(patch, level.view, arc, refined, level.bounds, ranges)
    scores = level.score(refined.place, arc)
    sharpness = _sharpness(level, arc, refined.place, scores.total)
    pan, tilt = pan_tilt(place.bearings(arc))
    boxes = box_in_view(inputs, place, arc)
    return tuple(
        Candidate(
            pan_rad=float(pan[k]),
            tilt_rad=float(tilt[k]),
            inverse_range=max(float(place.planes[k] @ arc.rotated), 0.0),
            offset_rad=float(place.offset[k]),
            score=float(np.clip(scores.total[k], -1.0, 1.0)),
            sharpness=float(sharpness[k]),
            sigma_rad=float(sigma[k]),
            plane=(float(place.planes[k, 0]), float(place.planes[k, 1]), float(place.planes[k, 2])),
            box_px=boxes[k],
            in_view=float(min(scores.in_view[k], 1.0)),
        )
        for k in separate(place, scores.total, arc, SEPARATION * level.patch.angle_rad, CANDIDATES)
    )


def _sharpness(level: Level, arc: EpipolarArc, place: Place, peak: Floats) -> Floats:
    """Curvature of the score along the arc, from one grid step to either side, per (fisheye pixel)²."""
    shift = level.patch.angle_rad / np.maximum(speed(arc, place.planes @ arc.rotated), 1e-3)
    sides = [
        level.score(
            Place(planes=place.planes + (sign * shift)[:, None] * arc.rotated, offset=place.offset, roll=place.roll),
            arc,
        ).total
        for sign in (-1.0, 1.0)
    ]
    return np.asarray((2.0 * peak - sides[0] - sides[1]) / level.patch.step_px**2)
