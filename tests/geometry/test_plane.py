import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.plane import (
    facing,
    in_front_of_both,
    plane_from_pairs,
    too_oblique,
)
from ptzd.geometry.sphere import normalise, rotation_from_rotvec

COMPONENT = st.floats(-0.5, 0.5)
SHIFTS = st.tuples(COMPONENT, COMPONENT, COMPONENT).filter(lambda v: math.hypot(*v) > 0.05).map(np.array)
PLANES = st.tuples(COMPONENT, COMPONENT, st.floats(0.1, 0.8)).map(lambda v: np.array(v) * [0.5, 0.5, 1.0])
RAYS = normalise(np.array([[0.0, 0.0, 1.0], [0.1, 0.02, 1.0], [0.03, 0.12, 1.0], [-0.1, 0.05, 1.0], [0.02, -0.1, 1.0]]))


def seen(rays, plane, shift):
    """Directions from the head of the plane's points on these rays."""
    return normalise(rays / (rays @ plane)[:, None] + shift)


@given(PLANES, SHIFTS)
def test_a_plane_that_both_see_is_in_front_of_both(plane, shift):
    assume(1 + plane @ shift > 0.1)
    assume((RAYS @ plane > 0.01).all())
    assert in_front_of_both(shift, plane, RAYS)


@given(PLANES, SHIFTS, st.integers(3, 5))
def test_pairs_give_their_plane_back(plane, shift, count):
    assume(1 + plane @ shift > 0.1)
    assume((RAYS @ plane > 0.01).all())
    directions = seen(RAYS, plane, shift)
    assume((np.linalg.norm(np.cross(directions, shift), axis=-1) > 0.01).all())
    found, valid = plane_from_pairs(RAYS[:count], directions[:count], shift)
    assert valid
    assert found == pytest.approx(plane, abs=1e-7)


@given(PLANES, SHIFTS, st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_turning_the_frame_turns_the_plane(plane, shift, vector):
    assume(1 + plane @ shift > 0.1)
    assume((RAYS @ plane > 0.01).all())
    directions = seen(RAYS, plane, shift)
    assume((np.linalg.norm(np.cross(directions, shift), axis=-1) > 0.01).all())
    turn = rotation_from_rotvec(np.array(vector))
    found, valid = plane_from_pairs(RAYS @ turn.T, directions @ turn.T, turn @ shift)
    assert valid
    assert found == pytest.approx(turn @ plane, abs=1e-7)


def test_many_sets_at_once_and_a_bad_one_among_them():
    plane, shift = np.array([0.1, 0.0, 0.4]), np.array([0.5, 0.0, 0.1])
    directions = seen(RAYS, plane, shift)
    line = normalise(np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.2, 0.0, 1.0]]))
    at_epipole = np.stack([directions[0], normalise(shift), directions[2]])
    found, valid = plane_from_pairs(
        np.stack([RAYS[:3], line, RAYS[:3]]), np.stack([directions[:3], seen(line, plane, shift), at_epipole]), shift
    )
    assert valid.tolist() == [True, False, False]
    assert found[0] == pytest.approx(plane)
    assert not found[1:].any()


@pytest.mark.parametrize("shapes", [((2, 3), (2, 3)), ((3, 3), (4, 3)), ((3,), (3,))])
def test_too_few_or_unpaired_rays_are_refused(shapes):
    with pytest.raises(GeometryError, match="pairs: expected"):
        plane_from_pairs(np.ones(shapes[0]), np.ones(shapes[1]), (1.0, 0.0, 0.0))


def test_a_plane_behind_either_camera_is_seen():
    shift = np.array([0.0, 0.0, -2.0])
    assert not in_front_of_both(shift, [0.0, 0.0, -0.5], RAYS)
    assert not in_front_of_both(shift, [0.0, 0.0, 1.0], RAYS)
    assert in_front_of_both(shift, [0.0, 0.0, 0.2], RAYS)
    assert in_front_of_both(shift, [0.0, 0.0, 0.0], RAYS)
    assert in_front_of_both(shift, [0.0, 0.0, -1e-6], RAYS, s_min=-1e-3)
    assert in_front_of_both(shift, [[0.0, 0.0, 0.2], [0.0, 0.0, 1.0]], RAYS).tolist() == [True, False]


def test_obliqueness_is_the_angle_to_the_normal():
    ray = [0.0, 0.0, 1.0]
    for degrees in (0, 45, 79, 81, 120):
        angle = math.radians(degrees)
        plane = 0.3 * np.array([math.sin(angle), 0.0, math.cos(angle)])
        assert facing(plane, ray) == pytest.approx(math.cos(angle))
        assert too_oblique(plane, ray) == (degrees > 80)
    assert facing([0.0, 0.0, 0.0], ray) == 1.0
