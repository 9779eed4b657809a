"""Calibration targets: where their points are, and in which orders a detector may return them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from ptzd.errors import CalibrationError
from ptzd.geometry.types import Array

MIN_SIDE = 3
"""Fewer points along a side say nothing about a lens."""
PITCH_M = (0.001, 1.0)
"""What a square held before a lens can measure; anything else was given in another unit."""


class TargetKind(StrEnum):
    """What is printed on the board."""

    CHESSBOARD = "chessboard"
    CIRCLES = "circles"
    """Asymmetric: every other row shifted by half the distance of two circles."""
    SYMMETRIC_CIRCLES = "symmetric_circles"
    CHARUCO = "charuco"


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """A flat board.

    Points are numbered along the rows; the frame has x along the columns, y along the rows, z = 0.
    """

    kind: TargetKind = TargetKind.CHESSBOARD
    columns: int
    """Points along a row: inner corners of a chessboard or ChArUco board, circles of a row."""
    rows: int
    pitch_m: float
    """Side of a square or distance of two circles; for asymmetric circles half the distance within a row; m."""
    marker_share: float = 0.75
    """Side of a ChArUco marker in sides of a square."""
    dictionary: str = "DICT_4X4_50"
    """Markers of a ChArUco board, by OpenCV's name."""
    legacy: bool = False
    """Whether a ChArUco board begins as OpenCV before 4.6 drew it: with a marker where later boards are black."""

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < MIN_SIDE:
            raise CalibrationError(
                f"board: {self.columns}×{self.rows} points; a board has at least {MIN_SIDE} each way (count the inner "
                "corners, not the squares)"
            )
        if not self.pitch_m > 0.0:
            raise CalibrationError(f"board: a pitch of {self.pitch_m:g} m; measure a square and give its side in m")
        if not PITCH_M[0] <= self.pitch_m < PITCH_M[1]:
            raise CalibrationError(_other_unit(self.pitch_m))

    @property
    def count(self) -> int:
        """Number of points."""
        return self.columns * self.rows

    def points_m(self) -> Array:
        """Points ``(count, 3)``, m."""
        column, row = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        x = column.astype(np.float64)
        if self.kind is TargetKind.CIRCLES:
            x = 2.0 * x + row % 2
        return np.stack([x.ravel(), row.ravel().astype(np.float64), np.zeros(self.count)], axis=-1) * self.pitch_m

    def about_m(self) -> Array | None:
        """Sum ``(3,)`` of any point and its partner on the board turned by 180°, m; None when a detector can tell."""
        plain = self.kind in (TargetKind.CHESSBOARD, TargetKind.SYMMETRIC_CIRCLES)
        reversible = plain or (self.kind is TargetKind.CIRCLES and self.rows % 2 == 0)
        points = self.points_m()
        return points[0] + points[-1] if reversible else None

    def readings(self) -> tuple[tuple[Target, str], ...]:
        """Boards that the description may mean, the literal one first, each with what to tell when it is the one.

        Columns and rows are mixed up easily. A chessboard and a symmetric grid are the same board then; the others are
        not. Of ChArUco boards with an odd number of squares down, both layouts are the same.
        """
        found = [(self, "")]
        asked = f"{self.columns}×{self.rows}"
        if self.kind in (TargetKind.CIRCLES, TargetKind.CHARUCO) and self.columns != self.rows:
            swapped = replace(self, columns=self.rows, rows=self.columns)
            told = f"columns and rows are swapped: not {asked} but --board {swapped.columns}x{swapped.rows}"
            found.append((swapped, told))
        if self.kind is TargetKind.CHARUCO:
            old = "legacy layout of OpenCV before 4.6"
            found += [
                (replace(one, legacy=not one.legacy), f"{told}; {old}" if told else old)
                for one, told in found
                if one.rows % 2 == 1
            ]
        return tuple(found)


def _other_unit(pitch_m: float) -> str:
    meant = [
        f"{pitch_m * unit:g} if {name} were meant"
        for unit, name in ((1e-3, "millimetres"), (1e-2, "centimetres"))
        if PITCH_M[0] <= pitch_m * unit < PITCH_M[1]
    ]
    return (
        f"board: a pitch of {pitch_m:g} m; from {PITCH_M[0]:g} m to below {PITCH_M[1]:g} m are expected; give the side "
        f"of a square in m{': ' + ', '.join(meant) if meant else ''}"
    )


def parse_target(kind: str, size: str, pitch_m: float) -> Target:
    """Return the target of command-line words.

    Parameters
    ----------
    kind : str
        A value of `TargetKind`.
    size : str
        ``COLUMNSxROWS`` of points.
    pitch_m : float
        As in `Target`.

    Raises
    ------
    CalibrationError
        When the words are no board.
    """
    parts = size.lower().replace("×", "x").split("x")
    if len(parts) != 2 or not all(part.strip().isdigit() for part in parts):
        raise CalibrationError(f"board: {size!r}; give COLUMNSxROWS of inner corners or circles, e.g. 9x6")
    return Target(kind=TargetKind(kind), columns=int(parts[0]), rows=int(parts[1]), pitch_m=pitch_m)
