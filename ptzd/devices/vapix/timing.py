"""How much older pictures are than position reports, measured on the camera: a step, seen twice.

The head makes a small step. Its reports and the shift of its pictures draw the same curve, one later than the other.
The delay between the two is what the pose of a picture depends on; how old both are together cannot be seen from here
and does not matter to it. ``ptz.image_latency_s = ptz.report_lag_s + offset`` puts them on one time.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceGarbled
from ptzd.jpeg.pixels import decode_grey
from ptzd.model import HeadReading, Motion
from ptzd.ports import HeadPoll, Picture

STEP_DEG = 3.0
STEPS = 4
AROUND_S = 0.4
"""Pictures and reports before and after a step that belong to it."""
MAX_OFFSET_S = 1.0
MIN_MOVING = 2
"""Pictures in motion without which a step tells nothing."""
MAX_MISFIT = 0.01
"""Mean square difference of the two curves, in shares of the way, above which they are not the same step."""
MIN_RESPONSE = 0.05
"""Of the phase correlation; below it the two pictures do not show the same."""

MIN_TEXTURE = 2.0
"""Standard deviation of the grey values, below which a shift cannot be seen."""

Samples = Sequence[tuple[int, float]]
"""Pairs of time in ns and share of the way, 0 to 1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """What was measured."""

    offset_s: float
    """Age of a picture on arrival, less age of a report at the middle of its round trip."""
    sigma_s: float
    """Scatter over the steps, one sigma."""
    steps: int
    """Steps that could be used."""


async def measure_timing(
    head: VapixHead, start: HeadReading, *, step_deg: float = STEP_DEG, steps: int = STEPS
) -> Timing:
    """Step to and fro around ``start`` and compare pictures with reports.

    Parameters
    ----------
    head : VapixHead
        Described; looks at something with texture.
    start : HeadReading
        Where to measure; the steps go to ``pan + step_deg``.
    step_deg : float
        Small enough that the views overlap, e.g. a twentieth of the field of view.

    steps : int
        How many, to and fro by turns.

    Raises
    ------
    DeviceGarbled
        The pictures show no motion: no texture, or too few pictures per second.
    """
    end = HeadReading(pan_deg=start.pan_deg + step_deg, tilt_deg=start.tilt_deg, zoom=start.zoom)
    await head.move(start)
    offsets = []
    for index in range(steps):
        target = (end, start)[index % 2]
        reports, pictures = await _step(head, target)
        offset_s = step_offset_s(progress_of_reports(reports), progress_of_pictures(pictures))
        if offset_s is not None:
            offsets.append(offset_s)
    if len(offsets) < steps / 2:
        raise DeviceGarbled(
            "the pictures show no clear step: point the camera at something with texture, at a wide zoom"
        )
    return Timing(offset_s=float(np.median(offsets)), sigma_s=float(np.std(offsets)), steps=len(offsets))


async def _step(head: VapixHead, target: HeadReading) -> tuple[list[tuple[int, HeadReading]], list[Picture]]:
    reports: list[tuple[int, HeadReading]] = []
    pictures: list[Picture] = []

    async def follow_reports(polls: AsyncIterator[HeadPoll]) -> None:
        while True:
            poll = await anext(polls)
            reports.append((poll.t_ns + head.report_lag_ns, poll.reading))

    async def follow_pictures(stream: AsyncIterator[tuple[Picture, HeadReading, Motion]]) -> None:
        while True:
            pictures.append((await anext(stream))[0])

    followers = [
        asyncio.create_task(follow_reports(head.polls())),
        asyncio.create_task(follow_pictures(head.pictures())),
    ]
    try:
        await asyncio.sleep(AROUND_S)
        await head.move(target)
        await asyncio.sleep(AROUND_S)
    finally:
        for follower in followers:
            follower.cancel()
        ends = await asyncio.gather(*followers, return_exceptions=True)
    for end in ends:
        if isinstance(end, Exception):
            raise end  # a stream that was lost is no scene without texture
    return reports, pictures


def progress_of_reports(reports: Sequence[tuple[int, HeadReading]]) -> Samples:
    """Share of the way in pan at each report."""
    if not reports:
        return []
    first, last = reports[0][1].pan_deg, reports[-1][1].pan_deg
    way = last - first
    return [(t_ns, (reading.pan_deg - first) / way) for t_ns, reading in reports] if way else []


def progress_of_pictures(pictures: Sequence[Picture]) -> Samples:
    """Share of the way at the arrival of each picture, from its shift against the first one."""
    if len(pictures) < MIN_MOVING:
        return []
    greys = [_grey(picture.jpeg) for picture in pictures]
    window = cv2.createHanningWindow(greys[0].shape[::-1], cv2.CV_32F)
    shifts = []
    for grey in greys:
        shown = float(grey.std()) >= MIN_TEXTURE
        # OpenCV 5 multiplies the window into what it is given, so it gets copies.
        (shift_px, _), response = cv2.phaseCorrelate(greys[0].copy(), grey.copy(), window)
        shifts.append(shift_px if shown and response >= MIN_RESPONSE else float("nan"))
    way = shifts[-1]
    if not abs(way) > 1.0:
        return []
    pairs = zip(pictures, shifts, strict=True)
    return [(picture.t_arrival_ns, shift / way) for picture, shift in pairs if np.isfinite(shift)]


def _grey(jpeg: bytes) -> NDArray[np.float32]:
    grey = decode_grey(jpeg)
    half = (grey.shape[1] // 2, grey.shape[0] // 2)
    return cv2.resize(grey, half, interpolation=cv2.INTER_AREA).astype(np.float32)


def step_offset_s(reports: Samples, pictures: Samples) -> float | None:
    """By how much the pictures' curve comes later than the reports', s; None when either shows no motion.

    Least squares over the shift of one curve against the other, on a grid of 1 ms.
    """
    moving = sum(0.02 < share < 0.98 for _, share in pictures)
    if moving < MIN_MOVING or len(reports) < MIN_MOVING:
        return None
    report_s = np.array([t_ns for t_ns, _ in reports], dtype=np.int64)
    picture_s = np.array([t_ns for t_ns, _ in pictures], dtype=np.int64)
    origin_ns = report_s[0]
    report_t, picture_t = (report_s - origin_ns) / 1e9, (picture_s - origin_ns) / 1e9
    report_y = np.array([share for _, share in reports])
    picture_y = np.array([share for _, share in pictures])
    grid = np.arange(-MAX_OFFSET_S, MAX_OFFSET_S, 1e-3)
    costs = [np.mean((np.interp(picture_t - offset, report_t, report_y) - picture_y) ** 2) for offset in grid]
    best = int(np.argmin(costs))
    return float(grid[best]) if costs[best] <= MAX_MISFIT else None
