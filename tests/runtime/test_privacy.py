"""The cameras as the daemon sees them: whatever comes of a picture, its private part came before anything else."""

from __future__ import annotations

import asyncio
import math
from dataclasses import replace

import numpy as np
import pytest

from ptzd.geometry.zones import Zone, of_bearings
from ptzd.jpeg.pixels import decode_bgr, encode_jpeg
from ptzd.model import FrameRef, HeadReading, Motion, ViewRef, ZoneKind
from ptzd.ports import HeadPoll, Picture
from ptzd.runtime import privacy
from ptzd.runtime.blackening import fisheye_mask
from ptzd.runtime.privacy import PrivateFisheye, PrivateHead

AT = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
SECOND = 1_000_000_000
GREY = encode_jpeg(np.full((480, 640, 3), 200, np.uint8))


@pytest.fixture
def zone(rig) -> Zone:
    """Five degrees to the right of the middle."""
    corners = [(math.radians(p), math.radians(t)) for p, t in ((8, -2), (12, -2), (12, 2), (8, 2))]
    return of_bearings("window", ZoneKind.PRIVACY, corners, (0.0, 1e-6), rig)


class Camera:
    """Plays what a test gives it."""

    def __init__(self) -> None:
        self.reports: asyncio.Queue[HeadPoll] = asyncio.Queue()
        self.stream: asyncio.Queue[tuple[Picture, HeadReading, Motion]] = asyncio.Queue()
        self.at_rest: list[tuple[Picture, ViewRef]] = []
        self.asked: list[int] = []

    async def polls(self):
        while True:
            yield await self.reports.get()

    async def pictures(self):
        while True:
            yield await self.stream.get()

    async def grab(self, not_before_ns: int):
        self.asked.append(not_before_ns)
        return next(found for found in self.at_rest if found[0].frame.t_capture_ns >= not_before_ns)

    def report(self, t_s: float, reading: HeadReading = AT, motion: Motion = Motion.STABLE) -> None:
        self.reports.put_nowait(HeadPoll(reading=reading, t_ns=round(t_s * SECOND), motion=motion))

    def show(self, t_s: float, reading: HeadReading = AT, motion: Motion = Motion.STABLE) -> Picture:
        picture = Picture(
            frame=FrameRef(seq=round(t_s * 100), t_capture_ns=round(t_s * SECOND)),
            t_arrival_ns=round((t_s + 0.1) * SECOND),
            jpeg=GREY,
            exposed_after_ns=round((t_s - 0.05) * SECOND),
        )
        self.stream.put_nowait((picture, reading, motion))
        return picture


@pytest.fixture
async def seen(rig, zone, monkeypatch):
    """A camera, and its pictures as the daemon gets them."""
    monkeypatch.setattr(privacy, "REPORT_WITHIN_S", 5.0)
    camera = Camera()
    head = PrivateHead(camera, rig, (zone,))
    shown: asyncio.Queue[Picture] = asyncio.Queue()

    async def follow_polls() -> None:
        async for _ in head.polls():
            pass

    async def follow_pictures() -> None:
        async for picture, _, _ in head.pictures():
            shown.put_nowait(picture)

    tasks = [asyncio.create_task(work()) for work in (follow_polls, follow_pictures)]
    yield camera, head, shown
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def black(picture: Picture) -> float:
    """Share of a picture that is black."""
    return float((decode_bgr(picture.jpeg).max(axis=-1) < 40).mean())


async def test_at_rest_little_more_than_the_zone_is_black(seen) -> None:
    camera, _, shown = seen
    for t_s in (9.7, 9.8, 9.9, 10.0, 10.1):
        camera.report(t_s)
    camera.show(10.0)
    picture = await shown.get()
    assert 0.001 < black(picture) < 0.03
    assert decode_bgr(picture.jpeg)[240, 417].max() < 40, "the middle of the zone"


async def test_a_picture_waits_for_a_report_from_after_its_exposure(seen) -> None:
    camera, _, shown = seen
    for t_s in (9.7, 9.8, 9.9):
        camera.report(t_s)
    camera.show(10.0)
    with pytest.raises(TimeoutError):
        await asyncio.wait_for(shown.get(), 0.2)
    camera.report(10.1, replace(AT, pan_deg=6.0), Motion.MOVING)
    assert black(await shown.get()) > 0.3, "the head had begun to move"


async def test_in_motion_much_more_is_black_and_far_from_the_zone_nothing(seen) -> None:
    camera, _, shown = seen
    for step in range(5):
        camera.report(9.7 + step / 10, replace(AT, pan_deg=3.0 * step), Motion.MOVING)
    camera.show(10.0, replace(AT, pan_deg=9.0), Motion.MOVING)
    assert black(await shown.get()) > 0.3
    far = replace(AT, pan_deg=120.0)
    picture = camera.show(11.0, far, Motion.MOVING)
    assert (await shown.get()).jpeg == picture.jpeg


async def test_without_a_report_nothing_is_shown(seen, monkeypatch) -> None:
    monkeypatch.setattr(privacy, "REPORT_WITHIN_S", 0.05)
    camera, _, shown = seen
    camera.show(10.0)
    assert black(await shown.get()) == 1.0


async def test_a_picture_that_is_grabbed_is_the_one_that_the_log_has(seen) -> None:
    camera, head, shown = seen
    for t_s in (9.7, 9.8, 9.9, 10.0, 10.1):
        camera.report(t_s)
    picture = camera.show(10.0)
    streamed = await shown.get()
    view = ViewRef(frame=picture.frame, reading=replace(AT, pan_deg=0.01), sigma_deg=0.05)
    camera.at_rest = [(picture, view)]
    grabbed, found = await head.grab(9 * SECOND)
    assert grabbed.jpeg == streamed.jpeg
    assert found is view


async def test_one_that_went_out_with_more_black_is_not_grabbed_but_the_next_is(seen) -> None:
    camera, head, shown = seen
    for t_s in (9.7, 9.8, 9.9, 10.0, 10.1):
        camera.report(t_s)
    early = camera.show(10.0, motion=Motion.SETTLING)
    late = replace(GREY_AT, frame=FrameRef(seq=9, t_capture_ns=11 * SECOND))
    assert black(await shown.get()) > 0.1
    camera.at_rest = [(one, ViewRef(frame=one.frame, reading=AT, sigma_deg=0.05)) for one in (early, late)]
    grabbed, view = await head.grab(9 * SECOND)
    assert view.frame == late.frame
    assert black(grabbed) < 0.03
    assert camera.asked == [9 * SECOND, 10 * SECOND + 1]


GREY_AT = Picture(frame=FrameRef(seq=1, t_capture_ns=10 * SECOND), t_arrival_ns=10 * SECOND, jpeg=GREY)


async def test_the_fisheyes_pictures_come_black_where_the_zone_is(rig, zone) -> None:
    class Source:
        async def pictures(self):
            yield GREY_AT

    mask = fisheye_mask(rig, (zone,))
    (picture,) = [picture async for picture in PrivateFisheye(Source(), mask).pictures()]
    dark = decode_bgr(picture.jpeg).max(axis=-1) < 40
    assert dark[mask].mean() > 0.99
    assert dark[~mask].mean() < 0.01
    assert picture.frame == GREY_AT.frame
