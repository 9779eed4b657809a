"""Where the head must turn to look at a named place, by the calibration in force; and back."""

from __future__ import annotations

import math

import numpy as np

from ptzd.config import Config
from ptzd.control.planning.reach import Reach, nearest
from ptzd.errors import RequestRefused
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing, pan_tilt
from ptzd.model import HeadLimits, HeadReading
from ptzd.presets import Place, nearest_names

HFOV_ROUNDING_DEG = 0.01
"""A field of view this near the end of the calibrated range is that end: files are written with fewer digits."""


def place_named(config: Config, name: str) -> Place:
    """The place of this name.

    Raises
    ------
    RequestRefused
        ``unknown_place`` with the names that resemble it.
    """
    place = config.presets.places.get(name)
    if place is None:
        raise RequestRefused(
            "unknown_place", f"no place {name!r}; {nearest_names(name, config.presets.places)}", "$.place"
        )
    return place


def reading_at(rig: Rig, config: Config, reach: Reach, name: str, place: Place) -> HeadReading:
    """The pose that looks at a place, within the limits and outside the zones.

    Raises
    ------
    RequestRefused
        ``unreachable`` with what stands against it.
    """
    limits = reach.limits
    narrow, wide = (math.degrees(angle) for angle in rig.zoom.hfov_range_rad)
    hfov_deg = place.hfov_deg
    if not narrow - HFOV_ROUNDING_DEG <= hfov_deg <= wide + HFOV_ROUNDING_DEG:
        message = f"{name} is {hfov_deg:g}° wide, the camera is calibrated for {narrow:.2f}° to {wide:.2f}°"
        raise RequestRefused("unreachable", message, "$.place")
    zoom = rig.zoom.zoom_for_hfov(math.radians(min(max(hfov_deg, narrow), wide)))
    in_fisheye = bearing(math.radians(place.azimuth_deg), math.radians(place.elevation_deg))
    aimed = rig.aim(rig.head_from_fisheye_rotation @ in_fisheye, zoom)
    turn_deg = 360.0 / rig.head.pan.scale
    poses = [
        HeadReading(pan_deg=aimed.pan_deg + turns * turn_deg, tilt_deg=aimed.tilt_deg, zoom=zoom)
        for turns in (0, -1, 1)
    ]
    tolerances = (config.ptz.arrival_tolerance_deg, config.ptz.arrival_tolerance_deg, config.ptz.zoom_tolerance)
    for pose in poses:
        # what a camera reports at its very limit comes back a rounding beyond it
        inside = _with_zoom_inside(nearest(pose, limits), limits)
        off = (inside.pan_deg - pose.pan_deg, inside.tilt_deg - pose.tilt_deg, inside.zoom - pose.zoom)
        if all(abs(distance) <= most for distance, most in zip(off, tolerances, strict=True)):
            objection = reach.objection(inside)
            if objection is not None:
                raise RequestRefused("unreachable", f"{name} lies at {_in_words(inside)}: {objection}", "$.place")
            return inside
    raise RequestRefused(
        "unreachable", f"{name} lies at {_in_words(aimed)}: outside the head's limits, {_limits(limits)}", "$.place"
    )


def place_seen(rig: Rig, reading: HeadReading) -> Place:
    """The place that a pose looks at: the inverse of `reading_at`.

    Raises
    ------
    GeometryError
        When the zoom is outside what the camera is calibrated for.
    """
    axis = rig.head_from_camera(reading) @ np.array([0.0, 0.0, 1.0])
    azimuth, elevation = pan_tilt(rig.head_from_fisheye_rotation.T @ axis)
    return Place(
        azimuth_deg=math.degrees(float(azimuth)),
        elevation_deg=math.degrees(float(elevation)),
        hfov_deg=math.degrees(rig.camera(reading).hfov_rad),
    )


def _with_zoom_inside(pose: HeadReading, limits: HeadLimits) -> HeadReading:
    zoom = min(max(pose.zoom, limits.zoom[0]), limits.zoom[1])
    return HeadReading(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=zoom)


def _in_words(pose: HeadReading) -> str:
    return f"pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}°, zoom {pose.zoom:.0f}"


def _limits(limits: HeadLimits) -> str:
    spans = (("pan", limits.pan_deg, "°"), ("tilt", limits.tilt_deg, "°"), ("zoom", limits.zoom, ""))
    return ", ".join(f"{axis} {low:g} to {high:g}{unit}" for axis, (low, high), unit in spans)
