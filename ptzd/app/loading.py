"""Reading what the daemon is told: settings and calibration, with the texts that go into the log."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import msgspec
import yaml

from ptzd.calibrate.refined import in_force
from ptzd.calibration.file import read_rig
from ptzd.config import Config, FilesSource, HttpSource, parse_config
from ptzd.config_zones import Zones, parse_zones
from ptzd.control.activities.home import home_of
from ptzd.control.planning.reach import reach_of
from ptzd.control.planning.zones import zones_of
from ptzd.devices.vapix.address import Address
from ptzd.documents import DocumentError, parse_yaml, read_text
from ptzd.errors import CalibrationError, ConfigError
from ptzd.geometry.rig import Rig
from ptzd.model import HeadLimits
from ptzd.presets import Presets, parse_presets

PRESETS = "presets.yaml"
"""Beside the settings."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Loaded:
    """Settings and calibration, parsed and as text."""

    path: Path
    config: Config
    config_text: str
    """The settings as parsed, defaults filled in; names files of secrets, never their contents."""
    rig: Rig
    calibration_text: str
    shadow: bool = False
    """Asked for beside the file, whatever stands in it."""


def load(path: Path, *, shadow: bool = False) -> Loaded:
    """Read a settings file and the calibration that it names.

    Relative paths inside the settings are relative to the settings file.

    Parameters
    ----------
    path : Path
    shadow : bool
        Move nothing, also where the file does not say so.

    Raises
    ------
    ConfigError, CalibrationError
        With file and path of the culprit.
    """
    config = load_settings(path)
    if shadow:
        config = msgspec.structs.replace(config, shadow=msgspec.structs.replace(config.shadow, enabled=True))
    _check_addresses(config)
    _check_time_zone(config)
    calibration_path = Path(config.calibration)
    try:
        calibration_text = read_text(calibration_path)
    except (OSError, DocumentError) as error:
        message = f"{path}: calibration: {calibration_path} cannot be read ({error}); make one with `ptzd calibrate`"
        raise CalibrationError(message) from None
    if config.drift.monitor:
        calibration_text = in_force(config, calibration_text)
    return Loaded(
        path=path,
        config=config,
        config_text=yaml.safe_dump(msgspec.to_builtins(config), sort_keys=False),
        rig=checked_rig(config, calibration_text, str(calibration_path)),
        calibration_text=calibration_text,
        shadow=shadow,
    )


def load_settings(path: Path) -> Config:
    """Settings with their paths found from where the settings are; no calibration is needed."""
    return _anchored(load_config(path), path.parent)


def checked_rig(config: Config, text: str, name: str) -> Rig:
    """Parse a calibration and hold it against the settings."""
    rig = read_rig(text, name)
    if rig.uncertainty is None:
        raise CalibrationError(f"{name}: uncertainty: missing; the width of the search band comes from it")
    if rig.zoom.size_px != config.ptz.size_px:
        sizes = f"calibrated at {_size(rig.zoom.size_px)}, ptz.size_px asks for {_size(config.ptz.size_px)}"
        raise CalibrationError(f"{name}: ptz.size_px: {sizes}; make them the same")
    _check_home(config, rig)
    low, high = rig.zoom.zoom_range
    if not low <= config.home.zoom <= high:
        raise ConfigError(f"home.zoom: {config.home.zoom:g} is outside the calibrated zooms {low:g} to {high:g}")
    return rig


def widest_limits(config: Config) -> HeadLimits:
    """The limits of the settings; those of the camera may be narrower."""
    limits = config.limits
    return HeadLimits(pan_deg=limits.pan_deg, tilt_deg=limits.tilt_deg, zoom=limits.zoom)


def _check_home(config: Config, rig: Rig) -> None:
    """Refuse zones that are no polygons, and those that the head would rest in."""
    if not config.zones:
        return
    home = home_of(config)
    objection = reach_of(widest_limits(config), rig, zones_of(config, rig)).objection(home)
    if objection is not None:
        place = f"home (pan {home.pan_deg:g}°, tilt {home.tilt_deg:g}°, zoom {home.zoom:g})"
        raise ConfigError(f"zones: {place} is {objection}; move home or the zone")


