"""Pictures out of a log, with what was asked for and found drawn into them."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.control.events import MatchFinished
from ptzd.errors import DeviceGarbled
from ptzd.evidence import arcs
from ptzd.evidence.story import Look, Story
from ptzd.geometry.rig import Rig
from ptzd.jpeg.pixels import decode_bgr
from ptzd.model import Box

Pixels = NDArray[np.uint8]
GREEN, RED, YELLOW, CYAN = (80, 255, 50), (50, 60, 255), (0, 215, 255), (255, 230, 0)
"""BGR."""
_FAR_PX = 1e5
"""Beyond it OpenCV's fixed-point drawing overflows."""
EPIPOLE = "epipole"
_FONT, _FONT_SIZE = cv2.FONT_HERSHEY_SIMPLEX, 0.5
_SHIFT = 4
"""Fractional bits of drawn coordinates."""
CROP_PX = 320
"""Longer side of an enlarged crop, px."""


def decode(jpeg: bytes) -> Pixels | None:
    """BGR pixels as stored; None when the bytes are no whole, undamaged JPEG."""
    try:
        return decode_bgr(jpeg)
    except DeviceGarbled:
        return None


def encode(pixels: Pixels) -> bytes:
    """JPEG bytes."""
    return bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 92])[1])


def fisheye(pixels: Pixels, rig: Rig, story: Story) -> Pixels:
    """The frame that the request named, with box, arc and epipole."""
    picture = pixels.copy()
    if story.box is not None:
        _polyline(picture, story.box.corners, GREEN, closed=True, thickness=2)
    arc = arcs.arc_of(rig, story.looks[0].job) if story.looks else None
    if arc is not None:
        for line in arcs.in_fisheye(rig, arc):
            _polyline(picture, line, YELLOW, thickness=2)
    epipole = arcs.epipole_in_fisheye(rig)
    if epipole is not None:
        x, y = epipole
        cv2.drawMarker(picture, (round(x), round(y)), CYAN, cv2.MARKER_TILTED_CROSS, 12, 1)
        (wide, _), _ = cv2.getTextSize(EPIPOLE, _FONT, _FONT_SIZE, 2)
        if x < picture.shape[1]:
            _text(picture, EPIPOLE, (min(x + 8, picture.shape[1] - wide), y - 8), CYAN)
    return picture


def crop(pixels: Pixels, box: Box) -> Pixels:
    """What was to be found: the box and half as much around it, enlarged without smoothing."""
    height, width = pixels.shape[:2]
    left, right = np.clip([box.x - box.w / 2, box.x + 1.5 * box.w], 0, width).round().astype(int)
    top, bottom = np.clip([box.y - box.h / 2, box.y + 1.5 * box.h], 0, height).round().astype(int)
    cut = pixels[top : max(bottom, top + 1), left : max(right, left + 1)]
    scale = CROP_PX / max(cut.shape[:2])
    large = np.asarray(cv2.resize(cut, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST), np.uint8)
    corners = [((x - left + 0.5) * scale - 0.5, (y - top + 0.5) * scale - 0.5) for x, y in box.corners]
    _polyline(large, corners, GREEN, closed=True, thickness=2)
    return large


def view(pixels: Pixels, rig: Rig, look: Look) -> Pixels:
    """A PTZ picture with the arc, the found box and its score; lesser candidates in red."""
    picture = pixels.copy()
    arc = arcs.arc_of(rig, look.job)
    if arc is not None:
        for line in arcs.in_view(rig, arc, look.job.view.reading):
            _polyline(picture, line, YELLOW, thickness=2)
    if not isinstance(look.answer, MatchFinished):
        return picture
    for rank, candidate in reversed(list(enumerate(look.answer.result.candidates))):
        shown = GREEN if rank == 0 else RED
        _polyline(picture, candidate.box_px, shown, closed=True, thickness=2 if rank == 0 else 1)
        x, y = candidate.box_px[0] if candidate.box_px else (0.0, 0.0)
        _text(picture, f"{candidate.score:.2f}", (x, y - 5), shown)
    return picture


def _polyline(
    picture: Pixels,
    points: Iterable[tuple[float, float]],
    bgr: tuple[int, int, int],
    *,
    closed: bool = False,
    thickness: int = 1,
) -> None:
    exact = np.array(list(points), np.float64).reshape(-1, 1, 2)
    if len(exact) and np.isfinite(exact).all():
        fixed = np.round(np.clip(exact, -_FAR_PX, _FAR_PX) * (1 << _SHIFT)).astype(np.int32)
        cv2.polylines(picture, [fixed], closed, bgr, thickness, cv2.LINE_AA, _SHIFT)


def _text(picture: Pixels, text: str, at: tuple[float, float], bgr: tuple[int, int, int]) -> None:
    if not np.isfinite(at).all():
        return
    x, y = (round(float(np.clip(value, -_FAR_PX, _FAR_PX))) for value in at)
    for colour, thickness in (((0, 0, 0), 2), (bgr, 1)):
        cv2.putText(picture, text, (x, y), _FONT, _FONT_SIZE, colour, thickness, cv2.LINE_AA)
