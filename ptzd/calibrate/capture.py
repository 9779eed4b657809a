"""Pictures for a calibration without a board: the camera is driven around, every picture kept with its angles."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from ptzd.calibrate.parts import Say, Shot
from ptzd.errors import CalibrationError, DeviceLost
from ptzd.jpeg.pixels import decode_grey
from ptzd.model import HeadLimits, HeadReading, ViewRef
from ptzd.ports import Clock, FrameSource, MoveStalled, Picture, PtzHead

ZOOMS = (1, 170, 420, 800, 1350, 2200, 3500, 5500, 9999)
"""Evenly spread in the focal length of a lens whose magnification grows evenly, 1 to 32 times."""
WIDE_DEG, TELE_SHARE = 60.0, 32.0
"""Field of view at zoom 1 and magnification at zoom 9999 that steps are chosen for; half as much or twice will do."""
AROUND_DEG = 84.0
"""Of home: a fisheye sees 90° to either side, and what lies at its very rim serves little."""
LOWEST_DEG, HIGHEST_DEG = -65.0, 75.0
FISHEYE = "fisheye.png"
FRAMES = 16
"""Of the fisheye, averaged."""
PAUSE_S = 0.2
PICTURE_S = 30.0
ATTEMPTS = 3


def wide_plan(limits: HeadLimits, pan_deg: tuple[float, float]) -> list[HeadReading]:
    """Where to look at the widest zoom: across a range of pan, as far up and down as the head goes.

    What lies high and low tells R from the lens: without it both err together, along the arcs.

    Raises
    ------
    CalibrationError
        When the head reaches less than half of the range.
    """
    low, high = pan_deg
    if not limits.endless_pan:
        low, high = max(limits.pan_deg[0], low), min(limits.pan_deg[1], high)
    if high - low < 0.5 * (pan_deg[1] - pan_deg[0]):
        raise CalibrationError(
            f"--pan {pan_deg[0]:g},{pan_deg[1]:g}: the head reaches {limits.pan_deg[0]:g}° to {limits.pan_deg[1]:g}°; "
            "give the pans at which it looks into the fisheye's field of view"
        )
    tilt_low, tilt_high = _tilts(limits)
    tilts = np.linspace(tilt_low, tilt_high, max(2, math.ceil((tilt_high - tilt_low) / 22.0) + 1))
    return [
        HeadReading(pan_deg=math.remainder(pan, 360.0), tilt_deg=float(tilt), zoom=1.0)
        for pan in np.linspace(low, high, 7)
        for tilt in tilts
    ]


def tele_plan(limits: HeadLimits, zooms: Sequence[float], middle: tuple[float, float]) -> list[HeadReading]:
    """A cross of six at every longer zoom, around a pan and tilt in deg."""
    tilt_low, tilt_high = _tilts(limits)
    readings = []
    for zoom in (zoom for zoom in zooms if 1 < zoom <= limits.zoom[1]):
        width = WIDE_DEG / (1.0 + (zoom - 1.0) / 9998.0 * (TELE_SHARE - 1.0))
        for across, up in ((0, 0), (0.35, 0), (-0.35, 0), (0, 0.28), (0, -0.28), (0.3, 0.25)):
            pan, tilt = middle[0] + across * width, float(np.clip(middle[1] + up * width, tilt_low, tilt_high))
            if not limits.endless_pan:
                pan = float(np.clip(pan, *limits.pan_deg))
            readings.append(HeadReading(pan_deg=math.remainder(pan, 360.0), tilt_deg=tilt, zoom=float(zoom)))
    return readings


def _tilts(limits: HeadLimits) -> tuple[float, float]:
    return max(limits.tilt_deg[0], LOWEST_DEG), min(limits.tilt_deg[1], HIGHEST_DEG)


def texture(grey: NDArray[np.uint8]) -> int:
    """How many corners the middle third of a picture holds: a tele picture there has some of them at every zoom."""
    height, width = grey.shape
    middle = grey[height // 3 : -height // 3, width // 3 : -width // 3]
    corners = cv2.goodFeaturesToTrack(middle, maxCorners=400, qualityLevel=0.05, minDistance=5)
    return 0 if corners is None else len(corners)


async def fisheye_mean(source: FrameSource, work: Path) -> None:
    """Keep the mean of some pictures of a fisheye as `FISHEYE` in a folder."""
    frames = await pictures_in_a_row(source)
    await asyncio.to_thread(write_mean, work / FISHEYE, [frame.jpeg for frame in frames])


async def drive(
    head: PtzHead,
    clock: Clock,
    work: Path,
    zooms: Sequence[float],
    say: Say,
    *,
    pan_deg: tuple[float, float],
    tele_deg: tuple[float, float] | None = None,
) -> Path:
    """Drive the camera around and keep every picture with the angles it was taken at.

    Parameters
    ----------
    head, clock
        An open head, and the clock of its pictures.
    work : Path
        Where the pictures go; the fisheye's lies there.
    zooms : sequence of float
        Of the tele pictures, zoom units.
    say : callable
        Told of every picture.
    pan_deg : (float, float)
        Pans at which the head looks into the fisheye's field of view.
    tele_deg : (float, float), optional
        Pan and tilt of the tele pictures; without it where the wide ones show most texture.

    Returns
    -------
    Path
        The list of pictures.
    """
    shots: list[Shot] = []
    limits = await head.describe()
    wide = wide_plan(limits, pan_deg)
    count = len(wide) + len(tele_plan(limits, zooms, (0.0, 0.0)))

    async def take(wanted: HeadReading) -> Picture:
        picture, view = await _shot(head, wanted, clock)
        name, reading = f"ptz_{len(shots) + 1:03}.jpg", view.reading
        (work / name).write_bytes(picture.jpeg)
        zoom = float(round(reading.zoom))
        shots.append(Shot(image=name, pan_deg=reading.pan_deg, tilt_deg=reading.tilt_deg, zoom=zoom, fisheye=FISHEYE))
        say(f"[{len(shots)}/{count}] pan {reading.pan_deg:.2f}°, tilt {reading.tilt_deg:.2f}°, zoom {zoom:g}")
        return picture

    richest = (-1, 0.0, 0.0)
    for wanted in wide:
        picture = await take(wanted)
        richest = max(richest, (texture(decode_grey(picture.jpeg)), wanted.pan_deg, wanted.tilt_deg))
    if tele_deg is None:
        say(f"tele pictures at pan {richest[1]:.1f}°, tilt {richest[2]:.1f}°, where most texture is ({richest[0]})")
    for wanted in tele_plan(limits, zooms, tele_deg or richest[1:]):
        await take(wanted)
    return write_shots(work / "shots.json", shots)


async def pictures_in_a_row(source: FrameSource) -> list[Picture]:
    """Return `FRAMES` pictures of a source that may need a moment to get going.

    Raises
    ------
    DeviceLost
        When there were none in a row within half a minute.
    """
    lost: DeviceLost | None = None
    try:
        async with asyncio.timeout(PICTURE_S):
            while True:
                stream = source.pictures()
                try:
                    return [await anext(stream) for _ in range(FRAMES)]
                except DeviceLost as error:
                    lost = error
                    await asyncio.sleep(PAUSE_S)
    except TimeoutError:
        raise DeviceLost(
            f"fisheye: no {FRAMES} pictures in a row within {PICTURE_S:g} s ({lost}); check cable or address"
        ) from None


def write_mean(path: Path, jpegs: Sequence[bytes]) -> None:
    """Write the grey mean of pictures of a scene at rest, without loss: the noise of one would be the features'.

    Raises
    ------
    DeviceGarbled
        A picture cannot be decoded.
    OSError
        The file cannot be written.
    """
    total = sum(decode_grey(jpeg).astype(np.float64) for jpeg in jpegs)
    mean = np.rint(total / len(jpegs)).astype(np.uint8)
    path.write_bytes(cv2.imencode(".png", mean)[1].tobytes())


async def _shot(head: PtzHead, wanted: HeadReading, clock: Clock) -> tuple[Picture, ViewRef]:
    """Move, rest, take a picture; a camera that goes away is given time to come back."""
    for attempt in range(ATTEMPTS):
        try:
            await head.move(wanted)
            return await head.grab(clock.now_ns())
        except (DeviceLost, MoveStalled) as error:
            if attempt + 1 == ATTEMPTS:
                raise DeviceLost(f"ptz: {error}; pictures so far are kept, start again when it answers") from None
            await head.describe()
    raise DeviceLost("ptz: no attempt was made")


def write_shots(path: Path, shots: Sequence[Shot]) -> Path:
    """Write a list of PTZ pictures."""
    path.write_bytes(msgspec.json.format(msgspec.json.encode(shots), indent=1))
    return path
