"""Where the epipolar arc of a request lies in the pictures, for those who draw it."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control.commands import RunMatch
from ptzd.errors import GeometryError
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array, CameraModel, Mask, in_picture
from ptzd.model import HeadReading

STEP_RAD = math.radians(0.25)
"""Between the points of a drawn arc; finer than a pixel of most fisheyes."""
Line = list[tuple[float, float]]


def arc_of(rig: Rig, job: RunMatch) -> EpipolarArc | None:
    """Arc that a match searches; None where the box's centre is no ray of the fisheye."""
    rays, valid = rig.fisheye.lift(np.array([job.box.centre]))
    if not valid[0]:
        return None
    return EpipolarArc.of(rig, rays[0], *job.inverse_range)


def in_fisheye(rig: Rig, arc: EpipolarArc) -> list[Line]:
    """Where the head looks along the arc, as directions drawn into the fisheye picture, px."""
    bearings = arc.bearing(arc.steps(STEP_RAD))
    pixels, valid = rig.fisheye.project(bearings @ rig.head_from_fisheye_rotation)
    return _pieces(rig.fisheye, pixels, valid)


def in_view(rig: Rig, arc: EpipolarArc, reading: HeadReading) -> list[Line]:
    """The arc in the PTZ picture at a reading, px; empty outside the zoom table."""
    try:
        camera = rig.camera(reading)
    except GeometryError:
        return []
    pixels, valid = rig.project_to_view(arc.bearing(arc.steps(STEP_RAD)), reading)
    return _pieces(camera, pixels, valid)


def epipole_in_fisheye(rig: Rig) -> tuple[float, float] | None:
    """Where the fisheye sees the head, px; None outside its picture."""
    ray = -rig.head_from_fisheye_translation @ rig.head_from_fisheye_rotation
    pixels, valid = rig.fisheye.project(ray[None])
    if not valid[0] or not in_picture(rig.fisheye, pixels)[0]:
        return None
    return float(pixels[0, 0]), float(pixels[0, 1])


def _pieces(camera: CameraModel, pixels: Array, valid: Mask) -> list[Line]:
    """Runs of at least two neighbours that are in the picture."""
    lines: list[Line] = [[]]
    for (x, y), seen in zip(pixels.tolist(), valid & in_picture(camera, pixels), strict=True):
        if seen:
            lines[-1].append((x, y))
        elif lines[-1]:
            lines.append([])
    return [line for line in lines if len(line) > 1]
