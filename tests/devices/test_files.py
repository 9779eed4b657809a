from __future__ import annotations

import asyncio
from contextlib import aclosing

import cv2
import numpy as np
import pytest

from ptzd.config import FilesSource
from ptzd.devices import files
from ptzd.devices.files import FilesFisheye, picture_names, read_picture
from ptzd.errors import DeviceGarbled, DeviceLost


class CountingClock:
    def __init__(self):
        self.ns = 0

    def now_ns(self):
        self.ns += 1
        return self.ns

    def from_monotonic_ns(self, monotonic_ns):
        raise AssertionError(f"a file has no driver's stamp: {monotonic_ns}")


def encoded(number, suffix=".jpg"):
    return cv2.imencode(suffix, np.full((24, 32, 3), number, np.uint8))[1].tobytes()


@pytest.fixture
def folder(tmp_path):
    for number, name in enumerate(("b.jpg", "a.JPEG", "c.jpg")):
        (tmp_path / name).write_bytes(encoded(number * 40))
    (tmp_path / "notes.txt").write_text("not a picture")
    return tmp_path


@pytest.fixture
def show(folder):
    def make(**settings):
        return FilesFisheye(FilesSource(path=str(folder), **({"fps": 1000.0} | settings)), CountingClock())

    return make


async def take(fisheye, count):
    async with aclosing(fisheye.pictures()) as pictures:
        return [await anext(pictures) for _ in range(count)]


async def test_pictures_come_untouched_in_the_order_of_their_names_again_and_again(show, folder):
    taken = await take(show(), 7)
    names = ["a.JPEG", "b.jpg", "c.jpg"] * 2 + ["a.JPEG"]
    assert [picture.jpeg for picture in taken] == [(folder / name).read_bytes() for name in names]
    assert [picture.frame.seq for picture in taken] == list(range(7))
    stamps = [picture.frame.t_capture_ns for picture in taken]
    assert stamps == sorted(set(stamps))


async def test_a_folder_that_is_not_looped_ends_once_and_goes_on_when_it_grows(show, folder, monkeypatch):
    monkeypatch.setattr(files, "LOOK_AGAIN_S", 0.001)
    fisheye = show(loop=False)
    with pytest.raises(DeviceLost, match="the folder is at its end"):
        await take(fisheye, 4)
    async with aclosing(fisheye.pictures()) as pictures:
        waiting = asyncio.ensure_future(anext(pictures))
        await asyncio.sleep(0.02)
        assert not waiting.done()
        (folder / "d.jpg").write_bytes(encoded(200))
        picture = await waiting
    assert (picture.jpeg, picture.frame.seq) == (encoded(200), 3)


async def test_png_is_encoded_close_to_what_it_was(show, folder):
    (folder / "0.png").write_bytes(encoded(123, ".png"))
    (picture,) = await take(show(), 1)
    decoded = cv2.imdecode(np.frombuffer(picture.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture.jpeg[:2] == b"\xff\xd8"
    assert np.abs(decoded.astype(int) - 123).max() <= 2


@pytest.mark.parametrize(("name", "data"), [("aa.jpg", encoded(1)[:-9]), ("aa.png", b"no"), ("aa.png", b"")])
async def test_a_broken_file_is_passed_over_counted_and_told(show, folder, caplog, name, data):
    (folder / name).write_bytes(data)
    taken = await take(show(), 2)
    assert [(picture.frame.seq, picture.lost_before) for picture in taken] == [(0, 0), (2, 1)]
    assert str(folder / name) in caplog.text


async def test_nothing_but_broken_files_is_a_loss(tmp_path):
    (tmp_path / "a.jpg").write_bytes(b"no")
    fisheye = FilesFisheye(FilesSource(path=str(tmp_path), fps=1000.0), CountingClock())
    with pytest.raises(DeviceLost, match="none of the 1 pictures is whole"):
        await take(fisheye, 1)


@pytest.mark.parametrize(("make", "words"), [(False, "no such folder; set fisheye.path"), (True, "put .jpg or .png")])
async def test_a_folder_without_pictures_is_a_loss_until_there_are_some(tmp_path, monkeypatch, make, words):
    monkeypatch.setattr(files, "LOOK_AGAIN_S", 0.001)
    folder = tmp_path / "pictures"
    if make:
        folder.mkdir()
    fisheye = FilesFisheye(FilesSource(path=str(folder), fps=1000.0), CountingClock())
    with pytest.raises(DeviceLost, match=words):
        await take(fisheye, 1)
    folder.mkdir(exist_ok=True)
    (folder / "a.jpg").write_bytes(encoded(1))
    (picture,) = await take(fisheye, 1)
    assert picture.jpeg == encoded(1)


async def test_the_show_keeps_its_rate(show):
    loop = asyncio.get_running_loop()
    begin_s = loop.time()
    await take(show(fps=100.0), 6)
    assert loop.time() - begin_s >= 5 / 100


async def test_a_slow_reader_misses_nothing(show, folder):
    async with aclosing(show().pictures()) as pictures:
        first = await anext(pictures)
        await asyncio.sleep(0.01)
        second = await anext(pictures)
    assert [first.jpeg, second.jpeg] == [(folder / name).read_bytes() for name in ("a.JPEG", "b.jpg")]


async def test_leaving_ends_the_show(show):
    async with show() as fisheye:
        pictures = fisheye.pictures()
        await anext(pictures)
    with pytest.raises(StopAsyncIteration):
        await anext(pictures)


def test_a_file_is_not_a_folder(tmp_path):
    (tmp_path / "a.jpg").touch()
    with pytest.raises(DeviceLost, match="no such folder"):
        picture_names(tmp_path / "a.jpg")


def test_a_picture_that_vanished_is_lost_and_one_that_is_none_is_garbled(tmp_path):
    with pytest.raises(DeviceLost, match="No such file"):
        read_picture(tmp_path / "a.jpg")
    (tmp_path / "a.jpg").write_bytes(b"\xff\xd8 cut")
    with pytest.raises(DeviceGarbled, match="not a whole JPEG"):
        read_picture(tmp_path / "a.jpg")
