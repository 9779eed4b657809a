"""What goes beside a picture on the bus: the documents that ``ImageAttachment`` of the bus's messages describes."""

from __future__ import annotations

import math

from ptzd.geometry.rig import Rig
from ptzd.model import FrameRef, HeadReading, Motion


def view_attachment(rig: Rig, frame: FrameRef, reading: HeadReading, motion: Motion) -> dict[str, object]:
    """What a picture of the PTZ shows; directions of the calibrated head frame, deg."""
    pan, tilt = rig.head.pan_tilt_from_vapix(reading)
    shown: dict[str, object] = {
        "pan_deg": math.degrees(pan),
        "tilt_deg": math.degrees(tilt),
        "zoom": reading.zoom,
        "moving": motion is not Motion.STABLE,
        "motion": motion.value,
    }
    low, high = rig.zoom.zoom_range
    if low <= reading.zoom <= high:
        shown["hfov_deg"] = math.degrees(rig.zoom.camera_at(reading.zoom).hfov_rad)
    return frame_attachment(frame, rig.zoom.size_px) | shown


def frame_attachment(frame: FrameRef, size_px: tuple[int, int]) -> dict[str, object]:
    """Which picture of its stream it is, and its size in px."""
    return {"seq": frame.seq, "t_capture_ns": frame.t_capture_ns, "w": size_px[0], "h": size_px[1]}
