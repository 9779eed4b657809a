"""What happens to pictures: noise, light, things in front, things that are not there, things that are there twice."""

from __future__ import annotations

import cv2
import numpy as np

from ptzd.geometry.rig import Rig
from ptzd.model import Box, HeadReading

Grey = np.ndarray
"""(h, w) float64, grey levels in [0, 255]."""


def with_noise(picture: Grey, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """Add a sensor's noise and round to bytes."""
    if sigma > 0:
        picture = picture + np.float32(sigma) * rng.standard_normal(picture.shape, np.float32)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def mild_light(picture: Grey, rng: np.random.Generator) -> Grey:
    """Gain 0.8, gamma 1.4, a ramp of ±30 % in a random direction."""
    return _light(picture, rng, 0.8, 1.4, 0.3)


def strong_light(picture: Grey, rng: np.random.Generator) -> Grey:
    """Gain 0.6, gamma 2.2, a ramp of ±60 %."""
    return _light(picture, rng, 0.6, 2.2, 0.6)


def bright_light(picture: Grey, rng: np.random.Generator) -> Grey:
    """Overexposed: gain 1.8, gamma 0.6, everything above three eighths of full scale is burnt out."""
    return _light(picture, rng, 1.8, 0.6, 0.2)


def reversed_contrast(picture: Grey, rng: np.random.Generator) -> Grey:
    """As between a thermal and an ordinary camera at best: dark is bright."""
    return 255.0 - 0.8 * picture


def _light(picture: Grey, rng: np.random.Generator, gain: float, gamma: float, ramp: float) -> Grey:
    height, width = picture.shape
    angle = rng.uniform(0, 2 * np.pi)
    x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    shade = 1.0 + ramp * (np.cos(angle) * x + np.sin(angle) * y) / np.sqrt(2.0)
    return np.clip(255.0 * gain * shade * (np.clip(picture, 0, 255) / 255.0) ** gamma, 0, 255)


def footprint(
    rig: Rig, reading: HeadReading, box: Box, inverse_range: float
) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of the region in a view, px; nothing when it is not wholly before the camera."""
    corners, seen = rig.fisheye.lift(np.array(box.corners))
    moved = corners @ rig.head_from_fisheye_rotation.T + inverse_range * rig.head_from_fisheye_translation
    pixels, valid = rig.project_to_view(moved, reading)
    if not (valid.all() and seen.all()):
        return None
    return (*pixels.min(axis=0).tolist(), *pixels.max(axis=0).tolist())


def occluded(picture: Grey, area: tuple[float, float, float, float], share: float, rng: np.random.Generator) -> Grey:
    """Cover one side of an area with another piece of the same picture, at another place for every side."""
    left, top, right, bottom = area
    wide, high = right - left, bottom - top
    side = rng.integers(4)
    if side < 2:
        wide *= share
        left = left if side == 0 else right - wide
    else:
        high *= share
        top = top if side == 2 else bottom - high
    height, width = picture.shape
    x0, x1 = (int(v) for v in np.clip(np.round([left, left + wide]), 0, width))
    y0, y1 = (int(v) for v in np.clip(np.round([top, top + high]), 0, height))
    shift = (int(rng.integers(60, height - 60)), int(rng.integers(80, width - 80)))
    out = picture.copy()
    out[y0:y1, x0:x1] = np.roll(picture, shift, (0, 1))[y0:y1, x0:x1]
    return out


def pasted(fisheye: Grey, box: Box, other: Box) -> Grey:
    """Show what another box shows in place of what is in the box, with a rim."""
    x, y, w, h = (round(v) for v in (other.x, other.y, other.w, other.h))
    piece = fisheye[max(y, 0) : y + h, max(x, 0) : x + w]
    rows, columns = _rimmed(fisheye, box)
    out = fisheye.copy()
    size = (columns.stop - columns.start, rows.stop - rows.start)
    out[rows, columns] = cv2.resize(piece, size, interpolation=cv2.INTER_LINEAR)
    return out


def blank(fisheye: Grey, box: Box) -> Grey:
    """Nothing but the mean grey in the box and its rim."""
    rows, columns = _rimmed(fisheye, box)
    out = fisheye.copy()
    out[rows, columns] = fisheye[rows, columns].mean()
    return out


def _rimmed(fisheye: Grey, box: Box, rim: int = 3) -> tuple[slice, slice]:
    height, width = fisheye.shape
    rows = slice(max(round(box.y) - rim, 0), min(round(box.y + box.h) + rim, height))
    return rows, slice(max(round(box.x) - rim, 0), min(round(box.x + box.w) + rim, width))


def doubled(picture: Grey, rig: Rig, reading: HeadReading, box: Box, here: float, there: float) -> Grey | None:
    """Show the region a second time, exactly as it would look at another inverse range.

    Nothing when either place is not wholly in the picture or the two overlap.
    """
    one, other = (footprint(rig, reading, box, s) for s in (here, there))
    height, width = picture.shape
    if one is None or other is None or not all(inside(area, width, height) for area in (one, other)):
        return None
    if one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]:
        return None
    left, top, right, bottom = round(other[0]), round(other[1]), round(other[2]), round(other[3])
    pixels = np.stack(np.meshgrid(np.arange(left, right), np.arange(top, bottom)), axis=-1)
    seen = rig.lift_from_view(pixels, reading)
    shift = rig.head_from_fisheye_translation
    along = seen @ (there * shift)
    reach = along + np.sqrt(np.maximum(along**2 + 1.0 - there**2 * (shift @ shift), 0.0))
    source, _ = rig.project_to_view(seen * reach[..., None] + (here - there) * shift, reading)
    x, y = np.moveaxis(source.astype(np.float32), -1, 0)
    out = picture.copy()
    out[top:bottom, left:right] = cv2.remap(picture.astype(np.float32), x, y, cv2.INTER_LINEAR)
    return out


def inside(area: tuple[float, float, float, float], width: int, height: int) -> bool:
    """Whether an area lies in a picture, with a rim for interpolation."""
    return min(area[0], area[1], width - area[2], height - area[3]) > 8.0
