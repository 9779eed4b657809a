from __future__ import annotations

import asyncio
import threading
from contextlib import aclosing

import cv2
import msgspec
import numpy as np
import pytest

from ptzd.devices import v4l2
from ptzd.devices.v4l2 import V4l2Fisheye, encode_raw
from ptzd.errors import DeviceLost, DeviceRefused


@pytest.fixture
def fisheye(kernel, settings, clock):
    return V4l2Fisheye(settings, clock, open_device=kernel.open)


async def shoot_and_take(pictures, kernel, data):
    taking = asyncio.ensure_future(anext(pictures))
    await asyncio.to_thread(kernel.started.acquire)
    kernel.device.shoot(data)
    return await taking


async def test_pictures_carry_the_cameras_bytes_and_the_daemons_time(fisheye, kernel, jpeg, clock):
    async with aclosing(fisheye.pictures()) as pictures:
        picture = await shoot_and_take(pictures, kernel, jpeg(1))
        assert picture.jpeg == jpeg(1)
        assert picture.frame.seq == 0
        assert picture.frame.t_capture_ns == clock.from_monotonic_ns(0)
        assert picture.t_arrival_ns <= clock.now_ns()
        kernel.device.shoot(jpeg(2))
        assert (await anext(pictures)).jpeg == jpeg(2)


async def test_a_slow_reader_gets_the_newest_and_is_told_what_it_missed(fisheye, kernel, jpeg):
    async with aclosing(fisheye.pictures()) as pictures:
        await shoot_and_take(pictures, kernel, jpeg(0))
        for number in range(1, 6):
            kernel.device.shoot(jpeg(number))
            kernel.emptied.clear()
            await kernel.emptied.wait()
        picture = await anext(pictures)
        assert (picture.jpeg, picture.frame.seq, picture.lost_before) == (jpeg(5), 5, 4)
    assert (fisheye.tally.delivered, fisheye.tally.superseded, fisheye.tally.missing) == (2, 4, 0)


async def test_damaged_pictures_are_gaps(fisheye, kernel, jpeg):
    async with aclosing(fisheye.pictures()) as pictures:
        await shoot_and_take(pictures, kernel, jpeg(0))
        kernel.device.shoot(jpeg(1)[:60])
        kernel.device.shoot(jpeg(2))
        picture = await anext(pictures)
        assert (picture.frame.seq, picture.lost_before) == (2, 1)


async def test_silence_is_a_loss_and_says_what_came_instead(kernel, settings, clock, jpeg):
    fisheye = V4l2Fisheye(msgspec.structs.replace(settings, stall_s=0.05), clock, open_device=kernel.open)
    async with fisheye:
        taking = asyncio.ensure_future(anext(fisheye.pictures()))
        await asyncio.to_thread(kernel.started.acquire)
        kernel.device.shoot(jpeg(0)[:60])
        with pytest.raises(DeviceLost, match=r"no usable picture for 0\.05 s \(.*1 cut off\); check cable"):
            await taking
        assert kernel.open_count == 0


async def test_an_unplugged_camera_is_told_once_then_awaited(fisheye, kernel, jpeg, monkeypatch):
    monkeypatch.setattr(v4l2, "FIRST_WAIT_S", 0.001)
    monkeypatch.setattr(v4l2, "LONGEST_WAIT_S", 0.004)
    pictures = fisheye.pictures()
    await shoot_and_take(pictures, kernel, jpeg(0))
    kernel.unplug()
    with pytest.raises(DeviceLost, match="No such device"):
        await anext(pictures)
    assert kernel.open_count == 0, "the old handle keeps the old number busy"
    async with aclosing(fisheye.pictures()) as again:
        taking = asyncio.ensure_future(anext(again))
        await asyncio.sleep(0.02)
        assert not taking.done()
        kernel.plugged = True
        await asyncio.to_thread(kernel.started.acquire)
        kernel.device.shoot(jpeg(7))
        picture = await taking
        assert (picture.jpeg, picture.frame.seq, picture.lost_before) == (jpeg(7), 1, 0)
        kernel.unplug()
        with pytest.raises(DeviceLost):
            await anext(again)


