"""The default matcher: every pixel of the region votes for one inverse range (a search along equation (A))."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import pan_tilt
from ptzd.matching.arrays import Floats, Mask
from ptzd.matching.centre import WINDOWS, central_window, settle_on_centre
from ptzd.matching.hypotheses import sample_inverse_ranges, speed
from ptzd.matching.noise import noise_sigma, texture_ratio
from ptzd.matching.patch import MARGIN_PX, SMOOTHING, Patch, cut_patch, step_for
from ptzd.matching.place import Place, box_in_view, in_blocks, make_grid, peaks, separate
from ptzd.matching.rays import RayField
from ptzd.matching.refine import Bounds, Refined, refine
from ptzd.matching.score import Scores, Template, make_template, score
from ptzd.matching.view import WorkingView, prepare_view
from ptzd.model import Candidate

if TYPE_CHECKING:
    from ptzd.geometry.perspective import PerspectiveCamera
    from ptzd.geometry.types import Array
    from ptzd.matching.inputs import MatchInputs

COARSE_SIDE = 16
FINE_SIDE = 40
STEP_SHARE = 0.7
"""Grid steps between neighbouring hypotheses."""
PEAKS = 8
"""Separate peaks that are refined coarsely."""
CANDIDATES = 6
"""Separate peaks that are refined finely and reported."""
LEAST_IN_VIEW = 0.5
"""Of the best share any hypothesis has in the view."""
LEAST_NOISE = 0.3
"""Grey levels: rounding and compression leave that much however many pixels are averaged."""
SEPARATION = 2.0
"""Grid steps between separate peaks."""
COARSE_ITERATIONS = 2
FINE_ITERATIONS = 3
WORTH_REFINING = 0.6
"""Share of the best rough score below which a peak is reported as it is."""
ALIKE = 0.5
"""Share of another place's score at the centre from which a place is as good a one."""
WORTH_SETTLING = 0.75
"""Share of the best score below which the centre's own surface is not asked for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """A patch, the view at its resolution, and the template of its score."""

    patch: Patch
    view: WorkingView
    template: Template
    noise: tuple[float, float]
    """One sigma of a sample, grey levels, of the patch and of the view."""
    bounds: Bounds

    def score(self, place: Place, arc: EpipolarArc) -> Scores:
        """Compare the patch with the view at k places."""
        count, rays = len(place.offset), self.patch.rays
        table = in_blocks(lambda part: self._table(place.take(part), arc), count, len(rays))
        return Scores(total=table[:, 0], in_view=table[:, 1])

    def _table(self, place: Place, arc: EpipolarArc) -> Floats:
        scores = score(self.template, self.view.sample(place.warps(arc), self.patch.rays))
        return np.stack([scores.total, scores.in_view], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What stays the same at all levels of one search."""

    inputs: MatchInputs
    arc: EpipolarArc
    camera: PerspectiveCamera
    camera_from_head: Array
    field: RayField
    noise: tuple[float, float]
    """One sigma of a pixel, grey levels, of the fisheye and of the PTZ."""

    def level(self, step: int, area_px: tuple[float, float, float, float] | None = None) -> Level:
        """Prepare both pictures for a grid of ``step`` fisheye pixels, the view in an area only."""
        inputs, rig = self.inputs, self.inputs.rig
        rotation = rig.head_from_fisheye_rotation
        patch = cut_patch(inputs.fisheye_grey, self.field, rotation, inputs.box, step)
        view = prepare_view(inputs.view_grey, self.camera, self.camera_from_head, patch.angle_rad, area_px=area_px)
        # what the averaging over a step and the low-pass leave of a pixel's noise
        own = max(self.noise[0] / step, LEAST_NOISE) / np.sqrt(4.0 * np.pi) / SMOOTHING
        other = max(self.noise[1] * view.noise_gain, LEAST_NOISE / 2)
        bounds = Bounds(inverse_range=inputs.inverse_range, band_rad=inputs.band_rad, noise=float(np.hypot(own, other)))
        noise = (own, other)
        return Level(patch=patch, view=view, template=make_template(patch, noise), noise=noise, bounds=bounds)


def sweep(inputs: MatchInputs) -> tuple[float, tuple[Candidate, ...], tuple[float, float]]:
    """Search the arc and its band.

    Returns
    -------
    (float, tuple of Candidate, (float, float))
        Texture, separate peaks best first, and the interval of inverse range that the view could show.
    """
    rig, box = inputs.rig, inputs.box
    field = RayField.of(rig.fisheye, box, MARGIN_PX)
    if not field.seen:
        return 0.0, (), (0.0, 0.0)
    scene = Scene(
        inputs=inputs,
        arc=EpipolarArc.of(rig, field.centre, *inputs.inverse_range),
        camera=rig.camera(inputs.reading),
        camera_from_head=rig.head_from_camera(inputs.reading).T,
        field=field,
        noise=(noise_sigma(inputs.fisheye_grey), noise_sigma(inputs.view_grey)),
    )
    finest = max(1, int(1.0 / scene.camera.fx / field.pixel_rad))
    coarse = scene.level(step_for(box, COARSE_SIDE, finest))
    patch, arc = coarse.patch, scene.arc
    if patch.weight.sum() == 0.0:
        return 0.0, (), (0.0, 0.0)
    texture = texture_ratio(patch.grey.reshape(patch.shape), scene.noise[0] / patch.step_px)
    grid = make_grid(inputs, arc, patch, coarse.view, STEP_SHARE * patch.angle_rad, len(patch.rays))
    if len(grid.cell) == 0:
        return texture, (), grid.coverage
    found = coarse.score(grid.place, arc)
    usable = np.where(found.in_view >= LEAST_IN_VIEW * found.in_view.max(), found.total, -np.inf)
    start = grid.place.take(peaks(grid, usable, arc, SEPARATION * patch.angle_rad, PEAKS))
    rough = refine(patch, coarse.view, arc, start, coarse.bounds, COARSE_ITERATIONS).place
    step = step_for(box, FINE_SIDE, finest)
    fine = coarse if step == patch.step_px else scene.level(step, _area(scene, patch, rough))
    return texture, _finish(scene, coarse, fine, rough), grid.coverage


