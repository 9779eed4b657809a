"""When to take a picture of a board held before a lens, where to hold it next, and when it is enough. Pure."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ptzd.geometry.types import Array, Mask

CELLS = 5
"""The picture is covered in so many columns and rows."""
LIT_GREY = 16
LIT_SHARE = 0.5
"""A cell belongs to the field when so much of it is brighter: a fisheye's corners are black."""
STILL_S = 0.5
STILL_SHARE = 0.004
"""A board stands when its points stay within so much of the picture's width for `STILL_S`."""
NEW_SHARE = 0.05
"""A picture adds something when its points lie so much of the width away from those of every other one."""


class Action(StrEnum):
    """What a picture is to the guide."""

    NO_BOARD = "no board"
    MOVING = "moving"
    KNOWN = "adds nothing"
    TAKE = "take"
    ENOUGH = "enough"


@dataclass(frozen=True, slots=True, kw_only=True)
class Goal:
    """When it is enough."""

    pictures: int = 16
    covered: float = 0.9
    """Share of the field's cells that hold a point of some board."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to do now."""

    action: Action
    text: str
    covered: float
    taken: int


def lit_cells(grey: NDArray[np.uint8]) -> Mask:
    """Cells ``(CELLS, CELLS)`` by row and column that belong to the field of a picture ``(h, w)``."""
    rows = np.array_split(grey > LIT_GREY, CELLS, axis=0)
    return np.array([[part.mean() > LIT_SHARE for part in np.array_split(row, CELLS, axis=1)] for row in rows])


class Guide:
    """Sees every picture's board and says what to do.

    Parameters
    ----------
    size_px : (int, int)
        Of the pictures.
    field : Mask
        Cells ``(CELLS, CELLS)`` that can be covered, from `lit_cells`.
    goal : Goal
        When it is enough.
    """

    def __init__(self, size_px: tuple[int, int], field: Mask, goal: Goal | None = None) -> None:
        self._size = np.array(size_px, float)
        self._field, self._goal = field, goal or Goal()
        self._covered = np.zeros((CELLS, CELLS), bool)
        self._kept: list[Array] = []
        self._recent: deque[tuple[float, Array]] = deque()

    @property
    def covered(self) -> float:
        """Share of the field that boards were in."""
        return float((self._covered & self._field).sum() / max(int(self._field.sum()), 1))

    @property
    def enough(self) -> bool:
        """Whether the goal is reached."""
        return len(self._kept) >= self._goal.pictures and self.covered >= self._goal.covered

    def keep(self, pixels: Array) -> None:
        """Count a picture's board ``(n, 2)`` as taken, e.g. one of an earlier run."""
        self._kept.append(pixels)
        self._covered |= self._cells(pixels)

    def look(self, t_s: float, pixels: Array | None) -> Advice:
        """Judge a picture: its time, s, and the board's points ``(n, 2)``, px, or None; on ``TAKE`` it is counted."""
        if self.enough:
            return self._advice(Action.ENOUGH, "enough")
        if pixels is None:
            self._recent.clear()
            return self._advice(Action.NO_BOARD, f"no board seen; hold it {self.wanted()}")
        if not self._still(t_s, pixels):
            return self._advice(Action.MOVING, f"hold it still, {self.wanted()}")
        new_cells = self._cells(pixels) & self._field & ~self._covered
        near = self._nearest(pixels)
        if near < NEW_SHARE or (not new_cells.any() and len(self._kept) >= self._goal.pictures):
            return self._advice(Action.KNOWN, f"seen already; hold it {self.wanted()}, tilted another way")
        self.keep(pixels)
        self._recent.clear()
        return self._advice(Action.TAKE, "taken; " + ("enough" if self.enough else f"next {self.wanted()}"))

    def wanted(self) -> str:
        """Where the board should go next, for a person: the largest part of the field without any."""
        missing = self._field & ~self._covered
        if not missing.any():
            return "anywhere, tilted another way"
        thirds = np.minimum(np.arange(CELLS) * 3 // CELLS, 2)
        counts = np.zeros((3, 3), int)
        np.add.at(counts, (thirds[:, None], thirds[None, :]), missing)
        row, column = np.unravel_index(int(counts.argmax()), counts.shape)
        up, side = ("upper", "middle", "lower")[int(row)], ("left", "middle", "right")[int(column)]
        where = "middle" if up == side else f"{up} {side}"
        return f"in the {where} of the picture"

    def _advice(self, action: Action, text: str) -> Advice:
        return Advice(action=action, text=text, covered=self.covered, taken=len(self._kept))

    def _still(self, t_s: float, pixels: Array) -> bool:
        if self._recent and self._recent[-1][1].shape != pixels.shape:
            self._recent.clear()
        self._recent.append((t_s, pixels))
        while len(self._recent) > 1 and t_s - self._recent[1][0] >= STILL_S:
            self._recent.popleft()
        moved = max(float(np.abs(pixels - other).max()) for _, other in self._recent)
        return t_s - self._recent[0][0] >= STILL_S and moved <= STILL_SHARE * float(self._size[0])

    def _cells(self, pixels: Array) -> Mask:
        cells = np.zeros((CELLS, CELLS), bool)
        column, row = np.clip((pixels + 0.5) / self._size * CELLS, 0, CELLS - 1).astype(int).T
        cells[row, column] = True
        return cells

    def _nearest(self, pixels: Array) -> float:
        """Least difference from a kept board, in shares of the picture's width, whichever way its points run."""
        others = [other for other in self._kept if other.shape == pixels.shape]
        gaps = [min(float(np.abs(way - pixels).max()) for way in (other, other[::-1])) for other in others]
        return min(gaps, default=np.inf) / float(self._size[0])
