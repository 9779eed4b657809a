from __future__ import annotations

import asyncio

import pytest
from aiohttp import web

from ptzd.config import HttpSource
from ptzd.devices.http_fisheye import HttpFisheye
from ptzd.devices.mjpeg import MultipartParser
from ptzd.errors import DeviceGarbled, DeviceLost, DeviceRefused

PATH = "/fisheye.mjpg"


@pytest.fixture
def source_of(camera, clock, password_file):
    def make(**changes):
        values = {
            "url": f"{camera.url}{PATH}?token=geheim", "user": "ptzd", "password_file": str(password_file),
            "latency_s": 0.02, "stall_s": 5.0,
        }  # fmt: skip
        return HttpFisheye(HttpSource(**(values | changes)), clock, jitter=lambda: 0.9)

    return make


async def test_pictures_come_untouched_with_number_and_time(source_of, camera, make_picture):
    camera.frame = make_picture
    async with source_of() as source:
        pictures = source.pictures()
        found = [await anext(pictures) for _ in range(4)]
        await pictures.aclose()
    for picture in found:
        assert picture.jpeg == make_picture(picture.frame.seq)
        assert picture.t_arrival_ns - picture.frame.t_capture_ns == 20_000_000
    assert [picture.frame.seq for picture in found] == [0, 1, 2, 3]


async def test_a_slow_reader_gets_the_newest_and_hears_what_it_missed(source_of, camera, eventually):
    camera.fps = 200
    async with source_of() as source:
        pictures = source.pictures()
        first = await anext(pictures)
        await eventually(lambda: camera.sent_pictures > 20)
        second = await anext(pictures)
        sent = camera.sent_pictures
        await pictures.aclose()
    assert second.frame.seq >= sent - 3
    assert second.lost_before == second.frame.seq - first.frame.seq - 1 > 3


async def test_damaged_pictures_are_counted_as_lost(source_of, camera, make_picture):
    whole = make_picture()
    camera.frame = lambda number: whole[:-20] if number in {1, 2} else whole
    async with source_of() as source:
        pictures = source.pictures()
        found = [await anext(pictures) for _ in range(2)]
        await pictures.aclose()
    assert [(picture.frame.seq, picture.lost_before) for picture in found] == [(0, 0), (3, 2)]


async def test_a_lost_camera_is_said_once_and_then_waited_for(source_of, camera, serve):
    port = int(camera.url.rpartition(":")[2])
    async with source_of() as source:
        pictures = source.pictures()
        before = await anext(pictures)
        await camera.down()
        with pytest.raises(DeviceLost, match=r"/fisheye\.mjpg: ") as lost:
            async for _ in pictures:
                pass
        assert "geheim" not in str(lost.value)
        waiting = asyncio.ensure_future(anext(source.pictures()))
        await asyncio.sleep(0.4)
        assert not waiting.done()
        await serve(camera, port)
        assert (await waiting).frame.seq > before.frame.seq


@pytest.mark.parametrize("silent", ["before", "between"])
async def test_a_stall_is_a_loss(source_of, camera, make_picture, silent):
    async def stalled(request):
        response = web.StreamResponse(headers={"Content-Type": "multipart/x-mixed-replace; boundary=b"})
        await response.prepare(request)
        while True:
            await response.write(b"--b\r\n" if silent == "between" else b"")
            await asyncio.sleep(0.02)

    camera.faults[PATH] = stalled
    async with source_of(stall_s=0.4) as source:
        with pytest.raises(DeviceLost, match=r"no (complete picture|answer)"):
            await anext(source.pictures())


async def test_a_wrong_password_is_one_line_and_no_hammering(source_of, camera, tmp_path):
    (tmp_path / "wrong").write_text("guess")
    async with source_of(password_file=str(tmp_path / "wrong")) as source:
        with pytest.raises(DeviceRefused, match=r"correct fisheye\.user or the password's file"):
            await anext(source.pictures())
        waiting = asyncio.ensure_future(anext(source.pictures()))
        await asyncio.sleep(0.5)
        assert camera.refused == 1
        (tmp_path / "wrong").write_bytes((tmp_path / "password").read_bytes())
        assert (await waiting).frame.seq == 0


async def test_without_a_user_a_camera_that_asks_for_one_names_the_setting(source_of):
    async with source_of(user=None) as source:
        with pytest.raises(DeviceRefused, match=r"set fisheye\.user"):
            await anext(source.pictures())


async def test_an_open_camera_needs_no_user(source_of, camera):
    camera.faults[PATH] = camera.stream
    async with source_of(user=None) as source:
        pictures = source.pictures()
        assert (await anext(pictures)).frame.seq == 0
        await pictures.aclose()


async def test_a_page_is_no_stream(source_of, camera):
    async def page(_request):
        return web.Response(text="<html>", content_type="text/html")

    camera.faults[PATH] = page
    async with source_of() as source:
        with pytest.raises(DeviceGarbled, match="content type 'text/html"):
            await anext(source.pictures())


@pytest.mark.parametrize("piece", [b"\xff\xd8", b"--b\r\n\xff\xd8\xff\xe0\x00\x02\xff\xd9", "whole"])
async def test_a_flood_of_tiny_parts_gives_the_loop_its_turn_and_is_told(
    source_of, camera, monkeypatch, make_picture, piece
):
    """Counted in turns of the loop, not in seconds."""
    piece = make_picture(0, (8, 8)) if piece == "whole" else piece
    block = piece * (65536 // len(piece))

    async def flood(request):
        response = web.StreamResponse(headers={"Content-Type": "multipart/x-mixed-replace; boundary=b"})
        await response.prepare(request)
        while True:
            await response.write(block)

    turns, taken = [0], []
    loop = asyncio.get_running_loop()

    def turn() -> None:
        turns[0] += 1
        taken.append(0)
        ticking[0] = loop.call_soon(turn)

    def count(_self, _jpeg, _arrival_ns) -> None:
        taken[-1] += 1

    ticking = [loop.call_soon(turn)]
    camera.faults[PATH] = flood
    monkeypatch.setattr(HttpFisheye, "_take", count)
    async with source_of() as source:
        with pytest.raises(DeviceGarbled, match=r"/fisheye\.mjpg: more than 2,000 .* within a second"):
            await anext(source.pictures())
    ticking[0].cancel()
    assert 0 < max(taken) <= 32
    assert sum(taken) <= 2000


async def test_a_picture_of_tiny_segments_alone_gives_the_loop_its_turn(source_of, camera, monkeypatch):
    """One part without an end, whose markers are walked one by one."""

    async def endless(request):
        response = web.StreamResponse(headers={"Content-Type": "multipart/x-mixed-replace; boundary=b"})
        await response.prepare(request)
        await response.write(b"\xff\xd8")
        while True:
            await response.write(b"\xff\xe0\x00\x02" * 16384)

    turns, walked = [0], []
    loop = asyncio.get_running_loop()

    def turn() -> None:
        turns[0] += 1
        ticking[0] = loop.call_soon(turn)

    def feed(self, data, feed=MultipartParser.feed):
        walked.append((turns[0], len(data)))
        return feed(self, data)

    ticking = [loop.call_soon(turn)]
    camera.faults[PATH] = endless
    monkeypatch.setattr(MultipartParser, "feed", feed)
    async with source_of(stall_s=0.4) as source:
        with pytest.raises(DeviceLost, match="no complete picture"):
            await anext(source.pictures())
    ticking[0].cancel()
    assert sum(size for _, size in walked) > 65536
    assert max(size for _, size in walked) <= 16384
    assert len({at for at, _ in walked}) == len(walked), "not more than one step in a turn"
