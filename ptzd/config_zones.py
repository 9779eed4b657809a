"""Settings of zones, in the settings file or in a file of their own; what a zone means is `ptzd.geometry.zones`."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from ptzd.config_types import Interval, Name, Part, check_range, converted, refuse_not_finite
from ptzd.errors import ConfigError
from ptzd.model import ZoneKind

Corner = tuple[float, float]
Corners = Annotated[tuple[Corner, ...], Meta(min_length=3, max_length=200)]
"""In the order of a walk around."""


class FisheyeZone(Part, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="frame", tag="fisheye"):
    """A zone drawn in the fisheye's picture; its edges are straight there."""

    name: Name
    kind: ZoneKind
    corners_px: Corners
    range_m: Interval | None = None
    """How far from the fisheye what it covers is; without it ``search.range_m``. In baselines when not metric."""


class HeadZone(Part, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="frame", tag="head"):
    """A zone of directions as `pose` and results tell them; its edges are great circles."""

    name: Name
    kind: ZoneKind
    corners_deg: Corners
    """Pan and tilt of each, calibrated head frame."""
    range_m: Interval | None = None
    """How far from the head what it covers is; without it ``search.range_m``."""


ZoneSettings = FisheyeZone | HeadZone
Zones = Annotated[tuple[ZoneSettings, ...], Meta(max_length=64)]


class ZonesFile(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What the file that ``zones`` names holds."""

    zones: Zones


def parse_zones(document: object, name: str) -> list[object]:
    """Check the parsed file of zones and return its list, as it may stand in the settings themselves.

    Raises
    ------
    ConfigError
        With the path of the culprit, e.g. ``zones.yaml: zones[2].kind: Invalid enum value 'nogo'``.
    """
    refuse_not_finite(document, name, "")
    zones = converted(document, ZonesFile, name).zones
    check_zones(zones, name)
    plain: list[object] = msgspec.to_builtins(zones)
    return plain


def check_zones(zones: tuple[ZoneSettings, ...], name: str) -> None:
    """Raise ConfigError for what needs no calibration to be wrong; the polygons are checked with it."""
    first: dict[str, int] = {}
    for index, zone in enumerate(zones):
        where = f"{name}: zones[{index}]"
        if zone.name in first:
            raise ConfigError(f"{where}.name: {zone.name} is the name of zones[{first[zone.name]}] already")
        first[zone.name] = index
        if zone.range_m is not None:
            check_range(zone.range_m, f"{where}.range_m")
