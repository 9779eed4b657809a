"""The paper's matcher (section 5.2): corners, the epipolar band, a three-parameter homography by RANSAC; no descriptor.

Differences from the paper, each because it was measured to help: corners of the view are found at the fisheye's
resolution, since corners of one scale do not repeat at another; hypotheses start from every pair, not from random ones;
the best triples are optimised over their inliers; every corner counts once; the band's offset is searched too; and the
inlier count is weighed against the count that chance alone would give.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.plane import in_front_of_both, plane_from_pairs, too_oblique
from ptzd.geometry.sphere import normalise, pan_tilt
from ptzd.matching.arrays import Floats, Index, Mask
from ptzd.matching.corners import harris_corners
from ptzd.matching.hypotheses import turns
from ptzd.matching.lookup import look_up
from ptzd.matching.noise import noise_sigma, texture_ratio
from ptzd.matching.patch import MARGIN_PX, Patch, cut_patch, step_for
from ptzd.matching.place import Place, box_in_view, in_blocks, make_grid, peaks, separate
from ptzd.matching.rays import RayField
from ptzd.matching.view import WorkingView, prepare_view, view_pixel_angle
from ptzd.model import Candidate

if TYPE_CHECKING:
    from ptzd.geometry.types import Array
    from ptzd.matching.inputs import MatchInputs


GRID_SIDE = 60
"""Greatest number of grid steps along the box: corners need the full resolution longer than pixels do."""
MOST_REGION_CORNERS = 60
MOST_VIEW_CORNERS = 1500
TOLERANCE_STEPS = 1.2
"""Distance of an inlier in grid steps: the paper's tau, tied to the fisheye's pixel."""
STEP_SHARE = 0.7
PEAKS = 12
TRIPLES = 120
"""Random triples per peak."""
LEAST_CORNERS = 4
CANDIDATES = 6
OPTIMISATIONS = 4
SEPARATION = 2.0
REPORTED_DIGITS = 10.0
"""An inlier count that chance reaches once in 10^10 searches scores 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pairing:
    """Corners of the region and of the view, and a map of how near the view's corners are."""

    rays: Floats
    """(n, 3) pre-rotated unit rays of the region's corners."""
    view: WorkingView
    corners: Floats
    """(m, 2) places of the view's corners, working px."""
    bearings: Array
    """(m, 3) their head-frame directions."""
    nearness: WorkingView
    """1 on a corner of the view, falling to 0 at the tolerance."""
    tolerance_px: float
    chance: float
    """Share of the view within the tolerance of some corner."""

    def soft_count(self, place: Place, arc: EpipolarArc) -> Array:
        """Sum over the region's corners of their nearness to a corner of the view, (k,)."""

        def count(part: slice) -> Floats:
            samples = self.nearness.sample(place.take(part).warps(arc), self.rays)
            return np.asarray((samples.grey * samples.inside).sum(axis=1), dtype=np.float64)

        return np.asarray(in_blocks(count, len(place.offset), len(self.rays)), dtype=np.float64)


def harris(inputs: MatchInputs) -> tuple[float, tuple[Candidate, ...], tuple[float, float]]:
    """Search the arc and its band by corners.

    Returns
    -------
    (float, tuple of Candidate, (float, float))
        Texture, separate places best first, and the interval of inverse range that the view could show. The score is
        how many digits the inlier count lies above chance, over `REPORTED_DIGITS`.
    """
    rig, box = inputs.rig, inputs.box
    field = RayField.of(rig.fisheye, box, MARGIN_PX)
    if not field.seen:
        return 0.0, (), (0.0, 0.0)
    arc = EpipolarArc.of(rig, field.centre, *inputs.inverse_range)
    camera = rig.camera(inputs.reading)
    step = step_for(box, GRID_SIDE, max(1, int(view_pixel_angle(camera) / field.pixel_rad)))
    patch = cut_patch(inputs.fisheye_grey, field, rig.head_from_fisheye_rotation, box, step)
    texture = texture_ratio(patch.grey.reshape(patch.shape), noise_sigma(inputs.fisheye_grey) / patch.step_px)
    camera_from_head = rig.head_from_camera(inputs.reading).T
    view = prepare_view(inputs.view_grey, camera, camera_from_head, patch.angle_rad, oversampling=1.0)
    pairing = _pair(patch, view)
    grid = make_grid(inputs, arc, patch, view, STEP_SHARE * patch.angle_rad, len(pairing.rays))
    if len(grid.cell) == 0 or len(pairing.rays) < LEAST_CORNERS or len(pairing.corners) == 0:
        return texture, (), grid.coverage
    counts = pairing.soft_count(grid.place, arc)
    start = grid.place.take(peaks(grid, counts, arc, SEPARATION * patch.angle_rad, PEAKS))
    rng = np.random.default_rng(inputs.seed)
    best = _best_triple(pairing, arc, start, 0, rng)
    for k in range(1, len(start.offset)):
        best = best.join(_best_triple(pairing, arc, start, k, rng))
    for _ in range(OPTIMISATIONS):
        best = _optimised(pairing, arc, best)
    candidates = _candidates(inputs, field.corners, pairing, arc, best, patch.angle_rad, len(grid.cell))
    return texture, candidates, grid.coverage


