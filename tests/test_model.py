from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.model import Box, HeadLimits, HeadReading

SIDES = st.floats(1e-3, 1e4)
PLACES = st.floats(-1e4, 1e4)


@given(PLACES, PLACES, SIDES, SIDES)
def test_the_centre_of_a_box_is_the_mean_of_its_corners(x: float, y: float, w: float, h: float) -> None:
    box = Box(x=x, y=y, w=w, h=h)
    for axis, middle in enumerate(box.centre):
        mean = sum(corner[axis] for corner in box.corners) / 4
        assert middle == pytest.approx(mean, abs=1e-6)


def test_the_corners_go_round_clockwise_from_the_top_left() -> None:
    assert Box(x=1, y=2, w=10, h=20).corners == ((1, 2), (11, 2), (11, 22), (1, 22))


@pytest.mark.parametrize("fields", [{"w": 0}, {"h": -1}, {"x": math.nan}, {"y": math.inf}, {"w": math.nan}])
def test_a_box_that_exists_is_legal(fields: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="box has"):
        Box(**{"x": 1.0, "y": 2.0, "w": 3.0, "h": 4.0, **fields})


@pytest.mark.parametrize("fields", [{"pan_deg": math.nan}, {"tilt_deg": math.inf}, {"zoom": -math.inf}])
def test_a_reading_that_exists_is_finite(fields: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="not finite"):
        HeadReading(**{"pan_deg": 0.0, "tilt_deg": 0.0, "zoom": 1.0, **fields})


def test_limits_hold_what_lies_on_them_and_nothing_beyond() -> None:
    limits = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-90, 20), zoom=(1, 9999))
    assert limits.contains(HeadReading(pan_deg=170, tilt_deg=20, zoom=9999))
    assert limits.contains(HeadReading(pan_deg=-170, tilt_deg=-90, zoom=1))
    for pan, tilt, zoom in ((170.1, 0, 1), (0, 20.1, 1), (0, 0, 0.5), (0, -90.1, 1), (0, 0, 10000)):
        assert not limits.contains(HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom))


def test_an_endless_head_has_no_end_of_pan() -> None:
    limits = HeadLimits(pan_deg=(-180, 180), tilt_deg=(-90, 20), zoom=(1, 9999), endless_pan=True)
    assert limits.contains(HeadReading(pan_deg=200, tilt_deg=0, zoom=1))
    assert not limits.contains(HeadReading(pan_deg=200, tilt_deg=21, zoom=1))
