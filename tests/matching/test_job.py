import dataclasses

import cv2
import numpy as np
import pytest

from ptzd.errors import DeviceGarbled, GeometryError
from ptzd.jpeg.pixels import decode_grey
from ptzd.matching.job import match
from ptzd.model import Box, Matcher

BOX = Box(x=300, y=220, w=24, h=24)


def jpeg(picture: np.ndarray) -> bytes:
    return cv2.imencode(".jpg", picture)[1].tobytes()


def test_decodes_grey_and_colour():
    picture = np.tile(np.arange(64, dtype=np.uint8) * 3, (48, 1))
    assert np.abs(decode_grey(jpeg(picture)).astype(int) - picture).max() <= 4
    assert decode_grey(jpeg(cv2.merge([picture] * 3))).shape == (48, 64)


@pytest.mark.parametrize("keep", [0, 1, 2, 20, 200, -1, -2])
def test_truncated_jpeg_is_refused(keep):
    whole = jpeg(np.random.default_rng(0).integers(0, 255, (48, 64), dtype=np.uint8))
    with pytest.raises(DeviceGarbled):
        decode_grey(whole[:keep])


def test_not_a_jpeg_is_refused():
    with pytest.raises(DeviceGarbled, match="start"):
        decode_grey(b"\x89PNG\r\n" + bytes(100))
    with pytest.raises(DeviceGarbled, match="no JPEG frame header"):
        decode_grey(b"\xff\xd8" + b"no picture at all" * 9 + b"\xff\xd9")


def test_trailing_zeros_of_a_driver_are_no_truncation():
    assert decode_grey(jpeg(np.full((16, 16), 80, np.uint8)) + bytes(7)).shape == (16, 16)


@pytest.mark.parametrize("matcher", list(Matcher))
def test_same_inputs_and_seed_give_the_same_result(world, matcher):
    inputs = world.inputs(BOX, world.aimed(BOX, (3.0, -2.0)), noise=3.0)
    first, second = (dataclasses.replace(match(inputs, matcher), elapsed_ms=0.0) for _ in range(2))
    assert first == second
    assert first.matcher is matcher
    assert first.seed == inputs.seed


def test_elapsed_time_is_told(world):
    assert match(world.inputs(BOX, world.aimed(BOX)), Matcher.SWEEP).elapsed_ms > 0


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("fisheye_grey", np.zeros((100, 100), np.uint8)),
        ("view_grey", np.zeros((100, 100), np.uint8)),
        ("inverse_range", (0.5, 0.1)),
        ("inverse_range", (0.0, np.inf)),
        ("inverse_range", (float("nan"), 1.0)),
        ("band_rad", -0.1),
        ("band_rad", 1.0),
    ],
)
def test_impossible_inputs_are_refused_by_name(world, field, value):
    inputs = world.inputs(BOX, world.aimed(BOX))
    with pytest.raises(GeometryError, match=field):
        dataclasses.replace(inputs, **{field: value})
