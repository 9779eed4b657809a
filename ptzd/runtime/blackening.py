"""Black where privacy zones are: which pixels of a picture show one, and the picture without them."""

from __future__ import annotations

import logging
import math
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ptzd.errors import DeviceGarbled
from ptzd.geometry.outline import Outline
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array, CameraModel, Mask
from ptzd.geometry.zones import STEP_RAD, Zone, along, covers
from ptzd.jpeg.pixels import decode_bgr, encode_jpeg
from ptzd.model import HeadReading

SPACING_RAD = math.radians(0.3)
"""Between the points that stand for a zone; every direction in it is closer than that to one."""
REST_RAD = math.radians(0.5)
"""Black beyond a zone's border at rest: the calibration's error, the pose's, a pixel's."""
ZOOM_SLACK = 8.0
"""VAPIX units that a reported zoom may be off the calibrated ones."""

_log = logging.getLogger(__name__)


class Cover:
    """Privacy zones on one sphere, asked for many directions at once.

    Parameters
    ----------
    outlines : list of tuple of Outline
        Of each zone.
    """

    def __init__(self, outlines: list[tuple[Outline, ...]]) -> None:
        lattice = _lattice()
        points = [part for zone in outlines for part in (lattice[covers(zone, lattice)], along(zone, SPACING_RAD))]
        self._tree = cKDTree(np.concatenate(points))
        # a zone that is seen from elsewhere is known at steps of range
        self._slack_rad = SPACING_RAD + (STEP_RAD / 2 if any(len(zone) > 1 for zone in outlines) else 0.0)

    def near(self, directions: Array, margin_rad: float) -> Mask:
        """Which unit directions ``(n, 3)`` are in a zone or less than a margin away from one."""
        chord = 2.0 * math.sin(min(margin_rad + self._slack_rad, math.pi) / 2.0)
        distances, _ = self._tree.query(directions, distance_upper_bound=chord)
        return np.asarray(np.isfinite(distances))


@lru_cache(maxsize=1)
def _lattice() -> Array:
    """Points all over the sphere, ``(n, 3)``, none farther than `SPACING_RAD` from its next (Fibonacci's spiral)."""
    count = math.ceil(4.0 * math.pi / (SPACING_RAD**2))
    index = np.arange(count)
    height = 1.0 - (2.0 * index + 1.0) / count
    turn = index * (math.pi * (3.0 - math.sqrt(5.0)))
    flat = np.sqrt(1.0 - height * height)
    return np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=-1)


def shown(
    camera: CameraModel, frame_from_camera: Array, cover: Cover, *, margin_rad: float, block_px: int
) -> NDArray[np.bool_]:
    """Return which pixels ``(h, w)`` show a zone, by whole blocks; those that no ray is known of where any does.

    Parameters
    ----------
    camera : CameraModel
        Whose picture.
    frame_from_camera : Array
        Rotation, shape (3, 3), to the frame of the zones.
    cover : Cover
        The zones.
    margin_rad : float
        How far beyond a zone's border counts.
    block_px : int
        Side of a block.
    """
    width, height = camera.size_px
    across, down = (np.arange(0, size + block_px, block_px) - 0.5 for size in (width, height))
    rays, valid = camera.lift(np.stack(np.meshgrid(across, down), axis=-1))
    # every pixel is within half a block's diagonal of one of its corners
    sides = np.where(valid[1:, 1:] & valid[:-1, :-1], 1.0 - (rays[1:, 1:] * rays[:-1, :-1]).sum(axis=-1), 0.0)
    half_rad = math.sqrt(2.0 * max(float(sides.max()), 0.0)) / 2.0
    directions = (rays @ frame_from_camera.T)[valid]
    corners = np.zeros(valid.shape, dtype=bool)
    corners[valid] = cover.near(directions, margin_rad + half_rad)
    if not corners.any():
        return np.zeros((height, width), dtype=bool)
    corners |= ~valid
    blocks = corners[1:, 1:] | corners[:-1, 1:] | corners[1:, :-1] | corners[:-1, :-1]
    return np.repeat(np.repeat(blocks, block_px, axis=0), block_px, axis=1)[:height, :width]


def blackened(jpeg: bytes, mask: Mask) -> bytes:
    """Return a picture without what a mask ``(h, w)`` holds; its own bytes when that is nothing.

    One that cannot be decoded, or is of another size than the mask, shows nothing at all.
    """
    if not mask.any():
        return jpeg
    try:
        pixels = decode_bgr(jpeg)
    except DeviceGarbled as error:
        _log.warning("a picture that may show a privacy zone is damaged and is left black: %s", error)
        return encode_jpeg(np.zeros((*mask.shape, 3), dtype=np.uint8))
    if pixels.shape[:2] != mask.shape:
        return encode_jpeg(np.zeros_like(pixels))
    kept = cv2.copyTo(pixels, np.logical_not(mask).view(np.uint8))
    return encode_jpeg(np.asarray(kept, dtype=np.uint8))


class HeadScreen:
    """Which pixels of the PTZ's pictures show a privacy zone.

    Parameters
    ----------
    rig : Rig
    zones : tuple of Zone
        Privacy zones only; at least one.
    """

    BLOCK_PX = 8

    def __init__(self, rig: Rig, zones: tuple[Zone, ...]) -> None:
        self._rig = rig
        self._cover = Cover([zone.head_outlines for zone in zones])

    def apart_rad(self, one: HeadReading, other: HeadReading) -> float:
        """How far anything in a picture at one pose can be from where it were at the other."""
        turn = self._rig.head_from_camera(one).T @ self._rig.head_from_camera(other)
        turned = math.acos(min(max((float(np.trace(turn)) - 1.0) / 2.0, -1.0), 1.0))
        return turned + abs(self.half_diagonal_rad(one.zoom) - self.half_diagonal_rad(other.zoom))

    def half_diagonal_rad(self, zoom: float) -> float:
        """From the middle of a picture to its corner; the widest there is for a zoom that is not calibrated."""
        low, high = self._rig.zoom.zoom_range
        camera = self._rig.zoom.camera_at(zoom if low <= zoom <= high else low)
        width, height = camera.size_px
        return math.atan(math.hypot(width / camera.fx, height / camera.fy) / 2.0)

    def may_show(self, reading: HeadReading, margin_rad: float) -> bool:
        """Whether a picture around this pose can show a zone."""
        reach = self.half_diagonal_rad(reading.zoom) * 1.1 + margin_rad
        return bool(self._cover.near(self._rig.head_from_camera(reading)[None, :, 2], reach)[0])

    def mask(self, reading: HeadReading, margin_rad: float) -> Mask:
        """Pixels ``(h, w)`` to be black in a picture taken at this pose, which is known to the margin."""
        width, height = self._rig.zoom.size_px
        if not self.may_show(reading, margin_rad):
            return np.zeros((height, width), dtype=bool)
        low, high = self._rig.zoom.zoom_range
        if not low - ZOOM_SLACK <= reading.zoom <= high + ZOOM_SLACK:
            return np.ones((height, width), dtype=bool)
        camera = self._rig.zoom.camera_at(min(max(reading.zoom, low), high))
        turn = self._rig.head_from_camera(reading)
        return shown(camera, turn, self._cover, margin_rad=margin_rad, block_px=self.BLOCK_PX)


def fisheye_mask(rig: Rig, zones: tuple[Zone, ...]) -> Mask:
    """Pixels ``(h, w)`` of the fisheye's picture that show a privacy zone."""
    cover = Cover([zone.fisheye_outlines for zone in zones])
    return shown(rig.fisheye, np.eye(3), cover, margin_rad=REST_RAD, block_px=4)