def _pair(patch: Patch, view: WorkingView) -> Pairing:
    scale = view.pixels_per_step
    places = harris_corners(patch.grey.reshape(patch.shape), MOST_REGION_CORNERS, 1.0)
    seen = patch.weight[np.ravel_multi_index((places + 0.5).astype(int).T[::-1], patch.shape)] > 0
    places = places[seen]
    table = patch.rays.reshape(*patch.shape, 3)
    rays = look_up(table, places[:, :1], places[:, 1:])[:, 0]
    corners = harris_corners(view.image, MOST_VIEW_CORNERS, scale)
    empty = np.full(view.image.shape, 255, np.uint8)
    rounded = np.round(corners).astype(int)
    empty[rounded[:, 1], rounded[:, 0]] = 0
    tolerance = TOLERANCE_STEPS * scale
    distance = cv2.distanceTransform(empty, cv2.DIST_L2, 3) if len(corners) else np.full(empty.shape, 1e6, np.float32)
    nearness = np.maximum(1.0 - (distance / tolerance) ** 2, 0.0).astype(np.float32)
    homogeneous = np.column_stack([corners.astype(np.float64), np.ones(len(corners))])
    return Pairing(
        rays=normalise(rays).astype(np.float32),
        view=view,
        corners=corners,
        bearings=normalise(homogeneous @ np.linalg.inv(view.pixels_from_head).T),
        nearness=replace(view, image=nearness),
        tolerance_px=tolerance,
        chance=float((distance < tolerance).mean()),
    )


def _best_triple(pairing: Pairing, arc: EpipolarArc, start: Place, k: int, rng: np.random.Generator) -> Place:
    """Best plane through three pairs near one hypothesis, or the hypothesis itself."""
    own = start.take(np.array([k]))
    distance = _distances(pairing, arc, own)[0]
    near_ray, near_corner = np.nonzero(distance < 3.0 * pairing.tolerance_px)
    if len(np.unique(near_ray)) < 3:
        return own
    pick = rng.integers(0, len(near_ray), (TRIPLES, 3))
    chosen = near_ray[pick]
    distinct = (chosen[:, 0] != chosen[:, 1]) & (chosen[:, 0] != chosen[:, 2]) & (chosen[:, 1] != chosen[:, 2])
    pick = pick[distinct]
    unturned = pairing.bearings @ _turn(arc, own)
    rays = pairing.rays.astype(np.float64)
    planes, valid = plane_from_pairs(rays[near_ray[pick]], unturned[near_corner[pick]], arc.translation)
    planes = planes[valid & _plausible(planes, arc, rays)]
    everything = Place(
        planes=np.vstack([own.planes, planes]),
        offset=np.full(len(planes) + 1, own.offset[0]),
        roll=np.zeros(len(planes) + 1),
    )
    return everything.take(np.array([int(np.argmax(pairing.soft_count(everything, arc)))]))


def _plausible(planes: Array, arc: EpipolarArc, rays: Array) -> Mask:
    inverse_range = planes @ arc.rotated
    inside = (inverse_range >= arc.s_min - 1e-3) & (inverse_range <= 1.2 * arc.s_max + 1e-3)
    return np.asarray(
        inside & in_front_of_both(arc.translation, planes, rays, -1e-2) & ~too_oblique(planes, arc.rotated)
    )


def _turn(arc: EpipolarArc, place: Place) -> Array:
    return np.asarray(turns(arc, place.planes @ arc.rotated, place.offset, place.roll).rotation[0])


