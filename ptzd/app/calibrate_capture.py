"""Pictures for a calibration without a board: the camera is driven around, every picture kept with its angles."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import msgspec
import numpy as np

from ptzd.app.calibrating import Say, Shot
from ptzd.app.daemon import open_fisheye
from ptzd.app.loading import load_config
from ptzd.config import Config, HttpSource
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceLost
from ptzd.jpeg.pixels import decode_grey
from ptzd.model import HeadLimits, HeadReading, ViewRef
from ptzd.ports import FrameSource, MoveStalled, Picture
from ptzd.runtime.clock import SteadyClock

ZOOMS = (1, 170, 420, 800, 1350, 2200, 3500, 5500, 9999)
"""Evenly spread in the focal length of a lens whose magnification grows evenly, 1 to 32 times."""
WIDE_DEG, TELE_SHARE = 60.0, 32.0
"""Field of view at zoom 1 and magnification at zoom 9999 that steps are chosen for; half as much or twice will do."""
FISHEYE = "fisheye.png"
FRAMES = 16
"""Of the fisheye, averaged."""
PAUSE_S = 0.2
PICTURE_S = 30.0
ATTEMPTS = 3


def settings(path: Path) -> Config:
    """Settings with the password files found from where the settings are."""
    config = load_config(path)
    ptz, fisheye = config.ptz, config.fisheye
    if ptz.password_file is not None:
        ptz = msgspec.structs.replace(ptz, password_file=str(path.parent / ptz.password_file))
    if isinstance(fisheye, HttpSource) and fisheye.password_file is not None:
        fisheye = msgspec.structs.replace(fisheye, password_file=str(path.parent / fisheye.password_file))
    return msgspec.structs.replace(config, ptz=ptz, fisheye=fisheye)


def plan(
    limits: HeadLimits, zooms: Sequence[float] = ZOOMS, centre: tuple[float, float] | None = None
) -> list[HeadReading]:
    """Where to look: all around at the widest zoom, as far up and down as the head goes, and a cross of six at longer.

    What lies high and low tells R from the lens: without it both err together, along the arcs.
    """
    tilt_low, tilt_high = max(limits.tilt_deg[0], -65.0), min(limits.tilt_deg[1], 75.0)
    pan_low, pan_high = max(limits.pan_deg[0], -84.0), min(limits.pan_deg[1], 84.0)
    tilts = np.linspace(tilt_low, tilt_high, max(2, math.ceil((tilt_high - tilt_low) / 22.0) + 1))
    readings = [
        HeadReading(pan_deg=float(pan), tilt_deg=float(tilt), zoom=1.0)
        for pan in np.linspace(pan_low, pan_high, 7)
        for tilt in tilts
    ]
    middle = centre or (10.0, float(np.clip(-8.0, tilt_low, tilt_high)))
    for zoom in (zoom for zoom in zooms if 1 < zoom <= limits.zoom[1]):
        width = WIDE_DEG / (1.0 + (zoom - 1.0) / 9998.0 * (TELE_SHARE - 1.0))
        for across, up in ((0, 0), (0.35, 0), (-0.35, 0), (0, 0.28), (0, -0.28), (0.3, 0.25)):
            pan, tilt = middle[0] + across * width, float(np.clip(middle[1] + up * width, tilt_low, tilt_high))
            readings.append(HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=float(zoom)))
    return readings


async def capture(config_path: Path, work: Path, zooms: Sequence[float], say: Say) -> Path:
    """Drive the camera through the plan and keep every picture with the angles it was taken at.

    Returns
    -------
    Path
        The list of pictures; the fisheye's picture lies beside it.
    """
    config, clock = settings(config_path), SteadyClock()
    await asyncio.to_thread(work.mkdir, parents=True, exist_ok=True)
    async with open_fisheye(config.fisheye, clock) as source:
        frames = await pictures_in_a_row(source)
    await asyncio.to_thread(write_mean, work / FISHEYE, [frame.jpeg for frame in frames])
    shots = []
    async with VapixHead(config.ptz, config.limits, clock) as head:
        readings = plan(await head.describe(), zooms)
        for number, wanted in enumerate(readings, 1):
            picture, view = await _shot(head, wanted, clock)
            name = f"ptz_{number:03}.jpg"
            (work / name).write_bytes(picture.jpeg)
            shots.append(
                Shot(
                    image=name,
                    pan_deg=view.reading.pan_deg,
                    tilt_deg=view.reading.tilt_deg,
                    zoom=float(round(view.reading.zoom)),
                    fisheye=FISHEYE,
                )
            )
            say(
                f"[{number}/{len(readings)}] pan {view.reading.pan_deg:.2f}°, tilt {view.reading.tilt_deg:.2f}°, "
                f"zoom {view.reading.zoom:g}"
            )
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


async def _shot(head: VapixHead, wanted: HeadReading, clock: SteadyClock) -> tuple[Picture, ViewRef]:
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
