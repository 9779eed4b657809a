"""`ptzd check`: could the daemon run with these settings, and do both cameras answer."""

from __future__ import annotations

import asyncio
import math

import cv2
import numpy as np

from ptzd.app.capturing import refuse_zones
from ptzd.app.daemon import open_fisheye
from ptzd.app.loading import Loaded
from ptzd.app.zone_sheet import zone_lines
from ptzd.config import Config, HttpSource, Ptz, V4l2Source
from ptzd.control.planning.places import place_seen, reading_at
from ptzd.control.planning.reach import reach_of
from ptzd.control.planning.zones import zones_of
from ptzd.devices.v4l2_list import list_devices
from ptzd.devices.vapix.credentials import exposure
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.timing import measure_timing
from ptzd.errors import ConfigError, DeviceLost, RequestRefused
from ptzd.jpeg.pixels import decode_grey
from ptzd.jpeg.walk import read_header
from ptzd.model import HeadLimits, HeadReading, ZoneKind
from ptzd.runtime.clock import SteadyClock

MOVING_DEG_S = 30.0
"""At what speed the pose error of a picture in motion is stated."""
PICTURE_S = 15.0
"""Both streams start within seconds."""


def check_files(loaded: Loaded) -> list[str]:
    """Lines about settings and calibration; whatever is wrong was raised while loading."""
    rig = loaded.rig
    low, high = rig.zoom.zoom_range
    narrow, wide = (math.degrees(angle) for angle in rig.zoom.hfov_range_rad)
    baseline = float(np.linalg.norm(rig.head_from_fisheye_translation))
    unit = "m" if rig.metric else "(no metric scale: ranges are in baselines)"
    band = math.degrees(rig.band_rad(1.0 / loaded.config.search.range_m[0]))
    return [
        f"settings     {loaded.path}: rig {loaded.config.rig}",
        f"calibration  {loaded.config.calibration}",
        f"fisheye      {rig.fisheye.size_px[0]}×{rig.fisheye.size_px[1]} px, {type(rig.fisheye).__name__}",
        f"ptz          zoom {low:g} to {high:g}, field of view {wide:.1f}° to {narrow:.2f}°",
        f"baseline     {baseline:.3f} {unit}; search band ±{band:.2f}° at the nearest range",
        *_places(loaded),
        *zone_lines(loaded),
        *_exposed_passwords(loaded.config),
    ]


def _as_place(loaded: Loaded, reading: HeadReading) -> list[str]:
    """Where the head looks now, as ``presets.yaml`` has it."""
    low, high = loaded.rig.zoom.zoom_range
    if not low <= reading.zoom <= high:
        return []
    here = place_seen(loaded.rig, reading)
    angles = (
        f"azimuth_deg: {here.azimuth_deg:.3f}, elevation_deg: {here.elevation_deg:.3f}, hfov_deg: {here.hfov_deg:.3f}"
    )
    return [f"ptz          as a place of presets.yaml: {{{angles}}}"]


def _places(loaded: Loaded) -> list[str]:
    """Every named place, and why the head cannot look there; the camera's own limits may be narrower."""
    config, rig = loaded.config, loaded.rig
    limits = HeadLimits(pan_deg=config.limits.pan_deg, tilt_deg=config.limits.tilt_deg, zoom=config.limits.zoom)
    reach = reach_of(limits, rig, zones_of(config, rig))
    lines = []
    for name, place in config.presets.places.items():
        try:
            pose = reading_at(rig, config, reach, name, place)
        except RequestRefused as refused:
            lines.append(f"place        warning: {refused.message}")
        else:
            lines.append(
                f"place        {name}: pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}°, zoom {pose.zoom:.0f}"
            )
    return lines


def _exposed_passwords(config: Config) -> list[str]:
    files = {"ptz": config.ptz.password_file}
    if isinstance(config.fisheye, HttpSource):
        files["fisheye"] = config.fisheye.password_file
    found = ((name, exposure(path, setting=name)) for name, path in files.items())
    return [f"{name:12} warning: {warning}" for name, warning in found if warning is not None]