def _area(scene: Scene, patch: Patch, place: Place) -> tuple[float, float, float, float]:
    """Part of the view, px, that the region covers at any of the places."""
    rows, columns = patch.shape
    corners = patch.rays.reshape(rows, columns, 3)[[0, 0, -1, -1], [0, -1, 0, -1]].astype(np.float64)
    directions = np.einsum("kij,nj->kni", place.warps(scene.arc), corners)
    pixels, valid = scene.camera.project(directions @ scene.camera_from_head.T)
    if not valid.all():
        return 0.0, 0.0, float(scene.camera.size_px[0]), float(scene.camera.size_px[1])
    slack = 2.0 * patch.angle_rad * scene.camera.fx
    (left, top), (right, bottom) = pixels.min(axis=(0, 1)) - slack, pixels.max(axis=(0, 1)) + slack
    return float(left), float(top), float(right), float(bottom)


def _finish(scene: Scene, coarse: Level, level: Level, rough: Place) -> tuple[Candidate, ...]:
    """Refine what deserves it and write down the candidates."""
    arc, patch = scene.arc, level.patch
    apart = SEPARATION * patch.angle_rad
    scores, sharpness = _on_the_arc(coarse, arc, rough)
    order = separate(rough, scores, arc, apart, CANDIDATES)
    rough, scores, sharpness = rough.take(order), scores[order], sharpness[order]
    worth = int((scores >= scores[0] - (1.0 - WORTH_REFINING) * abs(scores[0])).sum())
    refined = refine(patch, level.view, arc, rough.take(np.arange(worth)), level.bounds, FINE_ITERATIONS)
    whole = refined.place.join(rough.take(np.arange(worth, len(order))))
    sigma = np.concatenate([refined.sigma_rad, np.full(len(order) - worth, patch.angle_rad)])
    found = level.score(whole, arc)
    top = float(found.total.max())
    settled = np.flatnonzero(found.total[:worth] >= top - (1.0 - WORTH_SETTLING) * abs(top))
    ranges = sample_inverse_ranges(
        arc.rotated[None], arc.translation, scene.inputs.inverse_range, STEP_SHARE * patch.angle_rad
    )
    if len(settled):
        outer = Refined(place=whole.take(settled), sigma_rad=sigma[settled], gain=refined.gain[settled])
        inner, inner_sigma = settle_on_centre(patch, level.view, arc, outer, level.bounds, ranges)
        moved = np.flatnonzero(~_onto_its_like(level, arc, outer.place, inner))
        whole.planes[settled[moved]], sigma[settled[moved]] = inner.planes[moved], inner_sigma[moved]
    chosen = separate(whole, found.total, arc, apart, CANDIDATES)
    return _candidates(
        scene, whole.take(chosen), found.total[chosen], sharpness[chosen], sigma[chosen], found.in_view[chosen]
    )


def _onto_its_like(level: Level, arc: EpipolarArc, before: Place, after: Place) -> Mask:
    """Which candidates moved to where another one was, though their own centre is as like: these stay two places."""
    distance = SEPARATION * level.patch.angle_rad
    near = after.bearings(arc) @ before.bearings(arc).T >= 1.0 - 0.5 * distance * distance
    onto_another = np.asarray(near.any(axis=1) & ~near.diagonal())
    window = central_window(level.patch, WINDOWS[0])
    if window is None or not onto_another.any():
        return onto_another
    centre = replace(level, patch=window, template=make_template(window, level.noise))
    left, reached = np.split(centre.score(before.join(after), arc).total, 2)
    return np.asarray(onto_another & (left >= ALIKE * reached))


def _candidates(
    scene: Scene, place: Place, scores: Floats, sharpness: Floats, sigma: Floats, in_view: Floats
) -> tuple[Candidate, ...]:
    pan, tilt = pan_tilt(place.bearings(scene.arc))
    boxes = box_in_view(scene.inputs, scene.field.corners, place, scene.arc)
    inverse_range = np.maximum(place.planes @ scene.arc.rotated, 0.0)
    return tuple(
        Candidate(
            pan_rad=float(pan[k]),
            tilt_rad=float(tilt[k]),
            inverse_range=float(inverse_range[k]),
            offset_rad=float(place.offset[k]),
            score=float(np.clip(scores[k], -1.0, 1.0)),
            sharpness=float(sharpness[k]),
            sigma_rad=float(sigma[k]),
            plane=(float(place.planes[k, 0]), float(place.planes[k, 1]), float(place.planes[k, 2])),
            box_px=boxes[k],
            in_view=float(min(in_view[k], 1.0)),
        )
        for k in range(len(scores))
    )


def _on_the_arc(level: Level, arc: EpipolarArc, place: Place) -> tuple[Floats, Floats]:
    """Scores, and their curvature along the arc from one grid step to either side, per (fisheye pixel)²."""
    shift = level.patch.angle_rad / np.maximum(speed(arc, place.planes @ arc.rotated), 1e-3)
    move = shift[:, None] * arc.rotated
    nearer = Place(planes=place.planes + move, offset=place.offset, roll=place.roll)
    farther = Place(planes=place.planes - move, offset=place.offset, roll=place.roll)
    peak, *sides = np.split(level.score(place.join(nearer).join(farther), arc).total, 3)
    return peak, (2.0 * peak - sides[0] - sides[1]) / level.patch.step_px**2
