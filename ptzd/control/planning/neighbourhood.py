"""What part of a region's arc is searched, along it and across."""

from __future__ import annotations

import numpy as np

from ptzd.control.requests import Request
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import pixel_angle_rad


def arc_of(rig: Rig, request: Request) -> EpipolarArc:
    """The arc of the request's box centre over the range it asks for."""
    ray = rig.fisheye.lift(np.array(request.box.centre))[0]
    return EpipolarArc.of(rig, ray, *request.inverse_range)


def neighbourhood(rig: Rig, request: Request, inverse_range: float, half_width_px: float) -> tuple[float, float]:
    """Interval of inverse range around one place, ``half_width_px`` fisheye pixels to either side along the arc."""
    arc = arc_of(rig, request)
    if arc.degenerate:
        return request.inverse_range
    half = half_width_px * pixel_angle_rad(rig.fisheye, request.box.centre)
    there, last = float(arc.angle_at(inverse_range)), float(arc.angle_at(2.0 * request.inverse_range[1]))
    low, high = max(there - half, 0.0), min(there + half, last)
    return (float(arc.inverse_range_at(low)), float(arc.inverse_range_at(max(high, low))))


def band_rad(rig: Rig, request: Request) -> float:
    """How far off the arc the target may lie, for the nearest range asked for."""
    arc = arc_of(rig, request)
    return rig.band_rad(float(arc.head_inverse_range(np.array(request.inverse_range)).max()))
