"""The zones of the settings, as the calibration shows them."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ptzd.config import Config
from ptzd.config_types import Interval
from ptzd.config_zones import FisheyeZone, ZoneSettings
from ptzd.errors import ConfigError, GeometryError
from ptzd.geometry.rig import Rig
from ptzd.geometry.zones import Zone, drawn, of_bearings


def zones_of(config: Config, rig: Rig) -> tuple[Zone, ...]:
    """Return the zones of the settings on both spheres.

    Raises
    ------
    ConfigError
        With the culprit's path: a polygon that crosses itself, has no area, is too large or leaves the picture.
    """
    return _zones(config.zones, config.search.range_m, rig)


@lru_cache(maxsize=4)
def _zones(zones: tuple[ZoneSettings, ...], range_m: Interval, rig: Rig) -> tuple[Zone, ...]:
    return tuple(_zone(index, zone, range_m, rig) for index, zone in enumerate(zones))


def _zone(index: int, zone: ZoneSettings, range_m: Interval, rig: Rig) -> Zone:
    near, far = zone.range_m or range_m
    inverse_range = (0.0 if math.isinf(far) else 1.0 / far, 1.0 / near)
    try:
        if isinstance(zone, FisheyeZone):
            return drawn(zone.name, zone.kind, zone.corners_px, inverse_range, rig)
        corners = np.radians(zone.corners_deg)
        return of_bearings(zone.name, zone.kind, map(tuple, corners.tolist()), inverse_range, rig)
    except GeometryError as error:
        raise ConfigError(f"zones[{index}] ({zone.name}): {error}") from None
