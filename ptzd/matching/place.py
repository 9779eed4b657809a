"""Places under search, and what both matchers ask of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Floats, Index, Mask
from ptzd.matching.budget import refuse_beyond_budget
from ptzd.matching.hypotheses import bearings, sample_inverse_ranges, sample_offsets, warps

if TYPE_CHECKING:
    from ptzd.geometry.arc import EpipolarArc
    from ptzd.geometry.types import Array
    from ptzd.matching.inputs import MatchInputs
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import WorkingView


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where k candidates are."""

    planes: Array
    """(k, 3) N of the paper's equation (6)."""
    offset: Array
    """(k,) across the arc, rad."""
    roll: Array
    """(k,) about the line of sight, rad: the part of a wrong rotation that is neither along nor across."""

    def warps(self, arc: EpipolarArc) -> Array:
        """Return the maps (k, 3, 3) from pre-rotated fisheye rays to head-frame directions."""
        return warps(arc, self.planes, self.offset, self.roll)

    def bearings(self, arc: EpipolarArc) -> Array:
        """Return the head-frame directions (k, 3) of the box's centre."""
        return bearings(arc, self.planes, self.offset)

    def take(self, index: Index | slice) -> Place:
        """Return some of the candidates."""
        return Place(planes=self.planes[index], offset=self.offset[index], roll=self.roll[index])

    def join(self, other: Place) -> Place:
        """Return these candidates and then the others."""
        return Place(
            planes=np.concatenate([self.planes, other.planes]),
            offset=np.concatenate([self.offset, other.offset]),
            roll=np.concatenate([self.roll, other.roll]),
        )


BLOCK_SAMPLES = 1 << 21
"""Looked up at a time: a table of them takes 8 MB, and a common match is a single block."""


def in_blocks(evaluate: Callable[[slice], Floats], count: int, samples: int) -> Floats:
    """Evaluate many hypotheses a block at a time, so that the memory does not grow with their number.

    Parameters
    ----------
    evaluate : callable
        Values of the hypotheses in a slice, one row (or number) each.
    count : int
        Number of hypotheses.
    samples : int
        Places of the picture that each of them looks up.
    """
    each = max(BLOCK_SAMPLES // max(samples, 1), 1)
    blocks = [evaluate(slice(start, start + each)) for start in range(0, max(count, 1), each)]
    return blocks[0] if len(blocks) == 1 else np.concatenate(blocks)


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Hypotheses along and across the arc, those whose centre is in the view."""

    place: Place
    """Facing the fisheye, no roll."""
    shape: tuple[int, int]
    """Number of inverse ranges and of offsets of the whole grid."""
    cell: Index
    """(k,) index of each hypothesis in the whole grid, flat."""
    coverage: tuple[float, float]
    """Interval of inverse range in view; (0, 0) when none."""


def make_grid(
    inputs: MatchInputs, arc: EpipolarArc, patch: Patch, view: WorkingView, step_rad: float, samples: int
) -> Grid:
    """Lay hypotheses so densely that neighbours differ by less than a step at the centre and the corners.

    Parameters
    ----------
    inputs : MatchInputs
        Interval, band and budget.
    arc : EpipolarArc
        Of the box's centre.
    patch, view
        The region, and the picture that the hypotheses must lie in.
    step_rad : float
        Greatest angle between neighbours.
    samples : int
        Places of the view that each hypothesis will look up.

    Raises
    ------
    MatchError
        When that is more work than the budget allows.
    """
    rows, columns = patch.shape
    corners = patch.rays.reshape(rows, columns, 3)[[0, 0, -1, -1], [0, -1, 0, -1]].astype(np.float64)
    probes = np.vstack([arc.rotated, corners])
    ranges = sample_inverse_ranges(probes, arc.translation, inputs.inverse_range, step_rad)
    offsets = sample_offsets(inputs.band_rad, step_rad)
    refuse_beyond_budget(len(ranges) * len(offsets), samples, inputs.budget_s)
    inverse_range, offset = (part.ravel() for part in np.meshgrid(ranges, offsets, indexing="ij"))
    place = Place(planes=inverse_range[:, None] * arc.rotated, offset=offset, roll=np.zeros_like(offset))
    cell = np.flatnonzero(_centre_in_view(view, place.bearings(arc)))
    seen = inverse_range[cell]
    coverage = (float(seen.min()), float(seen.max())) if len(cell) else (0.0, 0.0)
    return Grid(place=place.take(cell), shape=(len(ranges), len(offsets)), cell=cell, coverage=coverage)


def peaks(grid: Grid, scores: Floats, arc: EpipolarArc, distance_rad: float, most: int) -> Index:
    """Return the hypotheses that are local maxima and further apart than a distance, best first.

    Parameters
    ----------
    grid : Grid
        With k hypotheses.
    scores : float (k,)
        -inf leaves a hypothesis out.
    arc : EpipolarArc
        Of the box's centre.
    distance_rad : float
        Least angle between two.
    most : int
        Greatest number returned.
    """
    table = np.full(grid.shape[0] * grid.shape[1], -np.inf)
    table[grid.cell] = scores
    table = table.reshape(grid.shape)
    padded = np.pad(table, 1, constant_values=-np.inf)
    rows, columns = grid.shape
    around = np.stack([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)])
    top = (table >= around.max(axis=0)) & np.isfinite(table)
    candidates = np.flatnonzero(top.ravel()[grid.cell])
    chosen = separate(grid.place.take(candidates), scores[candidates], arc, distance_rad, most)
    return candidates[chosen]


def separate(place: Place, scores: Floats, arc: EpipolarArc, distance_rad: float, most: int) -> Index:
    """Return the best candidates that lie further apart than a distance, best first.

    On a degenerate arc (the box's centre at the epipole) every range has the same direction: there it is one place.
    """
    directions = place.bearings(arc)
    taken = np.zeros(len(directions), bool)
    chosen: list[int] = []
    for index in np.argsort(-scores, kind="stable"):
        if not taken[index]:
            chosen.append(int(index))
            # One row at a time: a picture without corners has thousands of equal maxima, too many for all pairs.
            taken |= directions @ directions[index] >= 1.0 - 0.5 * distance_rad * distance_rad
        if len(chosen) == most:
            break
    return np.array(chosen, dtype=np.intp)


def box_in_view(
    inputs: MatchInputs, corners: Array, place: Place, arc: EpipolarArc
) -> list[tuple[tuple[float, float], ...]]:
    """Return the box's corners, rays (4, 3) of the fisheye, through each candidate's homography, px of the view."""
    rig = inputs.rig
    rotated = corners @ rig.head_from_fisheye_rotation.T
    pixels, _ = rig.project_to_view(rotated @ place.warps(arc).transpose(0, 2, 1), inputs.reading)
    return [tuple((x, y) for x, y in four) for four in pixels.tolist()]


def _centre_in_view(view: WorkingView, directions: Array) -> Mask:
    homogeneous = directions @ view.pixels_from_head.T
    in_front = homogeneous[:, 2] > 1e-6
    pixels = homogeneous[:, :2] / np.where(in_front, homogeneous[:, 2], 1.0)[:, None]
    size = np.array(view.image.shape[::-1])
    return np.asarray(in_front & (pixels >= -0.5).all(axis=1) & (pixels <= size - 0.5).all(axis=1))
