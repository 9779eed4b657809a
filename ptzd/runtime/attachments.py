"""What goes beside a picture on the bus."""

from __future__ import annotations

import math

from ptzd.geometry.rig import Rig
from ptzd.model import FrameRef, HeadReading, Motion
from ptzd.outgoing import ImageAttachment


def view_attachment(rig: Rig, frame: FrameRef, reading: HeadReading, motion: Motion) -> ImageAttachment:
    """What a picture of the PTZ shows; directions of the calibrated head frame, deg."""
    pan, tilt = rig.head.pan_tilt_from_vapix(reading)
    width, height = rig.zoom.size_px
    return ImageAttachment(
        seq=frame.seq,
        t_capture_ns=frame.t_capture_ns,
        w=width,
        h=height,
        pan_deg=math.degrees(pan),
        tilt_deg=math.degrees(tilt),
        zoom=reading.zoom,
        hfov_deg=hfov_deg(rig, reading.zoom),
        moving=motion is not Motion.STABLE,
        motion=motion.value,
    )


def frame_attachment(frame: FrameRef, size_px: tuple[int, int]) -> ImageAttachment:
    """Which picture of its stream it is, and its size in px."""
    return ImageAttachment(seq=frame.seq, t_capture_ns=frame.t_capture_ns, w=size_px[0], h=size_px[1])


def hfov_deg(rig: Rig, zoom: float) -> float | None:
    """How wide the PTZ sees at a zoom; None beyond the calibrated ones."""
    low, high = rig.zoom.zoom_range
    return math.degrees(rig.zoom.camera_at(zoom).hfov_rad) if low <= zoom <= high else None
