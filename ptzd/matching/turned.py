"""Two pictures of the PTZ against its reported poses: they agree, nothing moved, or its zero is elsewhere.

The earlier picture is turned into where the later one was taken, once by the reported poses and once as if pan and tilt
had not moved, and both are compared block by block. Only blocks with structure count, and a verdict needs many of them:
dark or empty pictures, a thing that passes by and a caption on the picture lead to none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ptzd.geometry.rig import Rig
from ptzd.matching.arrays import Floats, Grey, Mask
from ptzd.model import HeadReading, Turn, Turned

WIDTH_PX = 320
"""Of the pictures that are compared: a slip that matters is many of these pixels."""
STEP_PX = 16
"""Between the nodes for which the lens is computed; between them it is straight to a tenth of a pixel."""
FAR_PX = 1e5
SMOOTHING_PX = 1.0
COARSE_PX = 12.0
"""What is wider is light, not structure."""
GRID = (8, 6)
"""Blocks across and down."""
STRUCTURE = 2.5
"""Standard deviation of a block's structure, grey levels, in both pictures: several times the noise that is left."""
LIKE = 0.6
"""Correlation from which a block shows the same."""
MOST, HALF, FEW = 0.8, 0.5, 0.25
"""Shares of the blocks that show the same: from the first a contradiction counts, from the second an agreement does,
and up to the last there is none."""
BLOCKS, WITNESSES = 10, 14
"""Blocks with structure that an agreement needs, and a contradiction."""
NOTICED_PX = 4.0
"""A smaller turn or slip cannot be told from a trembling mast."""
LEAST_DEG = 0.3
"""Nor a smaller angle: heads come back to a tenth of a degree, and a mast sways in the wind."""
OVERLAP = 0.3
"""Of the picture that both must show for a slip to be measured."""
ROUNDS = 3
WIDEST = 3.0
"""Ratio of the fields of view up to which pictures are compared: beyond, one is too blurred for the other."""


@dataclass(frozen=True, slots=True)
class _Agreement:
    blocks: int
    share: float


def compare(rig: Rig, before: Grey, at: HeadReading, after: Grey, then: HeadReading) -> Turned:
    """Compare two pictures taken at rest.

    Parameters
    ----------
    rig : Rig
        Says what a pose shows.
    before, after : uint8 (h, w)
        The pictures.
    at, then : HeadReading
        Where the head was reported.

    Returns
    -------
    Turned
        ``UNKNOWN`` wherever the pictures do not decide it.
    """
    nothing = Turned(verdict=Turn.UNKNOWN, before=at, after=then)
    low, high = rig.zoom.zoom_range
    if not low <= min(at.zoom, then.zoom) <= max(at.zoom, then.zoom) <= high:
        return nothing
    wide, narrow = _Look.of(rig, before, at), _Look.of(rig, after, then)
    if swapped := wide.hfov_rad < narrow.hfov_rad:
        wide, narrow = narrow, wide
    if wide.hfov_rad > WIDEST * narrow.hfov_rad:
        return nothing
    nothing = replace(nothing, turned=_noticed(_turn_rad(rig, at, then), narrow))
    said = _agreement(rig, wide, narrow, narrow.reading)
    if said.blocks >= BLOCKS and said.share > FEW:
        # a share between both is a scene that changed: it speaks for nothing
        return replace(nothing, verdict=Turn.AGREES, share=said.share) if said.share >= HALF else nothing
    if nothing.turned:
        still = _agreement(rig, wide, narrow, replace(wide.reading, zoom=narrow.reading.zoom))
        if still.blocks >= WITNESSES and still.share >= MOST:
            return replace(nothing, verdict=Turn.UNMOVED, share=still.share)
    slip = _slip(rig, wide, narrow)
    if slip is None:
        return nothing
    pan_deg, tilt_deg, share = slip
    sign = -1.0 if swapped else 1.0
    return replace(nothing, verdict=Turn.SLIPPED, share=share, pan_off_deg=sign * pan_deg, tilt_off_deg=sign * tilt_deg)


@dataclass(frozen=True, slots=True)
class _Look:
    """A picture at working size, and where it was taken."""

    picture: Floats
    reading: HeadReading
    scale: float
    """Working pixels per pixel of the camera."""
    hfov_rad: float

    @classmethod
    def of(cls, rig: Rig, picture: Grey, reading: HeadReading) -> _Look:
        scale = WIDTH_PX / picture.shape[1]
        size = (WIDTH_PX, round(picture.shape[0] * scale))
        small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.float32)
        return cls(small, reading, scale, rig.zoom.camera_at(reading.zoom).hfov_rad)


