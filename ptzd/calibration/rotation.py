"""The PTZ without a board: it turns and zooms about one point, and the scene's features tell lens and head.

Every match of two pictures is a direction of its own; shared are the head's five numbers and, at every zoom, focal
length, principal point and two coefficients of distortion. All zooms are one bundle, so that a long lens, whose
pictures alone would leave focal length and principal point open, is tied to the head that the wide ones measure.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ptzd.calibration.bundle import Problem, Solution, solve
from ptzd.calibration.features import Features, match_turned
from ptzd.calibration.lens import PERSPECTIVE
from ptzd.calibration.turning import ALL_SIGNS, NEUTRAL, PRIOR_SIGMA, Signs, head_derivatives, head_rotations
from ptzd.calibration.views import rms
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import normalise
from ptzd.geometry.types import Array
from ptzd.geometry.zoom import ZoomEntry
from ptzd.model import HeadReading

Ints = NDArray[np.int64]
LENS_SIZE = 5
"""f cx cy k1 k2 per zoom."""
MIN_MATCHES = 40
MAX_TURN_RAD = math.radians(75.0)
"""Pictures further apart share nothing."""
MATCHES_PER_PAIR = 60
MATCHES_PER_ZOOM = 150
MATCHES_WIDEST = 1200
"""The widest zoom measures the head and stands for the rig; at the others more change nothing that could be seen."""
STRAY_PX = 3.0
SCALES_PX = (20.0, 5.0, 1.5)
"""Residuals that count in full, stage by stage: pictures are bent by many pixels before the lens is known."""
_PRIOR_PX = 0.3
"""What a residual is about: priors weigh like one match."""
_HEAD = len(NEUTRAL)


@dataclass(frozen=True, slots=True, kw_only=True)
class TurnedPicture:
    """One picture at rest."""

    name: str
    reading: HeadReading
    features: Features


@dataclass(frozen=True, slots=True, kw_only=True)
class Matches:
    """All matches: picture and pixel on both sides."""

    first: Ints
    second: Ints
    first_px: Array
    second_px: Array

    def only(self, rows: Ints) -> Matches:
        """Some of them."""
        return Matches(
            first=self.first[rows],
            second=self.second[rows],
            first_px=self.first_px[rows],
            second_px=self.second_px[rows],
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TurningFit:
    """Lens over zoom and head, and how well they are known."""

    signs: Signs
    head: Array
    """Numbers of `ptzd.calibration.turning`."""
    entries: tuple[ZoomEntry, ...]
    covariance: Array
    """Of the head's numbers, then five per zoom."""
    rms_px: float
    zoom_rms_px: tuple[float, ...]
    focal_sigma: tuple[float, ...]
    """Relative, per zoom."""
    counts: tuple[int, ...]
    """Matches per zoom that took part."""
    matches: Matches
    residuals: Array
    """``(2 m, 2)``: first and second picture of every match."""


def collect(pictures: Sequence[TurnedPicture], progress: Callable[[str], None] = lambda text: None) -> Matches:
    """Match all pictures that may overlap: of one zoom, and of neighbouring zooms."""
    zooms = sorted({picture.reading.zoom for picture in pictures})
    level = [zooms.index(picture.reading.zoom) for picture in pictures]
    parts: list[tuple[int, int, Array, Array]] = []
    for i, j in itertools.combinations(range(len(pictures)), 2):
        one, other = pictures[i], pictures[j]
        if abs(level[i] - level[j]) > 1 or _turn_rad(one.reading, other.reading) > MAX_TURN_RAD:
            continue
        pairs = match_turned(one.features, other.features)
        if len(pairs) > MATCHES_PER_PAIR:
            pairs = pairs[np.linspace(0, len(pairs) - 1, MATCHES_PER_PAIR).astype(int)]
        if len(pairs):
            parts.append((i, j, one.features.pixels[pairs[:, 0]], other.features.pixels[pairs[:, 1]]))
            progress(f"{one.name} and {other.name}: {len(pairs)} matches")
    if not parts:
        raise CalibrationError(
            "pictures: no two show the same part of the scene; take them with at least half of each other in view, "
            "towards a scene with texture"
        )
    return Matches(
        first=np.concatenate([np.full(len(part[2]), part[0]) for part in parts]),
        second=np.concatenate([np.full(len(part[2]), part[1]) for part in parts]),
        first_px=np.concatenate([part[2] for part in parts]),
        second_px=np.concatenate([part[3] for part in parts]),
    )


