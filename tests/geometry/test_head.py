import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.sphere import angle_between, bearing, rotation_from_rotvec
from ptzd.model import HeadReading

AXES = st.builds(Axis, sign=st.sampled_from([-1, 1]), scale=st.floats(0.9, 1.1), offset_rad=st.floats(-3.0, 3.0))
SMALL = st.floats(-0.2, 0.2)
HEADS = st.builds(HeadModel, pan=AXES, tilt=AXES, camera_rotvec_rad=st.tuples(SMALL, SMALL, st.floats(-3.0, 3.0)))
PAN, TILT = st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5)


@given(AXES, st.floats(-180.0, 180.0))
def test_the_written_convention(axis, reported):
    assert axis.angle_rad(reported) == pytest.approx(axis.sign * axis.scale * math.radians(reported) + axis.offset_rad)
    assert axis.vapix_deg(axis.angle_rad(reported)) == pytest.approx(reported, abs=1e-9)


@given(HEADS, PAN, TILT)
def test_readings_come_back(head, pan, tilt):
    reading = head.vapix_from_pan_tilt(pan, tilt, 7.0)
    again = head.pan_tilt_from_vapix(reading)
    assert math.cos(again[0] - pan) == pytest.approx(1.0, abs=1e-12)
    assert again[1] == pytest.approx(tilt, abs=1e-12)
    assert reading.zoom == 7.0
    assert abs(reading.pan_deg) <= 180.0 / head.pan.scale + 1e-9


@given(AXES, AXES, PAN, TILT)
def test_without_misalignment_the_axis_is_the_bearing(pan_axis, tilt_axis, pan, tilt):
    head = HeadModel(pan=pan_axis, tilt=tilt_axis)
    assert head.head_from_camera(pan, tilt) @ [0, 0, 1] == pytest.approx(bearing(pan, tilt), abs=1e-14)
    assert math.cos(head.aim(bearing(pan, tilt))[0] - pan) == pytest.approx(1.0, abs=1e-9)


@given(HEADS, PAN, st.floats(-1.2, 1.2))
def test_aim_points_the_misaligned_axis(head, pan, tilt):
    target = bearing(pan, tilt)
    pose = head.aim(3.0 * target)
    assert angle_between(head.head_from_camera(*pose) @ [0, 0, 1], target) < 1e-9
    assert abs(pose[0] - pan) < 1.0 or abs(abs(pose[0] - pan) - 2 * math.pi) < 1.0


@given(HEADS, st.sampled_from([-1.0, 1.0]))
def test_near_a_pole_the_nearest_pose_is_given(head, sign):
    axis_x = abs(rotation_from_rotvec(head.camera_rotvec_rad)[0, 2])
    for target in ([0.0, sign, 0.0], [1e-5, sign, 2e-5]):
        reached = head.head_from_camera(*head.aim(target)) @ [0, 0, 1]
        assert angle_between(reached, target) <= math.asin(axis_x) + 1e-7


@given(HEADS, st.floats(-3.0, 3.0))
def test_turning_the_target_turns_the_pan(head, turn):
    before, after = head.aim(bearing(0.3, 0.4)), head.aim(bearing(0.3 + turn, 0.4))
    assert after[1] == pytest.approx(before[1], abs=1e-12)
    assert math.cos(after[0] - before[0] - turn) == pytest.approx(1.0, abs=1e-12)


def test_many_bearings_at_once_are_each_the_same():
    head = HeadModel(pan=Axis(), tilt=Axis(), camera_rotvec_rad=(0.02, -0.03, 0.5))
    directions = bearing([0.1, 2.0, -3.0], [0.2, -0.5, 1.0])
    pans, tilts = head.aim_all(directions)
    assert [head.aim(d) for d in directions] == list(zip(pans.tolist(), tilts.tolist(), strict=True))


def test_a_reversed_axis_turns_the_other_way():
    head = HeadModel(pan=Axis(sign=-1), tilt=Axis(offset_rad=0.1))
    assert head.pan_tilt_from_vapix(HeadReading(pan_deg=90.0, tilt_deg=0.0, zoom=1)) == (-math.pi / 2, 0.1)


@pytest.mark.parametrize(
    "wrong", [{"sign": 0}, {"scale": 0.0}, {"scale": -1.0}, {"offset_rad": math.nan}, {"scale": math.inf}]
)
def test_what_is_no_axis_is_refused(wrong):
    with pytest.raises(GeometryError, match="not an axis"):
        Axis(**wrong)


def test_a_camera_looking_aside_is_refused():
    with pytest.raises(GeometryError, match="45°"):
        HeadModel(pan=Axis(), tilt=Axis(), camera_rotvec_rad=(0.0, np.radians(50.0), 0.0))