def _distances(pairing: Pairing, arc: EpipolarArc, place: Place) -> Array:
    """Distance of every predicted corner from every corner of the view, (k, n, m), working px; far when out of view."""
    samples = pairing.view.sample(place.warps(arc), pairing.rays)
    predicted = np.stack([samples.x, samples.y], axis=-1)
    distance = np.linalg.norm(predicted[:, :, None] - pairing.corners, axis=-1)
    return np.where(samples.inside[:, :, None], distance, np.inf)


def _matches(distance: Array, tolerance: float) -> tuple[Index, Index]:
    """Pairs that are each other's nearest and within the tolerance: every corner counts once."""
    forth, back = distance.argmin(axis=1), distance.argmin(axis=0)
    index = np.arange(len(distance))
    good = (back[forth] == index) & (distance[index, forth] < tolerance)
    return index[good], forth[good]


def _optimised(pairing: Pairing, arc: EpipolarArc, place: Place) -> Place:
    """Planes fitted to all inliers, kept where the count does not fall."""
    distances = _distances(pairing, arc, place)
    planes = place.planes.copy()
    rays = pairing.rays.astype(np.float64)
    for k, distance in enumerate(distances):
        ray, corner = _matches(distance, pairing.tolerance_px)
        if len(ray) < 3:
            continue
        own = place.take(np.array([k]))
        fitted, valid = plane_from_pairs(rays[ray], (pairing.bearings @ _turn(arc, own))[corner], arc.translation)
        if valid and _plausible(fitted[None], arc, rays)[0]:
            planes[k] = fitted
    moved = replace(place, planes=planes)
    better = pairing.soft_count(moved, arc) >= pairing.soft_count(place, arc)
    return replace(place, planes=np.where(better[:, None], planes, place.planes))


def _candidates(
    inputs: MatchInputs,
    corners: Array,
    pairing: Pairing,
    arc: EpipolarArc,
    place: Place,
    step_rad: float,
    tried: int,
) -> tuple[Candidate, ...]:
    distances = _distances(pairing, arc, place)
    matches = [_matches(distance, pairing.tolerance_px) for distance in distances]
    inliers = np.array([len(ray) for ray, _ in matches])
    in_view = np.isfinite(distances[:, :, 0]).sum(axis=1)
    digits = np.array(
        [
            _digits_above_chance(int(count), int(total), pairing.chance, tried)
            for count, total in zip(inliers, in_view, strict=True)
        ]
    )
    residual = np.array(
        [
            np.sqrt((distance[pair] ** 2).mean()) if len(pair[0]) else pairing.tolerance_px
            for distance, pair in zip(distances, matches, strict=True)
        ]
    )
    sigma = step_rad * np.maximum(residual / pairing.view.pixels_per_step, 0.3) / np.sqrt(np.maximum(inliers - 3, 1))
    pan, tilt = pan_tilt(place.bearings(arc))
    boxes = box_in_view(inputs, corners, place, arc)
    return tuple(
        Candidate(
            pan_rad=float(pan[k]),
            tilt_rad=float(tilt[k]),
            inverse_range=max(float(place.planes[k] @ arc.rotated), 0.0),
            offset_rad=float(place.offset[k]),
            score=float(np.clip(digits[k] / REPORTED_DIGITS, -1.0, 1.0)),
            sharpness=0.0,
            sigma_rad=float(sigma[k]),
            plane=(float(place.planes[k, 0]), float(place.planes[k, 1]), float(place.planes[k, 2])),
            box_px=boxes[k],
            inliers=int(inliers[k]),
            in_view=float(in_view[k] / len(pairing.rays)),
        )
        for k in separate(place, digits, arc, SEPARATION * step_rad, CANDIDATES)
    )


def _digits_above_chance(inliers: int, corners: int, chance: float, tried: int) -> float:
    """-log10 of how often chance gives as many inliers in one search (a contrario; Desolneux, Moisan & Morel 2000)."""
    p = min(max(chance, 1e-6), 1.0 - 1e-6)
    terms = [
        math.lgamma(corners + 1)
        - math.lgamma(j + 1)
        - math.lgamma(corners - j + 1)
        + j * math.log(p)
        + (corners - j) * math.log1p(-p)
        for j in range(inliers, corners + 1)
    ]
    largest = max(terms)
    tail = largest + math.log(sum(math.exp(term - largest) for term in terms))
    return -(tail + math.log(tried)) / math.log(10.0)
