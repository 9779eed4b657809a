"""Poses of the head as cells of pan and tilt: which are taken, whether a rectangle is free, ways over free ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from ptzd.control.planning.span import Span
from ptzd.geometry.head import HeadModel
from ptzd.geometry.sphere import rotation_from_rotvec
from ptzd.geometry.types import Array, Mask
from ptzd.model import HeadLimits, HeadReading

CELL_DEG = 0.5
"""Side of a cell, in degrees of the camera's own angles."""
Cell = tuple[int, int]
"""Row of tilt, from the lower limit up, and column of pan."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """All poses, also those past the head's limits; a cell holds the number of whoever takes it, -1 = free."""

    limits: HeadLimits
    """Of the grid, as by `everywhere`."""
    within: Mask
    """Cells whose middle the head may be sent to, as far as its own limits go."""
    owner: NDArray[np.int16]
    _sums: NDArray[np.int64] = field(init=False, repr=False)
    """How many taken cells lie before each row and column, columns twice round for endless heads."""

    def __post_init__(self) -> None:
        taken = self.owner >= 0
        wide = np.concatenate([taken, taken], axis=1) if self.limits.endless_pan else taken
        sums = np.zeros((wide.shape[0] + 1, wide.shape[1] + 1), dtype=np.int64)
        sums[1:, 1:] = wide.cumsum(axis=0).cumsum(axis=1)
        object.__setattr__(self, "_sums", sums)

    def owner_at(self, pan_deg: Array, tilt_deg: Array) -> NDArray[np.int16]:
        """Who takes the cells of these poses, arrays of one shape; poses past a limit count as the nearest within."""
        return np.asarray(self.owner[cells_of(self.limits, pan_deg, tilt_deg)])

    def free(self, span: Span) -> bool:
        """Whether no pose of a rectangle, cut to the grid, lies in a taken cell."""
        low, high, left, right = self._bounds(span)
        sums = self._sums
        count = sums[high + 1, right + 1] - sums[low, right + 1] - sums[high + 1, left] + sums[low, left]
        return int(count) == 0

    def owners(self, span: Span) -> list[int]:
        """Who takes cells of a rectangle, cut to the grid, in their order."""
        low, high, left, right = self._bounds(span)
        columns = np.arange(left, right + 1) % self.owner.shape[1]
        found = np.unique(self.owner[low : high + 1][:, columns])
        return [int(number) for number in found if number >= 0]

    def _bounds(self, span: Span) -> tuple[int, int, int, int]:
        """First and last row and column of a rectangle; columns of an endless head may count on beyond the last."""
        rows, columns = self.owner.shape
        low, high = (min(max(self._row(tilt), 0), rows - 1) for tilt in span.tilt_deg)
        left, right = (math.floor((pan - _pan_from_deg(self.limits)) / CELL_DEG) for pan in span.pan_deg)
        if self.limits.endless_pan:
            right -= left - left % columns
            left %= columns
            if right - left >= columns:
                left, right = 0, columns - 1
        else:
            left, right = min(max(left, 0), columns - 1), min(max(right, 0), columns - 1)
        return low, high, left, right

    def border(self) -> list[Cell]:
        """Free cells beside taken ones: whoever must leave a taken cell by the shortest way ends in one of them."""
        free, taken = (self.owner < 0) & self.within, self.owner >= 0
        cells = np.argwhere(free & _spread(taken, wraps=self.limits.endless_pan))
        return [(int(row), int(column)) for row, column in cells]

    def pose(self, cell: Cell, zoom: float) -> HeadReading:
        """The middle of a cell."""
        pan_deg = _pan_from_deg(self.limits) + (cell[1] + 0.5) * CELL_DEG
        return HeadReading(pan_deg=pan_deg, tilt_deg=self.limits.tilt_deg[0] + (cell[0] + 0.5) * CELL_DEG, zoom=zoom)

    def walk(self, start: HeadReading, end: HeadReading) -> list[Cell] | None:
        """Return a way of fewest cells over free ones within, both ends included; None when there is none."""
        free, ends = (self.owner < 0) & self.within, (self._cell(start), self._cell(end))
        for cell in ends:  # the middle of a cell at a limit may be past it
            free[cell] = self.owner[cell] < 0
        return walk(free, *ends, wraps=self.limits.endless_pan)

    def _row(self, tilt_deg: float) -> int:
        return math.floor((tilt_deg - self.limits.tilt_deg[0]) / CELL_DEG)

    def _cell(self, reading: HeadReading) -> Cell:
        row, column = cells_of(self.limits, np.array(reading.pan_deg), np.array(reading.tilt_deg))
        return int(row), int(column)


def _pan_from_deg(limits: HeadLimits) -> float:
    return -180.0 if limits.endless_pan else limits.pan_deg[0]