def without_poor_zooms(
    pictures: Sequence[TurnedPicture], found: Matches
) -> tuple[list[TurnedPicture], Matches, tuple[float, ...]]:
    """Leave out the zooms whose pictures share too little; returns what is left and those zooms."""
    zoom = np.array([picture.reading.zoom for picture in pictures])
    same = zoom[found.first] == zoom[found.second]
    poor = [z for z in np.unique(zoom).tolist() if (same & (zoom[found.first] == z)).sum() < MIN_MATCHES]
    keep = ~np.isin(zoom, poor)
    number = np.cumsum(keep) - 1
    rows = found.only(np.flatnonzero(keep[found.first] & keep[found.second]))
    left = Matches(
        first=number[rows.first], second=number[rows.second], first_px=rows.first_px, second_px=rows.second_px
    )
    return [picture for picture, kept in zip(pictures, keep, strict=True) if kept], left, tuple(poor)


def _turn_rad(one: HeadReading, other: HeadReading) -> float:
    pan = math.radians(abs((one.pan_deg - other.pan_deg + 180.0) % 360.0 - 180.0))
    tilt = math.radians(one.tilt_deg - other.tilt_deg)
    return math.hypot(pan * math.cos(math.radians(one.tilt_deg)), tilt)


def calibrate_turning(
    pictures: Sequence[TurnedPicture],
    size_px: tuple[int, int],
    matches: Matches | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> TurningFit:
    """Lens at every zoom and the head, from pictures of one scene with the angles that the camera reported.

    Parameters
    ----------
    pictures : sequence of TurnedPicture
        At each zoom at least three, turned by a third of the field of view both ways.
    size_px : (int, int)
        Of all pictures.
    matches : Matches, optional
        Found already; `collect` otherwise.

    Raises
    ------
    CalibrationError
        When a zoom has too few matches, or the angles and pictures contradict each other.
    """
    found = collect(pictures, progress) if matches is None else matches
    found = _thinned(found, [picture.reading.zoom for picture in pictures])
    zooms = np.array(sorted({picture.reading.zoom for picture in pictures}))
    angles = np.radians([[picture.reading.pan_deg, picture.reading.tilt_deg] for picture in pictures])
    level = np.searchsorted(zooms, [picture.reading.zoom for picture in pictures])
    _check(found, zooms, level, angles)
    signs, focals = _start(found, angles, level, len(zooms), size_px)
    progress(f"signs pan {signs.pan:+d}, tilt {signs.tilt:+d}; first focal lengths {np.round(focals).tolist()} px")
    shared = np.concatenate([NEUTRAL, *([f, (size_px[0] - 1) / 2, (size_px[1] - 1) / 2, 0.0, 0.0] for f in focals)])
    wide = found.only(np.flatnonzero((level[found.first] == 0) & (level[found.second] == 0)))
    first = slice(0, _HEAD + LENS_SIZE)
    for scale in SCALES_PX:
        shared[first] = _bundle(wide, angles, 0 * level, signs, shared[first], size_px, scale).shared
    solution = _bundle(found, angles, level, signs, shared, size_px, SCALES_PX[0])
    shared = _bundle(found, angles, level, signs, solution.shared, size_px, SCALES_PX[-1]).shared
    solution = _bundle(found, angles, level, signs, shared, size_px)
    lengths = np.linalg.norm(solution.residuals, axis=1).reshape(-1, 2).max(axis=1)
    kept = lengths < max(STRAY_PX, 5.0 * float(np.median(lengths)))
    found = found.only(np.flatnonzero(kept))
    _check(found, zooms, level, angles)
    solution = _bundle(found, angles, level, signs, solution.shared, size_px)
    return _result(solution, found, zooms, level, signs)


def _thinned(found: Matches, zooms: Sequence[float]) -> Matches:
    """At most `MATCHES_PER_ZOOM` of every combination of zooms, and `MATCHES_WIDEST` of the widest."""
    zoom = np.array(zooms)
    kinds = np.stack([zoom[found.first], zoom[found.second]], axis=-1)
    rows = []
    for kind in np.unique(kinds, axis=0):
        mine = np.flatnonzero((kinds == kind).all(axis=1))
        most = MATCHES_WIDEST if (kind == zoom.min()).all() else MATCHES_PER_ZOOM
        rows.append(mine[np.linspace(0, len(mine) - 1, min(len(mine), most)).astype(int)])
    return found.only(np.sort(np.concatenate(rows)))


def _check(found: Matches, zooms: Array, level: Ints, angles: Array) -> None:
    for index, zoom in enumerate(zooms.tolist()):
        own = (level[found.first] == index) & (level[found.second] == index)
        if own.sum() < MIN_MATCHES:
            raise CalibrationError(
                f"zoom {zoom:g}: {int(own.sum())} matches between its pictures; take more pictures there, turned by a "
                "third of the field of view, towards something with texture, or leave this zoom out"
            )
        turns = np.abs(angles[found.first[own]] - angles[found.second[own]]).max(axis=0)
        for axis, turn in zip(("pan", "tilt"), turns.tolist(), strict=True):
            if index == 0 and turn < math.radians(3.0):
                raise CalibrationError(
                    f"zoom {zoom:g}: the {axis} axis does not turn between the pictures; turn both axes"
                )


def _start(
    found: Matches, angles: Array, level: Ints, count: int, size_px: tuple[int, int]
) -> tuple[Signs, list[float]]:
    """Signs and focal lengths with the least transfer error, by trial."""
    ratios = np.geomspace(0.4, 60.0, 90)
    costs = np.empty((len(ALL_SIGNS), count, len(ratios)))
    for index in range(count):
        own = np.flatnonzero((level[found.first] == index) & (level[found.second] == index))
        own = own[np.linspace(0, len(own) - 1, min(len(own), 300)).astype(int)]
        for s, signs in enumerate(ALL_SIGNS):
            turned = head_rotations(NEUTRAL, signs, angles)
            relative = np.einsum("nji,njk->nik", turned[found.second[own]], turned[found.first[own]])
            for r, ratio in enumerate(ratios.tolist()):
                costs[s, index, r] = _transfer(found, own, relative, ratio * size_px[0], size_px)
    best = int(costs.min(axis=2).sum(axis=1).argmin())
    return ALL_SIGNS[best], [float(ratios[int(row.argmin())] * size_px[0]) for row in costs[best]]


def _transfer(found: Matches, own: Ints, relative: Array, focal: float, size_px: tuple[int, int]) -> float:
    middle = (np.array(size_px) - 1.0) / 2.0
    rays = np.column_stack([(found.first_px[own] - middle) / focal, np.ones(len(own))])
    carried = np.einsum("nij,nj->ni", relative, rays)
    depth = np.where(carried[:, 2] > 1e-3, carried[:, 2], 1e-3)
    error = np.linalg.norm(carried[:, :2] / depth[:, None] * focal + middle - found.second_px[own], axis=1)
    return float(np.minimum(error / (0.05 * size_px[0]), 1.0).mean())


def _bundle(
    found: Matches,
    angles: Array,
    level: Ints,
    signs: Signs,
    start: Array,
    size_px: tuple[int, int],
    scale: float | None = None,
) -> Solution:
    count = len(found.first)
    picture = np.stack([found.first, found.second], axis=1).ravel()
    pixels = np.stack([found.first_px, found.second_px], axis=1).reshape(-1, 2)
    zoom = level[picture]
    zooms = int(level.max()) + 1
    base = _directions(start, signs, angles, found, level)
    helper = np.where(np.abs(base[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    across = normalise(np.cross(base, helper))
    frame = np.stack([across, np.cross(base, across)], axis=-1)

    def linearise(shared: Array, local: Array) -> tuple[Array, Array, Array]:
        directions = base + np.einsum("nij,nj->ni", frame, local)
        turned = head_rotations(shared[:_HEAD], signs, angles)
        by_head = head_derivatives(shared[:_HEAD], signs, angles)
        points = np.repeat(directions, 2, axis=0)
        in_camera = np.einsum("nji,nj->ni", turned[picture], points)
        residuals, by_shared = np.empty((2 * count, 2)), np.zeros((2 * count, 2, len(shared)))
        by_point = np.empty((2 * count, 2, 3))
        for index in range(zooms):
            rows = np.flatnonzero(zoom == index)
            first = _HEAD + LENS_SIZE * index
            values = _full(shared[first : first + LENS_SIZE])
            predicted, by_lens, by_point[rows] = PERSPECTIVE.project(values, in_camera[rows])
            residuals[rows] = predicted - pixels[rows]
            by_shared[rows, :, first] = by_lens[:, :, 0] + by_lens[:, :, 1]
            by_shared[rows, :, first + 1 : first + LENS_SIZE] = by_lens[:, :, 2:6]
        moved = np.einsum("knji,nj->kni", by_head[:, picture], points)
        by_shared[:, :, :_HEAD] = np.einsum("nij,knj->nik", by_point, moved)
        by_local = np.matmul(by_point, np.matmul(turned[picture].transpose(0, 2, 1), np.repeat(frame, 2, axis=0)))
        return residuals, by_shared, by_local

    middle = [(size_px[0] - 1) / 2, (size_px[1] - 1) / 2]
    mean = np.concatenate([NEUTRAL, *([0.0, *middle, 0.0, 0.0] for _ in range(zooms))])
    loose = [math.inf, 0.03 * size_px[0], 0.03 * size_px[0], 0.3, 0.3]
    sigma = np.concatenate([PRIOR_SIGMA, *(loose for _ in range(zooms))]) / _PRIOR_PX
    bundle = Problem(
        linearise=linearise,
        group=np.repeat(np.arange(count), 2),
        free=np.ones(len(start), bool),
        loss="cauchy",
        scale=scale,
        steps=25,
        tolerance=1e-6 if scale is None else 1e-5,
        prior_mean=mean,
        prior_sigma=sigma,
    )
    return solve(bundle, start, np.zeros((count, 2)))


def _full(values: Array) -> Array:
    f, cx, cy, k1, k2 = values
    return np.array([f, f, cx, cy, k1, k2, 0.0, 0.0, 0.0])


def _directions(start: Array, signs: Signs, angles: Array, found: Matches, level: Ints) -> Array:
    """Directions of the matches in the head's frame as the first picture tells."""
    lens = start[_HEAD:].reshape(-1, LENS_SIZE)[level[found.first]]
    rays = np.column_stack([(found.first_px - lens[:, 1:3]) / lens[:, :1], np.ones(len(lens))])
    turned = head_rotations(start[:_HEAD], signs, angles)[found.first]
    return normalise(np.einsum("nij,nj->ni", turned, rays))


def _result(solution: Solution, found: Matches, zooms: Array, level: Ints, signs: Signs) -> TurningFit:
    lens = solution.shared[_HEAD:].reshape(-1, LENS_SIZE)
    residuals = solution.residuals.reshape(-1, 2, 2)
    owner = level[found.first]
    entries = tuple(
        ZoomEntry(
            zoom=float(zoom), fx=float(row[0]), fy=float(row[0]), cx=float(row[1]), cy=float(row[2]),
            distortion=(float(row[3]), float(row[4]), 0.0, 0.0, 0.0),
        )
        for zoom, row in zip(zooms.tolist(), lens, strict=True)
    )  # fmt: skip
    sigma = np.sqrt(np.diag(solution.covariance))[_HEAD::LENS_SIZE] / lens[:, 0]
    if any(one.fx >= other.fx for one, other in itertools.pairwise(entries)):
        listed = ", ".join(f"{entry.zoom:g}: {entry.fx:.0f} px" for entry in entries)
        raise CalibrationError(
            f"zoom: the focal length does not grow with the zoom ({listed}); take the pictures again"
        )
    total = rms(solution.residuals)
    if total > STRAY_PX:
        raise CalibrationError(
            f"pictures: matches and angles agree only to {total:.1f} px; check that the angles belong to the pictures "
            "and that the head was at rest"
        )
    return TurningFit(
        signs=signs,
        head=solution.shared[:_HEAD],
        entries=entries,
        covariance=solution.covariance,
        rms_px=total,
        zoom_rms_px=tuple(rms(residuals[owner == index].reshape(-1, 2)) for index in range(len(zooms))),
        focal_sigma=tuple(sigma.tolist()),
        counts=tuple(int((owner == index).sum()) for index in range(len(zooms))),
        matches=found,
        residuals=solution.residuals,
    )
