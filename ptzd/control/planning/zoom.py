"""How far to zoom on a target: as asked, and never past what its place is known to."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control.events import ZoomWish
from ptzd.control.requests import Request
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.geometry.types import Array
from ptzd.model import Candidate, HeadLimits, HeadReading

SAFE_SHARE = 0.1
"""The zoom follows the first move at once when three sigma of the place are under a tenth of the final picture."""


def zoom_wanted(
    rig: Rig, request: Request, limits: HeadLimits, place: Candidate, *, present: float, error_rad: float
) -> float:
    """Zoom that shows the target as asked.

    Parameters
    ----------
    rig, request, limits
        The calibration, what is asked for, and where the head may go.
    place : Candidate
        Where the target is.
    present : float
        Zoom now, VAPIX units; kept when the request says so.
    error_rad : float
        How far off the place may be: twice that fits into the height of the picture.
    """
    if request.zoom is ZoomWish.KEEP:
        return present
    narrow, wide = rig.zoom.hfov_range_rad
    if request.zoom is ZoomWish.HFOV and request.hfov_deg is not None:
        hfov = math.radians(request.hfov_deg)
    else:
        hfov = _filling_hfov(rig, request, place, present)
    width, height = rig.zoom.size_px
    least = 2 * error_rad * width / height
    zoom = rig.zoom.zoom_for_hfov(min(max(hfov, least, narrow), wide))
    return float(round(min(max(zoom, limits.zoom[0]), limits.zoom[1])))


def _filling_hfov(rig: Rig, request: Request, place: Candidate, present: float) -> float:
    """Field of view in which the region's corners span the asked share of the narrower side, by their directions."""
    rays, valid = rig.fisheye.lift(np.array(request.box.corners))
    rotated = rays[valid] @ rig.head_from_fisheye_rotation.T
    directions: Array = rotated + place.inverse_range * rig.head_from_fisheye_translation
    target = rig.aim(bearing(place.pan_rad, place.tilt_rad), present)
    return hfov_around(rig, directions, target, request.fill)


def hfov_around(rig: Rig, directions: Array, target: HeadReading, fill: float) -> float:
    """Field of view, rad, in which directions ``(k, 3)`` of the head frame span this share of the narrower side.

    Around ``target``, which points at their middle.
    """
    in_camera = directions @ rig.head_from_camera(target)
    slopes = np.abs(in_camera[:, :2] / in_camera[:, 2:])
    width, height = rig.zoom.size_px
    half = max(float(slopes[:, 0].max()), float(slopes[:, 1].max()) * width / height)
    return 2 * math.atan(half / fill)