def everywhere(limits: HeadLimits) -> HeadLimits:
    """Limits that hold every pose: a head may have been moved past its own by others."""
    (left, right), (low, high) = limits.pan_deg, limits.tilt_deg
    pans = (min(left, -180.0), max(right, 180.0))
    return replace(limits, pan_deg=pans, tilt_deg=(min(low, -90.0), max(high, 90.0)))


def within(limits: HeadLimits, extent: HeadLimits) -> Mask:
    """Which cells of a grid of an extent have their middles within limits, ``(rows, columns)``."""
    rows, columns = shape_of(extent)
    pan_deg = _pan_from_deg(extent) + (np.arange(columns) + 0.5) * CELL_DEG
    tilt_deg = extent.tilt_deg[0] + (np.arange(rows) + 0.5) * CELL_DEG
    pans = (pan_deg >= limits.pan_deg[0]) & (pan_deg <= limits.pan_deg[1]) | limits.endless_pan
    tilts = (tilt_deg >= limits.tilt_deg[0]) & (tilt_deg <= limits.tilt_deg[1])
    return np.asarray(tilts[:, None] & pans[None])


def shape_of(limits: HeadLimits) -> Cell:
    """How many rows and columns the limits have."""
    pans_deg = 360.0 if limits.endless_pan else limits.pan_deg[1] - limits.pan_deg[0]
    tilts_deg = limits.tilt_deg[1] - limits.tilt_deg[0]
    return max(math.ceil(tilts_deg / CELL_DEG), 1), max(math.ceil(pans_deg / CELL_DEG), 1)


def cells_of(limits: HeadLimits, pan_deg: Array, tilt_deg: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of poses, arrays of one shape; poses past a limit count as the nearest within."""
    rows, columns = shape_of(limits)
    column = np.floor((np.asarray(pan_deg) - _pan_from_deg(limits)) / CELL_DEG).astype(np.intp)
    column = column % columns if limits.endless_pan else np.clip(column, 0, columns - 1)
    row = np.floor((np.asarray(tilt_deg) - limits.tilt_deg[0]) / CELL_DEG).astype(np.intp)
    return np.clip(row, 0, rows - 1), column


def cell_axes(head: HeadModel, limits: HeadLimits) -> Array:
    """Return the optical axes ``(rows, columns, 3)`` in the head frame at the middles of all cells."""
    rows, columns = shape_of(limits)
    pan_deg = _pan_from_deg(limits) + (np.arange(columns) + 0.5) * CELL_DEG
    tilt_deg = limits.tilt_deg[0] + (np.arange(rows) + 0.5) * CELL_DEG
    return axes_at(head, *np.meshgrid(pan_deg, tilt_deg))


def axes_at(head: HeadModel, pan_deg: Array, tilt_deg: Array) -> Array:
    """Return the optical axes ``(..., 3)`` in the head frame at many of the camera's angles."""
    pan, tilt = head.pan.angle_rad(np.asarray(pan_deg)), head.tilt.angle_rad(np.asarray(tilt_deg))
    x, y, z = rotation_from_rotvec(head.camera_rotvec_rad)[:, 2]
    down, ahead = np.cos(tilt) * y - np.sin(tilt) * z, np.sin(tilt) * y + np.cos(tilt) * z
    return np.stack([np.cos(pan) * x + np.sin(pan) * ahead, down, np.cos(pan) * ahead - np.sin(pan) * x], axis=-1)


def _spread(cells: Mask, *, wraps: bool) -> Mask:
    """Cells beside these, to the four sides."""
    spread = np.zeros_like(cells)
    spread[1:] |= cells[:-1]
    spread[:-1] |= cells[1:]
    spread[:, 1:] |= cells[:, :-1]
    spread[:, :-1] |= cells[:, 1:]
    if wraps:
        spread[:, 0] |= cells[:, -1]
        spread[:, -1] |= cells[:, 0]
    return spread


def walk(free: Mask, start: Cell, end: Cell, *, wraps: bool) -> list[Cell] | None:
    """Return a shortest way over free cells from ``start`` to ``end``, both included; None without one.

    ``wraps``: the last column borders on the first.
    """
    if not (free[start] and free[end]):
        return None
    # a frame of taken cells, so that no step needs a look whether it leaves the grid; a seam is a step of its own
    columns = free.shape[1]
    width = columns + 2
    framed = np.pad(free, 1).ravel()
    before = np.where(framed, -1, 0)
    first, last = ((row + 1) * width + column + 1 for row, column in (start, end))
    before[first] = first
    front = np.array([first])
    while before[last] < 0 and front.size:
        found = []
        for step, seam in ((1, columns), (-1, 1), (width, 0), (-width, 0)):
            to = front + step
            if wraps and seam:
                to = to - np.where(front % width == seam, step * columns, 0)
            new = before[to] < 0
            before[to[new]] = front[new]
            found.append(to[new])
        front = np.concatenate(found)
    if before[last] < 0:
        return None
    cells = [last]
    while cells[-1] != first:
        cells.append(int(before[cells[-1]]))
    return [(index // width - 1, index % width - 1) for index in reversed(cells)]
