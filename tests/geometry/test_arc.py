import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.arc import EPIPOLE_GUARD_RAD, EpipolarArc
from ptzd.geometry.sphere import angle_between, cross, normalise, rotation_from_rotvec

S = st.floats(0.0, 5.0)
RIGS = {"rotation": st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(lambda v: rotation_from_rotvec(np.array(v)))}
COMPONENT = st.floats(-1.0, 1.0)
DIRECTIONS = st.tuples(COMPONENT, COMPONENT, COMPONENT).filter(lambda v: math.hypot(*v) > 0.1).map(normalise)
BASELINES = st.tuples(DIRECTIONS, st.floats(0.1, 2.0)).map(lambda v: v[0] * v[1])


def arc_of(make_rig, rotation, translation, ray, s_min=0.0, s_max=5.0):
    arc = EpipolarArc.of(make_rig(rotation, translation), ray, s_min, s_max)
    assume(math.sin(angle_between(arc.rotated, arc.epipole)) > 0.05)
    return arc


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, s=S)
def test_every_bearing_lies_on_the_circle_at_its_inverse_range(make_rig, rotation, translation, ray, s):
    arc = arc_of(make_rig, rotation, translation, ray)
    direction = arc.bearing(s)
    assert abs(arc.normal @ direction) < 1e-12
    assert arc.across(direction) == pytest.approx(0.0, abs=1e-12)
    assert arc.inverse_range(direction) == pytest.approx(s, abs=1e-8)
    assert arc.inverse_range(-2.0 * direction) == pytest.approx(s, abs=1e-8)
    essential = np.cross(np.eye(3), translation) @ rotation
    assert abs(direction @ -essential @ ray) < 1e-9
    with_t, with_r = np.cross(direction, translation), np.cross(direction, arc.rotated)
    assert -(with_t @ with_r) / (with_t @ with_t) == pytest.approx(s, abs=1e-6)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS)
def test_the_ends_are_the_rotated_ray_and_the_epipole(make_rig, rotation, translation, ray):
    arc = arc_of(make_rig, rotation, translation, ray)
    assert arc.bearing(0.0) == pytest.approx(rotation @ ray, abs=1e-12)
    assert arc.bearing(1e12) == pytest.approx(translation / np.linalg.norm(translation), abs=1e-9)
    assert arc.inverse_range(arc.epipole) == math.inf
    assert arc.normal == pytest.approx(normalise(cross(translation, rotation @ ray)), abs=1e-12)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, distance=st.floats(0.3, 50.0))
def test_a_point_in_space_is_seen_on_the_arc(make_rig, rotation, translation, ray, distance):
    arc = arc_of(make_rig, rotation, translation, ray)
    in_head = rotation @ (distance * ray) + translation
    assert angle_between(arc.bearing(1 / distance), in_head) < 1e-9
    assert arc.inverse_range(in_head) == pytest.approx(1 / distance, abs=1e-7)
    assert arc.magnification(1 / distance) == pytest.approx(distance / np.linalg.norm(in_head), rel=1e-9)
    assert arc.head_inverse_range(1 / distance) == pytest.approx(1 / np.linalg.norm(in_head), rel=1e-9)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, turn=RIGS["rotation"], s=S)
def test_turning_both_frames_turns_the_answers(make_rig, rotation, translation, ray, turn, s):
    arc = arc_of(make_rig, rotation, translation, ray)
    turned_head = EpipolarArc.of(make_rig(turn @ rotation, turn @ translation), ray, 0.0, 5.0)
    assert turned_head.bearing(s) == pytest.approx(turn @ arc.bearing(s), abs=1e-9)
    assert turned_head.normal == pytest.approx(turn @ arc.normal, abs=1e-9)
    turned_fisheye = EpipolarArc.of(make_rig(rotation @ turn.T, translation), turn @ ray, 0.0, 5.0)
    assert turned_fisheye.bearing(s) == pytest.approx(arc.bearing(s), abs=1e-9)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, factor=st.floats(0.1, 10.0), s=S)
def test_the_unit_of_length_does_not_matter(make_rig, rotation, translation, ray, factor, s):
    arc = arc_of(make_rig, rotation, translation, ray)
    scaled = EpipolarArc.of(make_rig(rotation, factor * translation), ray, 0.0, 50.0)
    assert scaled.bearing(s / factor) == pytest.approx(arc.bearing(s), abs=1e-9)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, s=S)