def load_config(path: Path) -> Config:
    """Read a settings file, and the places of ``presets.yaml`` beside it.

    Raises
    ------
    ConfigError
        With the file and the path of the culprit.
    """
    try:
        document = parse_yaml(read_text(path))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; give the settings with --config FILE") from None
    except DocumentError as error:
        raise ConfigError(f"{path}: {error}") from None
    if isinstance(document, dict) and isinstance(document.get("zones"), str):
        document = {**document, "zones": _zones(path.parent / document["zones"])}
    config = parse_config(document, str(path))
    beside = path.parent / PRESETS
    presets = read_presets(beside)
    if presets is None:
        return config
    if config.presets != Presets():
        raise ConfigError(f"{path}: presets: there is {beside} too; put all of them into one of the two")
    return msgspec.structs.replace(config, presets=presets)


def read_presets(path: Path) -> Presets | None:
    """Read a file of places; None when there is none.

    Raises
    ------
    ConfigError
        With the file and the path of the culprit.
    """
    try:
        return parse_presets(parse_yaml(read_text(path)), str(path))
    except FileNotFoundError:
        return None
    except (OSError, DocumentError) as error:
        raise ConfigError(f"{path}: {error.strerror if isinstance(error, OSError) else error}") from None


def _zones(path: Path) -> list[object]:
    """What the file of zones holds: from here on it is part of the settings, and so of every log."""
    try:
        return parse_zones(parse_yaml(read_text(path)), str(path))
    except OSError as error:
        raise ConfigError(f"zones: {path} cannot be read ({error.strerror})") from None
    except DocumentError as error:
        raise ConfigError(f"{path}: {error}") from None


def _check_addresses(config: Config) -> None:
    """Refuse addresses that cannot be used, a password inside one above all: settings are kept in every log."""
    Address(url=config.ptz.url, setting="ptz").base()
    if isinstance(config.fisheye, HttpSource):
        Address(url=config.fisheye.url, setting="fisheye").base()


def _check_time_zone(config: Config) -> None:
    zone = config.presets.time_zone
    if zone is None:
        return
    try:
        ZoneInfo(zone)
    except (ZoneInfoNotFoundError, ValueError, OSError):
        message = (
            f"presets: time_zone: {zone!r} is not known on this machine; write e.g. Europe/Berlin, or install tzdata"
        )
        raise ConfigError(message) from None


def _anchored(config: Config, folder: Path) -> Config:
    """Make relative paths absolute."""
    replace = msgspec.structs.replace
    ptz, fisheye = config.ptz, config.fisheye
    if ptz.password_file is not None:
        ptz = replace(ptz, password_file=str(folder / ptz.password_file))
    if isinstance(fisheye, FilesSource):
        fisheye = replace(fisheye, path=str(folder / fisheye.path))
    if isinstance(fisheye, HttpSource) and fisheye.password_file is not None:
        fisheye = replace(fisheye, password_file=str(folder / fisheye.password_file))
    bus = config.bus
    if bus.config_file is not None:
        bus = replace(bus, config_file=str(folder / bus.config_file))
    return replace(
        config,
        calibration=str(folder / config.calibration),
        ptz=ptz,
        fisheye=fisheye,
        bus=bus,
        log=replace(config.log, directory=str(folder / config.log.directory)),
        zones=_with_ranges(config),
    )


def _with_ranges(config: Config) -> Zones:
    """Zones that say their range: where they are must not change with ``search``, which may while the daemon runs."""
    default = config.search.range_m
    return tuple(msgspec.structs.replace(zone, range_m=zone.range_m or default) for zone in config.zones)


def _size(size_px: tuple[int, int]) -> str:
    return f"{size_px[0]}×{size_px[1]}"
