"""Pixels as stored, and no pixel of a picture that lost something on its way."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import DeviceGarbled
from ptzd.jpeg.pixels import decode_bgr, decode_file, decode_file_bgr, decode_grey, encode_jpeg
from tests.jpeg.test_walk import with_orientation

RANDOM = np.random.default_rng(5)
COLOUR = cv2.resize(RANDOM.integers(0, 255, (30, 40, 3), np.uint8), (160, 120))
LARGE = cv2.imencode(".jpg", cv2.resize(RANDOM.integers(0, 255, (60, 80, 3), np.uint8), (640, 480)))[1].tobytes()
JPEG = cv2.imencode(".jpg", COLOUR)[1].tobytes()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_the_stored_pixels_come_out_whatever_exif_says(orientation):
    turned = with_orientation(JPEG, orientation)
    assert (decode_grey(turned) == decode_grey(JPEG)).all()
    assert (decode_bgr(turned) == decode_bgr(JPEG)).all()
    assert (decode_file(turned) == decode_grey(JPEG)).all()


@given(st.integers(1, 90), st.integers(1, 90), st.booleans())
def test_both_decoders_agree_with_opencv(width, height, grey):
    source = COLOUR[:height, :width, 0] if grey else COLOUR[:height, :width]
    data = np.frombuffer(encode_jpeg(np.ascontiguousarray(source)), np.uint8)
    assert (decode_grey(data.tobytes()) == cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)).all()
    assert (decode_bgr(data.tobytes()) == cv2.imdecode(data, cv2.IMREAD_COLOR)).all()


@given(st.floats(0.2, 0.8), st.floats(0.01, 0.15))
def test_a_picture_that_lost_its_middle_is_damaged(start, share):
    begin, end = int(len(LARGE) * start), int(len(LARGE) * (start + share))
    with pytest.raises(DeviceGarbled, match="damaged"):
        decode_grey(LARGE[:begin] + LARGE[end:])


@pytest.mark.parametrize("filling", [b"\0" * 5, b"\xff" * 4])
def test_filling_before_the_end_marker_is_no_damage(filling):
    assert (decode_grey(JPEG[:-2] + filling + JPEG[-2:]) == decode_grey(JPEG)).all()


@pytest.mark.parametrize("size", [(65500, 65500), (20000, 20000), (0, 480)])
def test_a_header_that_claims_too_much_is_refused_before_anything_is_decoded(size):
    at = JPEG.index(b"\xff\xc0")
    claims = JPEG[: at + 5] + struct.pack(">HH", size[1], size[0]) + JPEG[at + 9 :]
    for decode in (decode_grey, decode_bgr, decode_file):
        with pytest.raises(DeviceGarbled, match=f"{size[0]}×{size[1]} px"):
            decode(claims)


def test_a_png_that_claims_too_much_is_refused_too():
    png = cv2.imencode(".png", COLOUR)[1].tobytes()
    with pytest.raises(DeviceGarbled, match="65500×65500 px"):
        decode_file(png[:16] + struct.pack(">II", 65500, 65500) + png[24:])


def test_files_of_other_formats_are_read_as_stored():
    png = cv2.imencode(".png", COLOUR)[1].tobytes()
    grey = cv2.imencode(".png", COLOUR[..., 0])[1].tobytes()
    assert (decode_file(grey) == COLOUR[..., 0]).all()
    assert decode_file(png).shape == (120, 160)


@pytest.mark.parametrize("data", [b"", b"no picture", b"\x89PNG\r\n\x1a\n" + bytes(8) + b"\0\0\0\x08\0\0\0\x08"])
def test_what_is_no_picture_is_refused(data):
    with pytest.raises(DeviceGarbled):
        decode_file(data)


@pytest.mark.parametrize(
    ("suffix", "claim"),
    [
        (".png", lambda d: d[:16] + struct.pack(">II", 65500, 65500) + d[24:]),
        (".bmp", lambda d: d[:18] + struct.pack("<ii", 65500, -65500) + d[26:]),
        (".pgm", lambda d: d.replace(b"160 120", b"65500 65500", 1)),
        (".tiff", lambda d: _with_tiff_size(d, 65500)),
    ],
)
def test_other_formats_are_judged_by_their_header(suffix, claim):
    data = cv2.imencode(suffix, COLOUR[..., 0])[1].tobytes()
    assert (decode_file(data) == COLOUR[..., 0]).all()
    assert decode_file_bgr(data).shape == (120, 160, 3)
    for decode in (decode_file, decode_file_bgr):
        with pytest.raises(DeviceGarbled, match="65500×65500 px"):
            decode(claim(data))


def _with_tiff_size(data, side):
    order = "<" if data[:2] == b"II" else ">"
    changed = bytearray(data)
    (directory,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, directory)
    for at in range(directory + 2, directory + 2 + 12 * count, 12):
        if struct.unpack_from(order + "H", data, at)[0] in {0x0100, 0x0101}:
            struct.pack_into(order + "HII", changed, at + 2, 4, 1, side)
    return bytes(changed)
