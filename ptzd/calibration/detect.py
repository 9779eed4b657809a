"""Finding a board in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.calibration.target import Target, TargetKind
from ptzd.calibration.views import BoardView, Status
from ptzd.errors import CalibrationError
from ptzd.geometry.types import Array

Grey = NDArray[np.uint8]

EDGE_PX = 3.0
"""Points nearer to the border have no whole neighbourhood to be measured in."""
MIN_CHARUCO = 8
"""ChArUco boards may be seen in part; fewer corners do not count as a view."""
WINDOW_SHARE = 0.9
"""Half a window about a ChArUco corner, in distances from the corner to the nearest marker: only squares are in it."""
_SUBPIX = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
_CLASSIC = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
_SECTOR = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
_LONGEST_PX = 1600
"""Larger pictures are searched at this size first and measured at their own."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """What a picture holds: a view, or why not."""

    status: Status
    reason: str = ""
    view: BoardView | None = None


def detect(grey: Grey, target: Target, name: str) -> Detection:
    """Look for the board.

    Parameters
    ----------
    grey : Grey
        The picture ``(h, w)`` uint8.
    target : Target
        What to look for.
    name : str
        Of the picture, for the verdict.
    """
    found = _best(grey, target)
    if found is None:
        if target.kind is TargetKind.CHARUCO and _best(cv2.flip(grey, 1).astype(np.uint8), target) is not None:
            return Detection(status=Status.MIRRORED, reason="the board is readable only mirrored; switch mirroring off")
        return Detection(status=Status.NOT_FOUND, reason=f"no board of {target.columns}×{target.rows} points")
    points, pixels, read, remark = found
    height, width = grey.shape
    rim = np.minimum(pixels, np.array([width - 1, height - 1]) - pixels).min()
    if rim < EDGE_PX:
        return Detection(status=Status.EDGE, reason=f"a point is {max(rim, 0.0):.1f} px from the picture's border")
    view = BoardView(name=name, points_m=points, pixels=pixels, about_m=read.about_m(), remark=remark)
    return Detection(status=Status.USED, view=view)


def _best(grey: Grey, target: Target) -> tuple[Array, Array, Target, str] | None:
    """Points, pixels, the board as it was read and what to tell of that: the literal reading when it is found."""
    for read, remark in target.readings():
        found = _found(grey, read)
        if found is not None:
            return *found, read, remark
    return None


def _found(grey: Grey, target: Target) -> tuple[Array, Array] | None:
    if target.kind is TargetKind.CHARUCO:
        return _charuco(grey, target)
    size = target.columns, target.rows
    pixels = _chessboard(grey, size) if target.kind is TargetKind.CHESSBOARD else _circles(grey, target)
    return None if pixels is None else (target.points_m(), pixels.reshape(-1, 2).astype(np.float64))


def _chessboard(grey: Grey, size: tuple[int, int]) -> NDArray[np.float32] | None:
    """The quick detector at the search size, then the one by sectors; corners refined at the picture's own size."""
    share = min(1.0, _LONGEST_PX / max(grey.shape))
    small = grey if share == 1.0 else cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    found, corners = cv2.findChessboardCorners(small, size, flags=_CLASSIC)
    if not found:
        found, corners = cv2.findChessboardCornersSB(small, size, flags=_SECTOR)
    if not found:
        even = cv2.createCLAHE(clipLimit=3.0, tileGridSize=(8, 8)).apply(small)
        found, corners = cv2.findChessboardCorners(even, size, flags=_CLASSIC)
    if not found:
        return None
    corners = (np.asarray(corners, np.float32).reshape(-1, 2) + 0.5) / np.float32(share) - 0.5
    return _refined(grey, corners.astype(np.float32), size)


