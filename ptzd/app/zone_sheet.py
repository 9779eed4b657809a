"""What zones cover, for people: lines, and a picture of the fisheye beside a map of the head's poses."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.app.loading import Loaded, widest_limits
from ptzd.app.locating import DataError
from ptzd.control.activities.home import home_of
from ptzd.control.planning.grid import CELL_DEG, cell_axes, cells_of
from ptzd.control.planning.marks import taken_by
from ptzd.control.planning.zones import zones_of
from ptzd.documents import read_regular
from ptzd.errors import ConfigError, DeviceGarbled
from ptzd.geometry.outline import Outline
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array, in_picture
from ptzd.geometry.zones import Zone, along
from ptzd.jpeg.pixels import Pixels, decode_file_bgr
from ptzd.model import HeadLimits, ZoneKind
from ptzd.runtime.blackening import fisheye_mask

COLOURS = {ZoneKind.NO_GO: (60, 60, 235), ZoneKind.PRIVACY: (220, 90, 180), ZoneKind.IGNORE: (40, 180, 250)}
"""Blue, green, red."""
STEP_RAD = np.radians(0.25)
MAP_PX = 2
"""Pixels of the map to a cell of the head's poses."""
TINT = 0.45


def zone_lines(loaded: Loaded) -> list[str]:
    """One line for every zone: what it is and how much it closes."""
    limits, rig = widest_limits(loaded.config), loaded.rig
    axes = cell_axes(rig.head, limits)
    lines = []
    for zone, given in zip(zones_of(loaded.config, rig), loaded.config.zones, strict=True):
        share = 100.0 * float(taken_by(zone.head_outlines, rig.head, limits, axes).mean())
        near, far = given.range_m or loaded.config.search.range_m
        unit = "m" if rig.metric else "baselines"
        what = "refuses boxes" if zone.kind is ZoneKind.IGNORE else f"closes {share:.1f} % of the set points"
        lines.append(f"zones        {zone.name}: {zone.kind}, {what}; at range {near:g} to {far:g} {unit}")
    return lines


def read_picture(path: Path) -> Pixels:
    """Read a picture of the fisheye from a file; DataError when it cannot be read."""
    try:
        return decode_file_bgr(read_regular(path))
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from None
    except DeviceGarbled as error:
        raise DataError(f"{path}: {error}") from None


def zone_sheet(loaded: Loaded, pixels: Pixels | None) -> Pixels:
    """Return a picture ``(h, w, 3)`` BGR: zones in the fisheye's picture, and beside it in a map of the head's poses.

    Parameters
    ----------
    loaded : Loaded
        Settings and calibration.
    pixels : Pixels, optional
        A picture of the fisheye, ``(h, w, 3)`` BGR; without it the image circle alone. Privacy zones are black in it.

    Raises
    ------
    ConfigError
        There are no zones, or the picture is of another size than calibrated.
    """
    rig, zones = loaded.rig, zones_of(loaded.config, loaded.rig)
    if not zones:
        raise ConfigError("zones: there are none to draw; see config/zones.example.yaml")
    picture = _picture(rig, zones, pixels)
    limits = widest_limits(loaded.config)
    poses = _map(rig, limits, picture, zones)
    home = home_of(loaded.config)
    row, column = cells_of(limits, np.array(home.pan_deg), np.array(home.tilt_deg))
    place = (int(column) * MAP_PX, poses.shape[0] - 1 - int(row) * MAP_PX)
    cv2.drawMarker(poses, place, (255, 255, 255), cv2.MARKER_CROSS, 14, 2)
    cv2.putText(poses, "home", (place[0] + 8, place[1] - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1)
    taken: list[tuple[int, int, int, int]] = []
    for zone in zones:
        _draw(picture, rig, zone, taken)
    height = max(picture.shape[0], poses.shape[0])
    sides = [cv2.copyMakeBorder(one, 0, height - one.shape[0], 0, 8, cv2.BORDER_CONSTANT) for one in (picture, poses)]
    return np.hstack(sides).astype(np.uint8)


def _picture(rig: Rig, zones: tuple[Zone, ...], given: Pixels | None) -> Pixels:
    width, height = rig.fisheye.size_px
    if given is None:
        places = np.stack(np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float)), axis=-1)
        grey = np.where(rig.fisheye.lift(places)[1], 70, 20).astype(np.uint8)
        return np.repeat(grey[..., None], 3, axis=2)
    if given.shape[:2] != (height, width):
        size = f"{given.shape[1]}×{given.shape[0]}"
        raise ConfigError(f"the picture is {size} px, the calibration is for {width}×{height} px")
    shown = given.copy()
    private = tuple(zone for zone in zones if zone.kind is ZoneKind.PRIVACY)
    if private:
        shown[fisheye_mask(rig, private)] = 0
    return shown


