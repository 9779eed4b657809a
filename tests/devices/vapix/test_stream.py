from __future__ import annotations

import asyncio
from itertools import pairwise

import pytest
from aiohttp import web

from ptzd.config import Limits
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceGarbled, DeviceLost

VIDEO = "/axis-cgi/mjpg/video.cgi"


async def test_the_stream_is_asked_for_with_fixed_parameters(head, camera):
    assert [path for path in camera.seen if VIDEO in path][-1] == (
        f"{VIDEO}?camera=1&resolution=64x48&fps=25&compression=20"
    )


async def test_truncated_pictures_are_counted_and_never_given_out(camera, settings_for, clock, make_picture):
    whole = make_picture(7)
    camera.frame = lambda number: whole[: len(whole) // 2] if number % 3 == 1 else whole
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        await head.describe()
        pictures = head.pictures()
        found = [(await anext(pictures))[0] for _ in range(8)]
        await pictures.aclose()
    assert all(picture.jpeg == whole for picture in found)
    seqs = [picture.frame.seq for picture in found]
    assert not [seq for seq in seqs if seq % 3 == 1]
    assert [picture.lost_before for picture in found[1:]] == [b - a - 1 for a, b in pairwise(seqs)]


async def test_capture_times_are_arrival_less_latency(head):
    pictures = head.pictures()
    picture, _, _ = await anext(pictures)
    assert picture.t_arrival_ns - picture.frame.t_capture_ns == 10_000_000
    await pictures.aclose()


async def test_a_cut_stream_is_opened_again_without_anybody_noticing(head, camera):
    pictures = head.pictures()
    first, _, _ = await anext(pictures)
    cut = [True]

    def frame(number):
        if cut.pop() if cut else False:
            raise ConnectionError
        return first.jpeg

    camera.frame = frame
    streams = camera.streams
    seqs = [(await anext(pictures))[0].frame.seq for _ in range(5)]
    assert camera.streams == streams + 1
    assert seqs == sorted(set(seqs))
    await pictures.aclose()


async def test_a_stalled_stream_is_lost(camera, settings_for, clock):
    async def stall(_request):
        await asyncio.sleep(30)

    async with VapixHead(settings_for(camera, stall_s=1.0), Limits(), clock) as head:
        await head.describe()
        camera.faults[VIDEO] = stall
        camera.frame = lambda _number: (_ for _ in ()).throw(ConnectionError)
        with pytest.raises(DeviceLost, match=r"video\.cgi.*no (complete picture for 1 s|answer in time)"):
            async for _ in head.pictures():
                pass


async def test_an_overloaded_camera_has_its_rest(camera, settings_for, clock):
    async def full(_request):
        return web.Response(status=503, headers={"Retry-After": "9"})

    camera.faults[VIDEO] = full
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        with pytest.raises(DeviceLost, match=r"video\.cgi.*503"):
            await head.describe()
        seen = len(camera.seen)
        with pytest.raises(DeviceLost, match=r"stream overloaded \(503\); asked again in [89]\.\d s"):
            await head.describe()
        assert len(camera.seen) == seen


@pytest.mark.parametrize(
    ("response", "message"),
    [
        ({"text": "Error:\r\nresolution: invalid value\r\n"}, "got content type 'text/plain"),
        ({"body": b"\xff\xd8", "content_type": "image/jpeg"}, "got content type 'image/jpeg'"),
    ],
)
async def test_what_is_no_stream_is_said(camera, settings_for, clock, response, message):
    async def other(_request):
        return web.Response(**response)

    camera.faults[VIDEO] = other
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        with pytest.raises(DeviceGarbled, match=message):
            await head.describe()


async def test_pictures_of_another_size_are_refused(camera, settings_for, clock):
    async with VapixHead(settings_for(camera, size_px=(640, 480)), Limits(), clock) as head:
        with pytest.raises(DeviceGarbled, match=r"pictures of 64×48 px, not 640×480 px; set ptz\.size_px"):
            await head.describe()
