import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ptzd.errors import GeometryError
from ptzd.geometry.sphere import (
    angle_between,
    bearing,
    cross,
    normalise,
    pan_tilt,
    rotation_from_rotvec,
    rotvec_from_rotation,
    rx,
    ry,
    wrap_angle,
)

ANGLE = st.floats(-math.pi, math.pi)
TILT = st.floats(-1.57, 1.57)
VECTOR = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)


@given(ANGLE, TILT)
def test_pan_and_tilt_come_back(pan, tilt):
    direction = bearing(pan, tilt)
    assert np.linalg.norm(direction) == pytest.approx(1.0)
    again = pan_tilt(direction)
    assert math.cos(float(again[0]) - pan) == pytest.approx(1.0, abs=1e-12)
    assert again[1] == pytest.approx(tilt, abs=1e-9)


@given(ANGLE, TILT)
def test_the_rotations_of_the_axes_make_the_bearing(pan, tilt):
    assert ry(pan) @ rx(tilt) @ [0, 0, 1] == pytest.approx(bearing(pan, tilt), abs=1e-14)


def test_pan_is_right_and_tilt_is_up():
    assert bearing(0.1, 0.0)[0] > 0
    assert bearing(0.0, 0.1)[1] < 0
    assert bearing([0.0, 0.1], 0.0).shape == (2, 3)


@pytest.mark.parametrize("sign", [-1, 1])
def test_at_a_pole_pan_is_0_by_definition(sign):
    pan, tilt = pan_tilt([1e-12, -sign * 3.0, -1e-12])
    assert pan == 0.0
    assert tilt == pytest.approx(sign * math.pi / 2)


@given(VECTOR, st.floats(1e-12, 1e-3))
def test_small_angles_keep_their_digits(vector, angle):
    axis = normalise(vector + np.array([0.0, 0.0, 4.0]))
    side = normalise(cross(axis, np.array([1.0, 0.0, 0.0])))
    assert angle_between(axis, np.cos(angle) * axis + np.sin(angle) * side) == pytest.approx(angle, rel=1e-3, abs=3e-16)


def test_angles_at_both_ends():
    assert angle_between([1, 0, 0], [2, 0, 0]) == 0.0
    assert angle_between([1, 0, 0], [-2, 0, 0]) == pytest.approx(math.pi)
    assert angle_between([1, 0, 0], [[0, 1, 0], [0, 0, 3]]).tolist() == pytest.approx([math.pi / 2] * 2)


@given(VECTOR)
def test_rotation_vectors_agree_with_scipy_and_come_back(vector):
    rotation = rotation_from_rotvec(vector)
    assert rotation == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-13)
    assert rotation_from_rotvec(rotvec_from_rotation(rotation)) == pytest.approx(rotation, abs=1e-13)
    if np.linalg.norm(vector) < 3.1:
        assert rotvec_from_rotation(rotation) == pytest.approx(vector, abs=1e-12)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.8, 0), (-0.6, 0, 0.8)])
@pytest.mark.parametrize("angle", [0.0, 1e-12, 1.0, math.pi - 1e-9, math.pi, math.pi + 0.5])
def test_every_angle_of_rotation_comes_back(axis, angle):
    rotation = rotation_from_rotvec(angle * np.array(axis, dtype=float))
    vector = rotvec_from_rotation(rotation)
    assert np.linalg.norm(vector) <= math.pi + 1e-12
    assert rotation_from_rotvec(vector) == pytest.approx(rotation, abs=1e-14)


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1.0, -1.0]), 1.1 * np.eye(3), np.eye(3)[:2], np.zeros((3, 3))])
def test_what_is_no_rotation_is_refused(matrix):
    with pytest.raises(GeometryError, match="not a rotation"):
        rotvec_from_rotation(matrix)


@given(st.floats(-100.0, 100.0))
def test_wrapping_keeps_the_direction(angle):
    wrapped = float(wrap_angle(angle))
    assert -math.pi <= wrapped < math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-12)
    if -math.pi <= angle < math.pi:
        assert wrapped == angle


def test_a_zero_vector_has_no_direction_and_stays_zero():
    assert normalise([[0.0, 0.0, 0.0], [0.0, 3.0, 4.0]]).tolist() == [[0.0, 0.0, 0.0], [0.0, 0.6, 0.8]]