def _map(rig: Rig, limits: HeadLimits, picture: Pixels, zones: tuple[Zone, ...]) -> Pixels:
    """The head's poses, pan to the right and tilt up, over what the fisheye sees there from afar."""
    axes = cell_axes(rig.head, limits)
    pixels, valid = rig.fisheye.project(axes @ rig.head_from_fisheye_rotation)
    valid &= in_picture(rig.fisheye, pixels)
    at = np.round(np.where(valid[..., None], pixels, 0.0)).astype(int)
    poses = np.where(valid[..., None], picture[at[..., 1], at[..., 0]], 30).astype(np.uint8)
    labels = []
    for zone in zones:
        if zone.kind is ZoneKind.IGNORE:
            continue
        taken = taken_by(zone.head_outlines, rig.head, limits, axes)
        tinted = (1.0 - TINT) * poses[taken] + TINT * np.array(COLOURS[zone.kind])
        poses[taken] = tinted.astype(np.uint8)
        if taken.any():
            rows, columns = np.nonzero(taken)
            labels.append((zone, int(columns.mean()), int(rows.mean())))
    shown: Pixels = np.repeat(np.repeat(poses[::-1], MAP_PX, axis=0), MAP_PX, axis=1).copy()
    for zone, column, row in labels:
        place = (max(column * MAP_PX - 20, 2), shown.shape[0] - 1 - row * MAP_PX)
        cv2.putText(shown, zone.name, place, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    _scale(shown, limits)
    return shown


def _scale(shown: Pixels, limits: HeadLimits) -> None:
    """The camera's own pan and tilt, every 30°."""
    low = -180.0 if limits.endless_pan else limits.pan_deg[0]
    for angle in range(-180, 181, 30):
        x = round((angle - low) / CELL_DEG * MAP_PX)
        y = shown.shape[0] - 1 - round((angle - limits.tilt_deg[0]) / CELL_DEG * MAP_PX)
        if 0 <= x < shown.shape[1]:
            cv2.putText(shown, f"{angle}", (x, shown.shape[0] - 4), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (200, 200, 200), 1)
        if 12 <= y < shown.shape[0] - 14:
            cv2.putText(shown, f"{angle}", (2, y), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (200, 200, 200), 1)


def _draw(picture: Pixels, rig: Rig, zone: Zone, taken: list[tuple[int, int, int, int]]) -> None:
    for outline in zone.fisheye_outlines:
        border = _in_pixels(rig, outline)
        if len(border) > 1:
            cv2.polylines(picture, [border], isClosed=False, color=COLOURS[zone.kind], thickness=2)
    border = _in_pixels(rig, zone.fisheye_outlines[0])
    if len(border):
        place = (int(border[:, 0, 0].min()), int(border[:, 0, 1].min()) - 5)
        _label(picture, f"{zone.name} ({zone.kind})", place, COLOURS[zone.kind], taken)


def _label(
    picture: Pixels,
    text: str,
    place: tuple[int, int],
    colour: tuple[int, int, int],
    taken: list[tuple[int, int, int, int]],
) -> None:
    """Write on a dark ground, inside the picture, and below what was written there before."""
    (width, height), under = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    high = height + under + 4
    x, y = max(min(place[0], picture.shape[1] - width - 2), 2), max(place[1], height + 4)
    for left, top, right, bottom in sorted(taken, key=lambda box: box[1]):
        if x < right and x + width > left and y - height - 2 < bottom and y + under + 2 > top:
            y = bottom + height + 3
    taken.append((x, y - height - 2, x + width, y - height - 2 + high))
    cv2.rectangle(picture, (x - 2, y - height - 2), (x + width + 2, y + under + 2), (20, 20, 20), cv2.FILLED)
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.5, colour, 1, cv2.LINE_AA)


def _in_pixels(rig: Rig, outline: Outline) -> NDArray[np.int32]:
    points: Array = along((outline,), STEP_RAD)
    pixels, valid = rig.fisheye.project(np.concatenate([points, points[:1]]))
    return np.round(pixels[valid]).astype(np.int32).reshape(-1, 1, 2)
