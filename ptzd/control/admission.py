"""Whether a request may come in: everything is checked before anything moves."""

from __future__ import annotations

import math

import numpy as np

from ptzd.config import Config
from ptzd.control.events import RequestReceived, ZoomWish
from ptzd.control.memory import Memory
from ptzd.control.requests import Request
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.geometry.rig import Rig
from ptzd.geometry.zones import Zone
from ptzd.model import MIN_BOX_SIDE_PX, Box, FrameRef, Region, RegionAsked, ZoneKind

CLOSED_TO_BOXES = frozenset({ZoneKind.IGNORE, ZoneKind.PRIVACY})
"""What a no-go zone holds may still be looked at from beside it."""
SAME_FRAME_NS = 5_000_000
"""A time stamp names the frame at most 5 ms away: a sixth of a frame at 30 fps; clients copy stamps, not clocks."""


def admit(event: RequestReceived, memory: Memory, work: Work) -> Request:
    """Turn a structurally valid request that came at ``work.t_ns`` into an accepted one.

    Raises
    ------
    RequestRefused
        With code ``invalid``, ``outside``, ``zone``, ``stale_frame`` or ``no_frame`` and the path of the culprit.
    """
    rig, config, t_ns = work.rig, work.config, work.t_ns
    region = find_region(event, memory, work)
    hold_s = config.lock.hold_s if event.hold_s is None else event.hold_s
    timeout_s = config.queue.timeout_s if event.timeout_s is None else event.timeout_s
    return Request(
        id=event.id,
        label=event.label,
        priority=event.priority,
        region=region,
        inverse_range=_inverse_range(event.range_m or config.search.range_m),
        zoom=event.zoom,
        hfov_deg=_check_hfov(event, rig),
        fill=config.lock.fill if event.fill is None else event.fill,
        hold_ns=seconds(hold_s),
        accepted_ns=t_ns,
        expires_ns=t_ns + seconds(timeout_s),
        by=event.by,
    )


def find_region(asked: RegionAsked, memory: Memory, work: Work) -> Region:
    """The region that somebody asked for at ``work.t_ns``; errors as for :func:`admit`."""
    check_box(asked.box, work.rig, work.zones)
    frame = _frame(asked.frame_seq, asked.frame_t_capture_ns, memory, work.t_ns, work.config)
    return Region(box=asked.box, frame=frame)


def check_box(box: Box, rig: Rig, zones: tuple[Zone, ...]) -> None:
    """Refuse boxes that are too small, outside the picture or the lens' image circle, or in a zone closed to them."""
    for name, side in (("w", box.w), ("h", box.h)):
        if side < MIN_BOX_SIDE_PX:
            raise RequestRefused(
                "invalid", f"box.{name} is {side:g} px, at least {MIN_BOX_SIDE_PX:g} px", f"$.box.{name}"
            )
    width, height = rig.fisheye.size_px
    for name, low, high, size in (("x", box.x, box.x + box.w, width), ("y", box.y, box.y + box.h, height)):
        if low < -0.5 or high > size - 0.5:
            message = f"box reaches from {low:g} to {high:g} px, the picture from -0.5 to {size - 0.5:g} px"
            raise RequestRefused("outside", message, f"$.box.{name}")
    ray, valid = rig.fisheye.lift(np.array(box.centre))
    if not bool(valid):
        raise RequestRefused("outside", "the box's centre lies outside the fisheye's image circle", "$.box")
    for zone in zones:
        if zone.kind in CLOSED_TO_BOXES and zone.holds_ray(ray):
            raise RequestRefused("zone", f"the box's centre lies in the {zone.kind} zone {zone.name}", "$.box")


def _frame(seq: int | None, t_capture_ns: int | None, memory: Memory, t_ns: int, config: Config) -> FrameRef:
    """The frame that the box was drawn on; the newest when none is named."""
    if not memory.frames:
        raise RequestRefused("no_frame", "no fisheye frame has arrived yet; try again in a moment", "$.frame")
    if seq is None and t_capture_ns is None:
        return memory.frames[-1]
    frame = _find(memory.frames, seq, t_capture_ns)
    oldest, newest = memory.frames[0], memory.frames[-1]
    if frame is None:
        message = (
            f"the frame is not among the ones kept (seq {oldest.seq} to {newest.seq}, "
            f"t_capture_ns {oldest.t_capture_ns} to {newest.t_capture_ns}); send the box sooner or on a newer frame"
        )
        raise RequestRefused("stale_frame", message, "$.frame")
    age_s = (t_ns - frame.t_capture_ns) / 1e9
    if age_s > config.search.frame_max_age_s:
        message = f"the frame is {age_s:.1f} s old, at most {config.search.frame_max_age_s:g} s; use a newer frame"
        raise RequestRefused("stale_frame", message, "$.frame")
    return frame


def _find(frames: list[FrameRef], seq: int | None, t_capture_ns: int | None) -> FrameRef | None:
    for frame in reversed(frames):
        if seq is not None and frame.seq == seq:
            return frame
        if seq is None and t_capture_ns is not None and abs(frame.t_capture_ns - t_capture_ns) <= SAME_FRAME_NS:
            return frame
    return None


def _inverse_range(range_m: tuple[float, float]) -> tuple[float, float]:
    near, far = range_m
    return (0.0 if math.isinf(far) else 1.0 / far, 1.0 / near)


def _check_hfov(event: RequestReceived, rig: Rig) -> float | None:
    if event.zoom is not ZoomWish.HFOV or event.hfov_deg is None:
        return None
    narrow, wide = (math.degrees(angle) for angle in rig.zoom.hfov_range_rad)
    if not narrow - 1e-6 <= event.hfov_deg <= wide + 1e-6:
        message = f"hfov {event.hfov_deg:g}° is outside what the camera is calibrated for, {narrow:.2f}° to {wide:.2f}°"
        raise RequestRefused("invalid", message, "$.zoom.hfov_deg")
    return event.hfov_deg