async def test_a_camera_that_was_never_there_is_told_once(fisheye, kernel):
    kernel.plugged = False
    with pytest.raises(DeviceLost, match="plug it in"):
        await anext(fisheye.pictures())
    async with aclosing(fisheye.pictures()) as pictures:
        waiting = asyncio.ensure_future(anext(pictures))
        await asyncio.sleep(0.02)
        assert not waiting.done()
        waiting.cancel()
        await asyncio.gather(waiting, return_exceptions=True)


async def test_what_the_driver_refuses_is_not_called_a_loss(kernel, settings, clock):
    wrong = msgspec.structs.replace(settings, size_px=(9, 9))
    with pytest.raises(DeviceRefused, match="asked for MJPG 9x9"):
        await anext(V4l2Fisheye(wrong, clock, open_device=kernel.open).pictures())


async def test_what_is_not_granted_is_one_line_and_said_once(kernel, settings, clock, jpeg, caplog):
    fisheye = V4l2Fisheye(
        msgspec.structs.replace(settings, fps=90.0, controls={"gain": 1}), clock, open_device=kernel.open
    )
    for _ in range(2):
        async with aclosing(fisheye.pictures()) as pictures:
            await shoot_and_take(pictures, kernel, jpeg(0))
    (line,) = caplog.messages
    assert line.startswith(settings.device)
    assert "fps: asked for 90, got 30; gain: no such control" in line


@pytest.mark.parametrize("form", ["YUYV", "UYVY", "GREY"])
async def test_raw_pictures_are_encoded_without_their_padding(kernel, settings, clock, form):
    kernel.padding = 32
    kernel.sizes = {form: [(64, 48)]}
    raw = msgspec.structs.replace(settings, format=form)
    gradient = np.tile(np.arange(64, dtype=np.uint8) * 3 + 20, (48, 1))
    colourless = np.full_like(gradient, 128)
    pairs = [colourless, gradient] if form == "UYVY" else [gradient, colourless]
    row = gradient if form == "GREY" else np.dstack(pairs).reshape(48, 128)
    padded = np.hstack([row, np.zeros((48, 32), np.uint8)])
    fisheye = V4l2Fisheye(raw, clock, open_device=kernel.open)
    async with aclosing(fisheye.pictures()) as pictures:
        picture = await shoot_and_take(pictures, kernel, padded.tobytes())
    decoded = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    expected = gradient if form == "GREY" else (gradient.astype(float) - 16) * 255 / 219
    assert decoded.shape == (48, 64)
    assert np.abs(decoded - expected).mean() < 2


async def test_raw_pictures_are_encoded_once_and_beside_the_loop(kernel, settings, clock, monkeypatch):
    threads = []

    def encode(data, layout):
        threads.append(threading.current_thread())
        return encode_raw(data, layout)

    monkeypatch.setattr(v4l2, "encode_raw", encode)
    fisheye = V4l2Fisheye(msgspec.structs.replace(settings, format="GREY"), clock, open_device=kernel.open)
    async with aclosing(fisheye.pictures()) as pictures:
        await shoot_and_take(pictures, kernel, bytes(64 * 48))
    assert len(threads) == 1
    assert threading.main_thread() not in threads


async def test_a_reader_that_leaves_while_the_camera_opens_leaves_nothing_open(kernel, settings, clock):
    opening, go_on = threading.Event(), threading.Event()

    def slow_open(path):
        opening.set()
        go_on.wait(10)
        return kernel.open(path)

    taking = asyncio.ensure_future(anext(V4l2Fisheye(settings, clock, open_device=slow_open).pictures()))
    await asyncio.to_thread(opening.wait)
    taking.cancel()
    go_on.set()
    with pytest.raises(asyncio.CancelledError):
        await taking
    assert len(kernel.devices) == 1
    assert kernel.open_count == 0


async def test_a_new_series_ends_the_one_before(fisheye, kernel, jpeg):
    async with fisheye:
        abandoned = fisheye.pictures()
        await shoot_and_take(abandoned, kernel, jpeg(0))
        picture = await shoot_and_take(fisheye.pictures(), kernel, jpeg(1))
        assert (picture.jpeg, picture.frame.seq, kernel.open_count) == (jpeg(1), 1, 1)
        with pytest.raises(StopAsyncIteration):
            await anext(abandoned)


async def test_leaving_closes_the_camera(fisheye, kernel, jpeg):
    async with fisheye:
        await shoot_and_take(fisheye.pictures(), kernel, jpeg(0))
        assert kernel.open_count == 1
    assert kernel.open_count == 0