def _refined(grey: Grey, corners: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Corners at the saddle points; each window stays inside the squares that meet there."""
    grid = corners.reshape(size[1], size[0], 2)
    return _saddles(grey, corners, 0.4 * _spacing(grid).ravel())


def _spacing(grid: NDArray[np.float32]) -> Array:
    """Distance ``(rows, columns)`` of every corner ``(rows, columns, 2)`` to its nearest neighbour; nan are missing."""
    near = np.full(grid.shape[:2], np.inf)
    across = np.nan_to_num(np.linalg.norm(np.diff(grid, axis=1), axis=2), nan=np.inf)
    down = np.nan_to_num(np.linalg.norm(np.diff(grid, axis=0), axis=2), nan=np.inf)
    near[:, :-1], near[:, 1:] = np.minimum(near[:, :-1], across), np.minimum(near[:, 1:], across)
    near[:-1], near[1:] = np.minimum(near[:-1], down), np.minimum(near[1:], down)
    return near


def _saddles(grey: Grey, corners: NDArray[np.float32], half_px: Array) -> NDArray[np.float32]:
    """Corners ``(n, 2)`` refined in windows of half sides ``(n,)``; what leaves its window stays where it was."""
    half = np.clip(half_px, 2, 0.012 * max(grey.shape) + 2).astype(int)
    refined = corners.copy()
    for side in np.unique(half).tolist():
        chosen = np.flatnonzero(half == side)
        block = np.ascontiguousarray(corners[chosen]).reshape(-1, 1, 2)
        refined[chosen] = cv2.cornerSubPix(grey, block, (side, side), (-1, -1), _SUBPIX).reshape(-1, 2)
    moved = np.linalg.norm(refined - corners, axis=1) > half
    refined[moved] = corners[moved]
    return refined


def _circles(grey: Grey, target: Target) -> NDArray[np.float32] | None:
    size = target.columns, target.rows
    parameters = cv2.SimpleBlobDetector_Params()  # type: ignore[attr-defined]
    parameters.minArea, parameters.maxArea = 12.0, float(grey.size) / 40.0
    parameters.minDistBetweenBlobs = 4.0
    parameters.filterByConvexity, parameters.minConvexity = True, 0.85
    parameters.filterByInertia, parameters.minInertiaRatio = True, 0.05
    asymmetric = target.kind is TargetKind.CIRCLES
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for colour in (0, 255):
        parameters.filterByColor, parameters.blobColor = True, colour
        detector = cv2.SimpleBlobDetector_create(parameters)  # type: ignore[attr-defined]
        for more in (0, cv2.CALIB_CB_CLUSTERING):
            found, centres = cv2.findCirclesGrid(grey, size, flags=flags | more, blobDetector=detector)
            if found:
                return np.asarray(centres, np.float32)
    return None


def _charuco(grey: Grey, target: Target) -> tuple[Array, Array] | None:
    corners, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(target)).detectBoard(grey)
    if ids is None or len(ids) < MIN_CHARUCO:
        return None
    seen = np.asarray(ids).ravel()
    rows = np.unique(seen // target.columns)
    if len(rows) < 2 or len(np.unique(seen % target.columns)) < 2:
        return None
    pixels = np.asarray(corners, np.float32).reshape(-1, 2)
    grid = np.full((target.rows, target.columns, 2), np.nan, np.float32)
    grid.reshape(-1, 2)[seen] = pixels
    # The detector's own corners come from the markers about them, by some versions of OpenCV half a pixel off besides.
    near = _spacing(grid).ravel()[seen]
    near = np.minimum(near, np.median(near[np.isfinite(near)])) if np.isfinite(near).any() else np.zeros(len(seen))
    half = WINDOW_SHARE * 0.5 * (1.0 - target.marker_share) * near
    return target.points_m()[seen], _saddles(grey, pixels, half).astype(np.float64)


def charuco_board(target: Target) -> Any:  # noqa: ANN401 - a cv2 object
    """OpenCV's board of a ChArUco target; its squares are one more than the inner corners each way."""
    name = target.dictionary
    if not hasattr(cv2.aruco, name):
        raise CalibrationError(f"board: no dictionary {name!r}; give an OpenCV name such as DICT_5X5_100")
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))
    pitch = float(target.pitch_m)
    squares = target.columns + 1, target.rows + 1
    board = cv2.aruco.CharucoBoard(squares, pitch, pitch * target.marker_share, dictionary)
    board.setLegacyPattern(target.legacy)
    return board


def size_seen(grey: Grey) -> tuple[int, int] | None:
    """Inner corners (columns, rows) of whatever chessboard is in the picture, to explain why the wanted one is not."""
    found, _, meta = cv2.findChessboardCornersSBWithMeta(
        grey, (3, 3), cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    )
    if not found or meta is None:
        return None
    rows, columns = np.asarray(meta).shape[:2]
    return columns, rows