async def check_cameras(loaded: Loaded, *, timing: bool) -> list[str]:
    """Lines about both cameras as they answer now; with ``timing`` the head makes a few small steps.

    Raises
    ------
    DeviceError, ConfigError
        When one does not answer, or its pictures do not fit the calibration.
    """
    clock, config, rig = SteadyClock(), loaded.config, loaded.rig
    if timing:
        refuse_zones(config, ZoneKind.NO_GO)
    async with VapixHead(config.ptz, config.limits, clock) as head:
        limits = await head.describe()
        poll = await anext(head.polls())
        picture, view = await head.grab(clock.now_ns())
        warnings = head.capabilities.warnings if head.capabilities is not None else ()
        delays = await _delays(head, poll.reading, config.ptz) if timing else []
    lines = [
        *(f"ptz          warning: {warning}" for warning in warnings),
        *delays,
        f"ptz          limits pan {limits.pan_deg}, tilt {limits.tilt_deg}, zoom {limits.zoom}",
        f"ptz          now pan {poll.reading.pan_deg:.3f}°, tilt {poll.reading.tilt_deg:.3f}°, "
        f"zoom {poll.reading.zoom:g}, picture sharp? {_sharpness(picture.jpeg):.0f} (variance of the Laplacian)",
        *_as_place(loaded, poll.reading),
        _size_line("ptz", picture.jpeg, rig.zoom.size_px),
        f"ptz          pose of that picture known to {view.sigma_deg:.3f}° (one sigma)",
    ]
    return [*lines, _size_line("fisheye", await fisheye_picture(loaded), rig.fisheye.size_px)]


async def fisheye_picture(loaded: Loaded) -> bytes:
    """One picture of the fisheye as it is now; `DeviceError` when there is none."""
    async with open_fisheye(loaded.config.fisheye, SteadyClock()) as fisheye:
        try:
            first = await asyncio.wait_for(anext(aiter(fisheye.pictures())), PICTURE_S)
        except TimeoutError:
            raise DeviceLost(
                f"fisheye: no picture within {PICTURE_S:g} s; check cable, device name or address"
            ) from None
    return first.jpeg


def check_devices(loaded: Loaded) -> list[str]:
    """Lines about every camera of this machine with its formats, and those that could not be asked.

    Empty when the settings name a fisheye that is none of them.
    """
    if not isinstance(loaded.config.fisheye, V4l2Source):
        return []
    offers, failures = list_devices()
    lines = [*(line for offer in offers for line in offer.lines()), *map(str, failures)]
    return lines or ["fisheye      no video device on this machine; plug the camera in"]


async def _delays(head: VapixHead, start: HeadReading, settings: Ptz) -> list[str]:
    measured = await measure_timing(head, start)
    latency_s, offset_ms = settings.report_lag_s + measured.offset_s, 1000 * measured.offset_s
    return [
        f"ptz          pictures come {offset_ms:+.0f} ± {1000 * measured.sigma_s:.0f} ms against reports: "
        f"set ptz.image_latency_s to {latency_s:.3f} with ptz.report_lag_s {settings.report_lag_s:g}",
        f"ptz          the pose of a picture at rest does not depend on that; in motion at {MOVING_DEG_S:g}°/s it is "
        f"known to {MOVING_DEG_S * measured.sigma_s:.2f}° (one sigma)",
    ]


def _size_line(name: str, jpeg: bytes, wanted: tuple[int, int]) -> str:
    size = read_header(jpeg).size_px
    if size != wanted:
        raise ConfigError(
            f"{name}: pictures are {size[0]}×{size[1]} px, the calibration is for {wanted[0]}×{wanted[1]} px; "
            "set the size or calibrate at this one"
        )
    return f"{name:12} pictures of {size[0]}×{size[1]} px, as calibrated"


def _sharpness(jpeg: bytes) -> float:
    return float(cv2.Laplacian(decode_grey(jpeg), cv2.CV_64F).var())
