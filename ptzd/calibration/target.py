"""Calibration targets: where their points are, and in which orders a detector may return them."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ptzd.errors import CalibrationError
from ptzd.geometry.types import Array

MIN_SIDE = 3
"""Fewer points along a side say nothing about a lens."""


class TargetKind(StrEnum):
    """What is printed on the board."""

    CHESSBOARD = "chessboard"
    CIRCLES = "circles"
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
    """Side of a square; for asymmetric circles half the distance of two circles of one row; m."""
    marker_share: float = 0.75
    """Side of a ChArUco marker in sides of a square."""
    dictionary: str = "DICT_4X4_50"
    """Markers of a ChArUco board, by OpenCV's name."""

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < MIN_SIDE:
            raise CalibrationError(
                f"board: {self.columns}×{self.rows} points; a board has at least {MIN_SIDE} each way (count the inner "
                "corners, not the squares)"
            )
        if not self.pitch_m > 0.0:
            raise CalibrationError(f"board: a pitch of {self.pitch_m:g} m; measure a square and give its side in m")

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
        reversible = self.kind is TargetKind.CHESSBOARD or (self.kind is TargetKind.CIRCLES and self.rows % 2 == 0)
        points = self.points_m()
        return points[0] + points[-1] if reversible else None


def parse_target(kind: str, size: str, pitch_m: float) -> Target:
    """Return the target of command-line words.

    Parameters
    ----------
    kind : str
        ``chessboard``, ``circles`` or ``charuco``.
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