def _slip(rig: Rig, wide: _Look, narrow: _Look) -> tuple[float, float, float] | None:
    """By how much the narrow picture looks elsewhere than it should: pan, tilt in degrees and the share of like blocks.

    None when it does not show what the wide one does. The shift between both is a first guess of the slip; the wide
    picture is turned by that and the rest is guessed.
    """
    hfov_deg, then = math.degrees(narrow.hfov_rad), narrow.reading
    looks = then
    for _ in range(ROUNDS):
        turned, shown, seen = _seen_from(rig, wide, narrow, looks)
        if seen.mean() < OVERLAP:
            return None
        dx, dy = _shift_px(turned, shown, seen)
        # what lies further right in the later picture lies there because the head looks further left
        pan_deg = -dx / WIDTH_PX * hfov_deg / max(math.cos(math.radians(looks.tilt_deg)), 0.2)
        tilt_deg = dy / WIDTH_PX * hfov_deg
        looks = replace(looks, pan_deg=looks.pan_deg + pan_deg, tilt_deg=looks.tilt_deg + tilt_deg)
    found = _agreement(rig, wide, narrow, looks)
    if found.blocks < WITNESSES or found.share < MOST or not _noticed(_turn_rad(rig, then, looks), narrow):
        return None
    return looks.pan_deg - then.pan_deg, looks.tilt_deg - then.tilt_deg, found.share


def _shift_px(one: Floats, other: Floats, seen: Mask) -> tuple[float, float]:
    """How much further right and down the other one shows the same, by phase correlation of what both show."""
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    common = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    masked = one[common] * seen[common], other[common] * seen[common]
    window = cv2.createHanningWindow((masked[0].shape[1], masked[0].shape[0]), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(*masked, window)
    return dx, dy


def _seen_from(rig: Rig, wide: _Look, narrow: _Look, looks: HeadReading) -> tuple[Floats, Floats, Mask]:
    """Structure of the wide picture as seen from a pose, of the narrow one equally blurred, and where both are."""
    height, width = narrow.picture.shape
    columns, rows = (np.arange(0, side + STEP_PX, STEP_PX) for side in (width, height))
    nodes = (np.stack(np.meshgrid(columns, rows), axis=-1) + 0.5) / narrow.scale - 0.5
    rays, lifted = rig.zoom.camera_at(looks.zoom).lift(nodes)
    pixels, valid = rig.project_to_view(rays @ rig.head_from_camera(looks).T, wide.reading)
    far = np.where((lifted & valid)[..., None], (pixels + 0.5) * wide.scale - 0.5, -FAR_PX).astype(np.float32)
    x, y = np.meshgrid(*(np.arange(side, dtype=np.float32) / STEP_PX for side in (width, height)))
    where = np.asarray(cv2.remap(far, x, y, cv2.INTER_LINEAR), dtype=np.float32)
    limit = (wide.picture.shape[1] - 1, wide.picture.shape[0] - 1)
    inside = np.asarray(((where >= 0) & (where <= limit)).all(axis=-1), dtype=np.bool_)
    turned = cv2.remap(
        wide.picture, where[..., 0].copy(), where[..., 1].copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    enlarged = wide.hfov_rad / narrow.hfov_rad
    return _structure(turned, SMOOTHING_PX), _structure(narrow.picture, SMOOTHING_PX * enlarged), inside


def _structure(picture: cv2.typing.MatLike, smoothing_px: float) -> Floats:
    fine = cv2.GaussianBlur(picture, (0, 0), smoothing_px)
    return np.asarray(fine - cv2.GaussianBlur(picture, (0, 0), COARSE_PX), dtype=np.float32)


def _agreement(rig: Rig, wide: _Look, narrow: _Look, looks: HeadReading) -> _Agreement:
    """Blocks that have structure in both pictures, if the narrow one looks there, and the share that shows the same."""
    one, other, seen = _seen_from(rig, wide, narrow, looks)
    height, width = one.shape
    across, down = GRID
    counted = like = 0
    for row in range(down):
        for column in range(across):
            block = np.s_[
                row * height // down : (row + 1) * height // down,
                column * width // across : (column + 1) * width // across,
            ]
            if not seen[block].all():
                continue
            a, b = one[block] - one[block].mean(), other[block] - other[block].mean()
            deviations = float(a.std()), float(b.std())
            if min(deviations) < STRUCTURE:
                continue
            counted += 1
            like += float((a * b).mean()) >= LIKE * deviations[0] * deviations[1]
    return _Agreement(counted, like / max(counted, 1))


def _noticed(turn_rad: float, narrow: _Look) -> bool:
    return turn_rad / narrow.hfov_rad * WIDTH_PX >= NOTICED_PX and turn_rad >= math.radians(LEAST_DEG)


def _turn_rad(rig: Rig, at: HeadReading, then: HeadReading) -> float:
    axes = (rig.head_from_camera(reading) @ np.array([0.0, 0.0, 1.0]) for reading in (at, then))
    return math.acos(min(max(float(np.dot(*axes)), -1.0), 1.0))
