"""Where a JPEG ends and what its header says, however cameras write it."""

from __future__ import annotations

import contextlib
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import DeviceGarbled
from ptzd.jpeg.walk import Walk, Walked, read_header, turned, whole_length

SHADES = np.add.outer(np.arange(40) * 5, np.arange(56) * 2).astype(np.uint8)


def encoded(width: int = 56, height: int = 40, *options: int) -> bytes:
    pixels = np.resize(SHADES, (height, width))
    return cv2.imencode(".jpg", pixels, list(options))[1].tobytes()


def with_orientation(jpeg: bytes, value: int, order: str = ">") -> bytes:
    mark = b"MM\0*" if order == ">" else b"II*\0"
    entries = struct.pack(order + "HHII", 0x010F, 2, 4, 0) + struct.pack(order + "HHIHH", 0x0112, 3, 1, value, 0)
    tiff = mark + struct.pack(order + "IH", 8, 2) + entries + bytes(4)
    body = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]


kinds = st.sampled_from(
    [
        (),
        (cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        (cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
        (cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 1),
    ]
)


@given(st.integers(1, 200), st.integers(1, 200), kinds)
def test_the_size_is_that_of_the_frame_header(width, height, options):
    assert read_header(encoded(width, height, *options)).size_px == (width, height)


@given(kinds, st.binary(max_size=200))
def test_what_follows_the_end_does_not_belong_to_the_picture(options, behind):
    jpeg = encoded(56, 40, *options)
    assert whole_length(jpeg + behind, len(jpeg) + len(behind)) == len(jpeg)


@given(kinds)
def test_an_older_picture_behind_the_present_one_is_not_taken_along(options):
    jpeg = encoded(56, 40, *options)
    old = encoded(120, 90)[300:]
    assert whole_length(jpeg + old, len(jpeg) + len(old)) == len(jpeg)


@given(kinds, st.data())
def test_a_picture_that_was_cut_off_has_no_length(options, data):
    jpeg = encoded(56, 40, *options)
    kept = data.draw(st.integers(0, len(jpeg) - 1))
    assert whole_length(jpeg[:kept], kept) is None
    assert whole_length(jpeg, kept) is None


@given(kinds, st.lists(st.integers(0, 4000), max_size=12))
def test_walking_on_gives_the_same_as_walking_at_once(options, stops):
    jpeg = encoded(56, 40, *options)
    walk = Walk()
    for used in [*sorted(stop % len(jpeg) for stop in stops if stop % len(jpeg) >= 2), len(jpeg)]:
        walked = walk.go(jpeg, used)
    assert (walked, walk.at, walk.size_px) == (Walked.WHOLE, len(jpeg), (56, 40))


@given(st.binary(max_size=300))
def test_noise_is_refused_or_has_some_size(noise):
    with contextlib.suppress(DeviceGarbled):
        assert read_header(noise).size_px >= (0, 0)
    assert whole_length(noise, len(noise)) is None or noise.startswith(b"\xff\xd8")


@pytest.mark.parametrize("fill", [1, 2, 7])
def test_fill_bytes_before_a_marker_are_passed_over(fill):
    jpeg = encoded()
    filled = jpeg[:2] + b"\xff" * fill + jpeg[2:-2] + b"\xff" * fill + jpeg[-2:]
    assert read_header(filled).size_px == (56, 40)
    assert whole_length(filled, len(filled)) == len(filled)


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_orientation_is_read_in_either_byte_order(order, orientation):
    assert read_header(with_orientation(encoded(), orientation, order)).orientation == orientation


@pytest.mark.parametrize("value", [0, 9, 65535])
def test_an_orientation_that_does_not_exist_is_none(value):
    assert read_header(with_orientation(encoded(), value)).orientation == 1


def test_the_advice_for_a_turned_camera_names_camera_and_orientation():
    assert turned("fisheye", 6).startswith("fisheye: its pictures carry EXIF orientation 6")


@pytest.mark.parametrize("data", [b"", b"\xff\xd8", b"\xff\xd8\xff\xd9", b"GIF89a" * 5])
def test_what_has_no_frame_header_is_named_by_its_first_bytes(data):
    with pytest.raises(DeviceGarbled, match="really JPEG"):
        read_header(data)
