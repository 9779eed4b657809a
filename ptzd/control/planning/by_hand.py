"""What a person's hand means for the head: set points from pixels and angles, speeds that end before the limits."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control.events import MoveAsked, MoveWish
from ptzd.control.planning.zoom import hfov_around
from ptzd.errors import GeometryError, RequestRefused
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array
from ptzd.model import HeadLimits, HeadPose, HeadReading, HeadSpeed

FORESIGHT_S = 1.2
"""No speed eats up the way that is left in less. A speed in proportion to the way left never passes its end while what
lies between a report and the motion that follows from it takes less than this over e: 0.44 s for reports, orders and
brakes together."""
ZOOM_UNITS_S = 5000.0
"""The fastest zoom of any camera known; slower ones only brake earlier than they need."""
HALF_TURN_DEG = 180.0
SLOWEST = {"pan": 0.01, "tilt": 0.01, "zoom": 0.001}
"""Below, in deg/s and shares of the fastest zoom, it is rest."""
_MARGIN = 1e-9


def shown_pose(rig: Rig, reading: HeadReading) -> HeadPose:
    """A reading of the camera in the calibrated head frame."""
    pan, tilt = rig.head.pan_tilt_from_vapix(reading)
    return HeadPose(pan_deg=math.degrees(pan), tilt_deg=math.degrees(tilt), zoom=reading.zoom)


def reading_of(rig: Rig, pose: HeadPose) -> HeadReading:
    """The reverse of :func:`shown_pose`."""
    return rig.head.vapix_from_pan_tilt(math.radians(pose.pan_deg), math.radians(pose.tilt_deg), pose.zoom)


def set_point(
    rig: Rig, limits: HeadLimits, asked: MoveAsked, *, start: HeadReading, rests: bool, fill: float
) -> HeadReading:
    """Where the head is to go.

    Parameters
    ----------
    rig, limits
        The calibration, and where the head may go.
    asked : MoveAsked
        Any wish but ``speed``.
    start : HeadReading
        What ``by`` counts from, and whose zoom is kept.
    rests : bool
        Whether the head rests at ``start``: only then a pixel without its picture's pose has a direction.
    fill : float
        Share of the picture that a box fills, where the wish does not say.

    Raises
    ------
    RequestRefused
        ``invalid`` or ``unreachable`` with what is wrong and where the head can go.
    """
    if asked.wish is MoveWish.TO:
        aimed = reading_of(rig, HeadPose(pan_deg=asked.pan_deg, tilt_deg=asked.tilt_deg, zoom=start.zoom))
    elif asked.wish is MoveWish.BY:
        if abs(asked.pan_deg) > HALF_TURN_DEG and limits.endless_pan:
            message = f"pan {asked.pan_deg:g}°: a head that turns on and on takes the shorter way; ask for 180° at most"
            raise RequestRefused("invalid", message, "$.by.pan_deg")
        # in the camera's own angles, which do not wrap: 300° to the right is never 60° to the left
        pan, tilt = rig.head.pan, rig.head.tilt
        aimed = HeadReading(
            pan_deg=start.pan_deg + asked.pan_deg / (pan.sign * pan.scale),
            tilt_deg=start.tilt_deg + asked.tilt_deg / (tilt.sign * tilt.scale),
            zoom=start.zoom,
        )
    else:
        aimed = _aimed_at_pixels(rig, asked, start=start, rests=rests, fill=fill)
    zoom = aimed.zoom if asked.hfov_deg is None else _zoom_of(rig, limits, asked.hfov_deg)
    target = HeadReading(pan_deg=aimed.pan_deg, tilt_deg=aimed.tilt_deg, zoom=zoom)
    if not limits.contains(target):
        raise RequestRefused("unreachable", _outside(rig, limits, target), f"$.{asked.wish}")
    return target


def _aimed_at_pixels(rig: Rig, asked: MoveAsked, *, start: HeadReading, rests: bool, fill: float) -> HeadReading:
    if asked.picture is None and not rests:
        message = (
            "the head moves, and nobody can tell what a pixel shows; give `picture`: pan_deg, tilt_deg and zoom of "
            "the picture it was seen in (they come with it)"
        )
        raise RequestRefused("invalid", message, "$.picture")
    seen_at = start if asked.picture is None else reading_of(rig, asked.picture)
    box = asked.box_px
    corners = np.array([*box.corners, box.centre] if box is not None else [asked.point_px], dtype=float)
    directions = _directions(rig, seen_at, corners, asked.wish)
    aimed = rig.aim(directions[-1], seen_at.zoom)
    if box is None or asked.hfov_deg is not None:
        return aimed
    narrow, wide = rig.zoom.hfov_range_rad
    hfov = hfov_around(rig, directions, aimed, asked.fill or fill)
    zoom = rig.zoom.zoom_for_hfov(min(max(hfov, narrow), wide))
    return HeadReading(pan_deg=aimed.pan_deg, tilt_deg=aimed.tilt_deg, zoom=float(round(zoom)))


def _directions(rig: Rig, seen_at: HeadReading, pixels: Array, wish: MoveWish) -> Array:
    """Directions ``(k, 3)`` in the head frame of pixels ``(k, 2)`` of the picture at this reading."""
    width, height = rig.zoom.size_px
    if (pixels < -0.5).any() or (pixels > np.array([width, height]) - 0.5).any():
        message = f"({pixels[-1, 0]:g}, {pixels[-1, 1]:g}) px reaches out of the picture of {width}x{height} px"
        raise RequestRefused("invalid", message, f"$.{wish}")
    try:
        return rig.lift_from_view(pixels, seen_at)
    except GeometryError as error:
        raise RequestRefused("invalid", str(error), "$.picture") from None


def _zoom_of(rig: Rig, limits: HeadLimits, hfov_deg: float) -> float:
    try:
        zoom = float(round(rig.zoom.zoom_for_hfov(math.radians(hfov_deg))))
    except GeometryError as error:
        raise RequestRefused("unreachable", str(error), "$.hfov_deg") from None
    if not limits.zoom[0] <= zoom <= limits.zoom[1]:
        message = f"{hfov_deg:g}° wide is zoom {zoom:.0f}; the limits are {limits.zoom[0]:.0f} to {limits.zoom[1]:.0f}"
        raise RequestRefused("unreachable", message, "$.hfov_deg")
    return zoom


def _outside(rig: Rig, limits: HeadLimits, target: HeadReading) -> str:
    pose = shown_pose(rig, target)
    pan = "any" if limits.endless_pan else f"{limits.pan_deg[0]:g} to {limits.pan_deg[1]:g}°"
    return (
        f"pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}° is the camera's own pan {target.pan_deg:.2f}°, tilt "
        f"{target.tilt_deg:.2f}°, zoom {target.zoom:.0f}; its limits are pan {pan}, tilt {limits.tilt_deg[0]:g} to "
        f"{limits.tilt_deg[1]:g}°, zoom {limits.zoom[0]:.0f} to {limits.zoom[1]:.0f}"
    )


def speed_wanted(rig: Rig, limits: HeadLimits, asked: MoveAsked) -> HeadSpeed:
    """The speed of a wish, in the camera's own sense.

    Raises
    ------
    RequestRefused
        ``unreachable``: the camera is not so fast, or nobody knows how fast it is.
    """
    pan, tilt = rig.head.pan, rig.head.tilt
    wanted = HeadSpeed(
        pan_deg_s=asked.pan_deg_s / (pan.sign * pan.scale),
        tilt_deg_s=asked.tilt_deg_s / (tilt.sign * tilt.scale),
        zoom_rate=asked.zoom_rate,
    )
    if limits.top_deg_s is None:
        if wanted.pan_deg_s or wanted.tilt_deg_s:
            message = "the camera does not say how fast it turns; set ptz.steer_top_deg_s (its data sheet has it)"
            raise RequestRefused("unreachable", message, "$.speed")
        return wanted
    top_pan, top_tilt = limits.top_deg_s
    if abs(wanted.pan_deg_s) > top_pan + _MARGIN or abs(wanted.tilt_deg_s) > top_tilt + _MARGIN:
        message = (
            f"pan {asked.pan_deg_s:g}°/s, tilt {asked.tilt_deg_s:g}°/s: the camera turns at most {top_pan:g}°/s in pan "
            f"and {top_tilt:g}°/s in tilt"
        )
        raise RequestRefused("unreachable", message, "$.speed")
    return wanted


def speed_shown(rig: Rig, speed: HeadSpeed) -> tuple[float, float]:
    """Pan and tilt, deg/s, of the calibrated head frame."""
    pan, tilt = rig.head.pan, rig.head.tilt
    return speed.pan_deg_s * pan.sign * pan.scale, speed.tilt_deg_s * tilt.sign * tilt.scale


def within_limits(limits: HeadLimits, reading: HeadReading, wanted: HeadSpeed) -> tuple[HeadSpeed, str]:
    """A speed that leaves the head time to brake before the limits, and which limit slowed it; empty: none did.

    Parameters
    ----------
    limits, reading
        Where the head may go, and where it was last.
    wanted : HeadSpeed
        In the camera's own sense.
    """
    top = (limits.pan_deg, limits.tilt_deg, limits.zoom)
    places = (reading.pan_deg, reading.tilt_deg, reading.zoom)
    units = (1.0, 1.0, ZOOM_UNITS_S)
    asked = (wanted.pan_deg_s, wanted.tilt_deg_s, wanted.zoom_rate)
    granted, slowed = [], []
    for name, rate, place, ends, unit in zip(("pan", "tilt", "zoom"), asked, places, top, units, strict=True):
        free = name == "pan" and limits.endless_pan
        share = 1.0 if free or not rate else _share(rate * unit, place, ends)
        granted.append(rate * share)
        if share < 1.0:
            slowed.append(f"{name} {ends[1] if rate > 0 else ends[0]:g}")
    pan, tilt, zoom = granted
    return at_rest_below_slowest(HeadSpeed(pan_deg_s=pan, tilt_deg_s=tilt, zoom_rate=zoom)), ", ".join(slowed)


def at_rest_below_slowest(speed: HeadSpeed) -> HeadSpeed:
    """A speed as the camera is told it: an axis too slow to be seen rests."""

    def told(name: str, rate: float) -> float:
        return rate if abs(rate) >= SLOWEST[name] else 0.0

    pan, tilt, zoom = told("pan", speed.pan_deg_s), told("tilt", speed.tilt_deg_s), told("zoom", speed.zoom_rate)
    return HeadSpeed(pan_deg_s=pan, tilt_deg_s=tilt, zoom_rate=zoom)


def _share(speed: float, place: float, ends: tuple[float, float]) -> float:
    """How much of a speed the way that is left allows."""
    left = max(ends[1] - place, 0.0) if speed > 0 else max(place - ends[0], 0.0)
    return min(1.0, left / FORESIGHT_S / abs(speed))
