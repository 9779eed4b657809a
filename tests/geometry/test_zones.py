"""A zone drawn for one camera holds, on the other one's sphere, whatever is drawn over at any of its ranges."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.sphere import angle_between, bearing, normalise
from ptzd.geometry.zones import STEP_RAD, along, covers, drawn, of_bearings
from ptzd.model import ZoneKind

SQUARE = ((280.0, 200.0), (360.0, 200.0), (360.0, 280.0), (280.0, 280.0))
FAR = (0.0, 0.02)


@settings(max_examples=40)
@given(x=st.floats(281.0, 359.0), y=st.floats(201.0, 279.0), near=st.floats(0.5, 3.0), share=st.floats(0.0, 1.0))
def test_what_lies_behind_a_drawn_pixel_is_in_the_zone_at_every_range(make_rig, x, y, near, share):
    rig = make_rig()
    nearest, farthest = 1.0 / near, 1.0 / 40.0
    zone = drawn("window", ZoneKind.PRIVACY, SQUARE, (farthest, nearest), rig)
    inverse_range = farthest + share * (nearest - farthest)
    ray, _ = rig.fisheye.lift([x, y])
    seen = normalise(rig.head_from_fisheye_rotation @ ray + inverse_range * rig.head_from_fisheye_translation)
    assert zone.holds_ray(ray)
    assert min(float(outline.distance_rad(seen)) for outline in zone.head_outlines) <= STEP_RAD / 2 * 1.05


@settings(max_examples=40)
@given(pan=st.floats(0.11, 0.39), tilt=st.floats(-0.19, 0.09), near=st.floats(1.0, 5.0), share=st.floats(0.0, 1.0))
def test_what_lies_in_a_direction_of_the_head_is_in_the_zone_of_the_fisheye(make_rig, pan, tilt, near, share):
    rig = make_rig()
    corners = [(0.1, -0.2), (0.4, -0.2), (0.4, 0.1), (0.1, 0.1)]
    zone = of_bearings("street", ZoneKind.NO_GO, corners, (0.0, 1.0 / near), rig)
    direction = bearing(pan, tilt)
    place = direction - share / near * rig.head_from_fisheye_translation
    seen = normalise(place @ rig.head_from_fisheye_rotation)
    if covers(zone.head_outlines, direction[None])[0]:
        assert min(float(outline.distance_rad(seen)) for outline in zone.fisheye_outlines) <= STEP_RAD / 2 * 1.05


def test_a_zone_far_away_is_as_large_for_both(make_rig):
    rig = make_rig()
    zone = drawn("sun", ZoneKind.NO_GO, SQUARE, (0.0, 1e-6), rig)
    assert len(zone.head_outlines) == 2
    turned = zone.fisheye_outlines[0].corners @ rig.head_from_fisheye_rotation.T
    np.testing.assert_allclose(zone.head_outlines[0].corners, turned, atol=1e-9)


def test_points_along_the_border_are_no_further_apart_than_asked(make_rig):
    zone = drawn("window", ZoneKind.NO_GO, SQUARE, FAR, make_rig())
    points = along(zone.fisheye_outlines, 0.01)
    assert float(angle_between(points, np.roll(points, -1, axis=0)).max()) <= 0.0101


@pytest.mark.parametrize(
    ("corners", "says"),
    [
        (((280.0, 200.0), (360.0, 280.0), (360.0, 200.0), (280.0, 280.0)), "crosses"),
        (((280.0, 200.0), (99999.0, 200.0), (300.0, 280.0)), "outside the fisheye's image circle"),
        (((280.0, 200.0), (360.0, 280.0)), "three corners or more, got 2"),
        (((280.0, 200.0), (360.0, 200.0), (320.0, 200.0)), "one line"),
    ],
)
def test_what_cannot_be_a_zone_is_refused(make_rig, corners, says):
    with pytest.raises(GeometryError, match=says):
        drawn("zone", ZoneKind.NO_GO, corners, FAR, make_rig())


def test_a_tilt_beyond_the_pole_is_refused(make_rig):
    with pytest.raises(GeometryError, match="90"):
        of_bearings("zone", ZoneKind.IGNORE, [(0.0, 0.0), (0.2, 0.0), (0.1, math.pi)], FAR, make_rig())


def test_what_is_as_near_as_the_other_camera_says_at_which_range(make_rig):
    near_head = [(-2.0, -0.5), (-1.4, -0.5), (-1.4, 0.3), (-2.0, 0.3)]
    with pytest.raises(GeometryError, match=r"seen from the fisheye, at range .*range_m"):
        of_bearings("mast", ZoneKind.NO_GO, near_head, (0.0, 2.0), make_rig())