def test_angles_along_the_arc(make_rig, rotation, translation, ray, s):
    arc = arc_of(make_rig, rotation, translation, ray)
    angle = float(arc.angle_at(s))
    assert 0.0 <= angle < math.pi
    expected = math.cos(angle) * arc.rotated + math.sin(angle) * arc.forward
    assert arc.bearing(s) == pytest.approx(expected, abs=1e-12)
    assert arc.inverse_range_at(angle) == pytest.approx(s, abs=1e-8)


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, ends=st.tuples(S, S).map(sorted), step=st.floats(0.005, 0.5))
def test_steps_are_equal_and_include_both_ends(make_rig, rotation, translation, ray, ends, step):
    arc = arc_of(make_rig, rotation, translation, ray, *ends)
    values = arc.steps(step)
    assert values[0] == ends[0]
    assert values[-1] == ends[1]
    assert (np.diff(values) > 0).all() or len(values) <= 2
    gaps = angle_between(arc.bearing(values[1:]), arc.bearing(values[:-1]))
    assert gaps == pytest.approx(arc.length_rad / max(len(values) - 1, 1), abs=1e-8)
    assert (gaps <= step + 1e-9).all()


@given(**RIGS, translation=BASELINES, ray=DIRECTIONS, aside=st.floats(-1.5, 1.5), s=S)
def test_the_offset_across_is_signed(make_rig, rotation, translation, ray, aside, s):
    arc = arc_of(make_rig, rotation, translation, ray)
    direction = math.cos(aside) * arc.bearing(s) + math.sin(aside) * arc.normal
    assert arc.across(direction) == pytest.approx(aside, abs=1e-9)
    assert arc.inverse_range(direction) == pytest.approx(s, abs=1e-6)


def test_at_the_fisheyes_side_of_the_baseline_the_arc_is_a_point(make_rig):
    arc = EpipolarArc.of(make_rig(None, (0.0, 0.0, 0.5)), (0.0, 0.001, 1.0), 0.0, 3.0)
    assert arc.degenerate
    assert arc.length_rad < EPIPOLE_GUARD_RAD
    assert arc.steps(0.1).tolist() == [0.0, 3.0]


def test_exactly_on_the_baseline_there_is_still_a_normal(make_rig):
    for ray in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0)):
        arc = EpipolarArc.of(make_rig(None, (0.0, 0.0, 0.5)), ray, 0.0, 1.0)
        assert arc.degenerate
        assert abs(arc.normal @ arc.epipole) < 1e-12
        assert np.linalg.norm(arc.normal) == pytest.approx(1.0)
        assert arc.bearing(0.5) == pytest.approx(ray)


def test_a_target_at_the_head_has_no_direction_and_gets_the_epipole(make_rig):
    arc = EpipolarArc.of(make_rig(None, (0.0, 0.0, 0.5)), (0.0, 0.0, -1.0), 0.0, 4.0)
    assert arc.bearing([1.0, 2.0, 3.0]).tolist() == [[0, 0, -1], [0, 0, 1], [0, 0, 1]]
    assert np.isfinite(arc.magnification(2.0))


def test_past_the_head_the_arc_beside_the_baseline_is_long(make_rig):
    near = EpipolarArc.of(make_rig(None, (0.0, 0.0, 0.5)), (0.0, 0.001, -1.0), 0.0, 4.0)
    assert not near.degenerate
    assert near.length_rad > 3.0
    far = EpipolarArc.of(make_rig(None, (0.0, 0.0, 0.5)), (0.0, 0.001, -1.0), 0.0, 0.5)
    assert far.degenerate


def test_one_inverse_range_is_one_step(make_rig):
    assert EpipolarArc.of(make_rig(), (0.0, 0.0, 1.0), 0.5, 0.5).steps(0.1).tolist() == [0.5]


@pytest.mark.parametrize("ends", [(-0.1, 1.0), (1.0, 0.5), (0.0, math.inf), (math.nan, 1.0)])
def test_an_impossible_interval_is_refused(make_rig, ends):
    with pytest.raises(GeometryError, match="inverse ranges must satisfy"):
        EpipolarArc.of(make_rig(), (0.0, 0.0, 1.0), *ends)


@pytest.mark.parametrize("ray", [(0.0, 0.0, 0.0), ((0.0, 0.0, 1.0),), (math.nan, 0.0, 1.0)])
def test_an_impossible_ray_is_refused(make_rig, ray):
    with pytest.raises(GeometryError, match="one fisheye ray"):
        EpipolarArc.of(make_rig(), ray, 0.0, 1.0)


@pytest.mark.parametrize("step", [0.0, -1.0, math.nan])
def test_a_step_must_be_positive(make_rig, step):
    with pytest.raises(GeometryError, match="step_rad"):
        EpipolarArc.of(make_rig(), (0.0, 0.0, 1.0), 0.0, 1.0).steps(step)
