"""Where the head may go, and what it can still show from there."""

from __future__ import annotations

import numpy as np

from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array
from ptzd.model import HeadLimits, HeadReading

OFF_CENTRE_SHARE = 0.7
"""A target that the limits keep off the centre is held if it is within 70 % of the way to the picture's edge."""


def nearest(target: HeadReading, limits: HeadLimits) -> HeadReading:
    """The pose within the limits that is nearest in pan and tilt; the zoom stays."""
    pan = target.pan_deg if limits.endless_pan else min(max(target.pan_deg, limits.pan_deg[0]), limits.pan_deg[1])
    tilt = min(max(target.tilt_deg, limits.tilt_deg[0]), limits.tilt_deg[1])
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=target.zoom)


def well_inside(rig: Rig, direction: Array, reading: HeadReading) -> bool:
    """Whether a direction ``(3,)`` in the head frame is seen well away from the picture's edge at this pose."""
    pixel, valid = rig.project_to_view(direction, reading)
    half = np.array(rig.zoom.size_px) / 2
    return bool(valid) and bool((np.abs(pixel - half) < OFF_CENTRE_SHARE * half).all())
