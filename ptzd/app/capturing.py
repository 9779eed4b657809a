"""`ptzd calibrate capture` and `--live`: the cameras of the settings, opened for the steps that take pictures."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from pathlib import Path

from ptzd.app.daemon import open_fisheye
from ptzd.app.loading import load_settings
from ptzd.calibrate import capture as capturing
from ptzd.calibrate import live
from ptzd.calibrate.parts import Say
from ptzd.calibration.guide import Goal
from ptzd.calibration.target import Target
from ptzd.config import Config
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import ConfigError
from ptzd.model import ZoneKind
from ptzd.runtime.clock import SteadyClock


async def capture(
    config_path: Path,
    work: Path,
    zooms: Sequence[float],
    say: Say,
    *,
    pan_deg: tuple[float, float] | None = None,
    tele_deg: tuple[float, float] | None = None,
) -> Path:
    """Take the fisheye's picture and drive the PTZ around, see :func:`ptzd.calibrate.capture.drive`.

    Without ``pan_deg`` it looks 84° to either side of home.
    """
    config, clock = load_settings(config_path), SteadyClock()
    refuse_zones(config, ZoneKind.NO_GO, ZoneKind.PRIVACY)
    await asyncio.to_thread(work.mkdir, parents=True, exist_ok=True)
    async with open_fisheye(config.fisheye, clock) as source:
        await capturing.fisheye_mean(source, work)
    home = config.home.pan_deg
    around = pan_deg or (home - capturing.AROUND_DEG, home + capturing.AROUND_DEG)
    async with VapixHead(config.ptz, config.limits, clock) as head:
        return await capturing.drive(head, clock, work, zooms, say, pan_deg=around, tele_deg=tele_deg)


async def record(config_path: Path, target: Target, folder: Path, goal: Goal, show: live.Show) -> Path:
    """Watch the configured fisheye (V4L2, HTTP or files), see :func:`ptzd.calibrate.live.record`."""
    config = load_settings(config_path)
    refuse_zones(config, ZoneKind.PRIVACY)
    await asyncio.to_thread(folder.mkdir, parents=True, exist_ok=True)
    async with open_fisheye(config.fisheye, SteadyClock()) as source:
        return await live.record(source, target, folder, goal, show)


async def record_zooms(
    config_path: Path, target: Target, work: Path, zooms: Sequence[float], goal: Goal, show: live.Show
) -> Path:
    """Drive the configured PTZ through zooms, see :func:`ptzd.calibrate.live.zoom_pictures`."""
    config, clock = load_settings(config_path), SteadyClock()
    refuse_zones(config, ZoneKind.NO_GO, ZoneKind.PRIVACY)
    async with VapixHead(config.ptz, config.limits, clock) as head:
        return await live.zoom_pictures(head, clock, target, work, zooms, goal, show)


def refuse_zones(config: Config, *kinds: ZoneKind) -> None:
    """Refuse to begin where zones would not be kept: without a calibration nobody knows where they are.

    Raises
    ------
    ConfigError
        The settings have zones of these kinds.
    """
    names = [zone.name for zone in config.zones if zone.kind in kinds]
    if names:
        raise ConfigError(
            f"zones: {', '.join(names)}: this moves the head, or keeps pictures, as if there were none; "
            "use a copy of the settings with `zones: []` if that may be"
        )
