import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import angle_between, normalise
from ptzd.matching.hypotheses import (
    bearings,
    motions,
    sample_inverse_ranges,
    sample_offsets,
    skew,
    speed,
    turns,
    warps,
)

SMALL = st.floats(-0.05, 0.05)


def arc_of(world, ray=(0.1, -0.2, 1.0)):
    return EpipolarArc.of(world.rig, ray, 0.0, 1.0)


@settings(max_examples=30, deadline=None)
@given(s=st.floats(0.0, 1.0), offset=SMALL, roll=SMALL, slope=st.tuples(SMALL, SMALL, SMALL))
def test_the_centre_goes_where_bearings_says(world, s, offset, roll, slope):
    arc = arc_of(world)
    tilt = np.array(slope) - np.dot(slope, arc.rotated) * arc.rotated
    planes = (s * arc.rotated + tilt)[None]
    warp = warps(arc, planes, np.array([offset]), np.array([roll]))[0]
    centre = bearings(arc, planes, np.array([offset]))[0]
    assert angle_between(warp @ arc.rotated, centre) < 1e-9
    assert arc.across(centre) == pytest.approx(offset, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(s=st.floats(0.05, 1.0), offset=SMALL, roll=SMALL)
def test_motions_are_derivatives(world, s, offset, roll):
    arc = arc_of(world)
    place = ((s * arc.rotated)[None], np.array([offset]), np.array([roll]))
    warp = warps(arc, *place)
    matrices, along = motions(arc, *place)
    same, across, rolled = matrices.transpose(1, 0, 2, 3)
    assert np.allclose(same, warp, atol=1e-12)
    ray = normalise(arc.rotated + np.array([0.03, -0.02, 0.01]))
    step = 1e-6
    changed = warps(arc, place[0], place[1] + step, place[2])
    assert np.allclose((changed - warp)[0] @ ray / step, across[0] @ ray, atol=1e-4)
    changed = warps(arc, place[0], place[1], place[2] + step)
    assert np.allclose((changed - warp)[0] @ ray / step, rolled[0] @ ray, atol=1e-4)
    tilted = place[0] + step * (np.eye(3)[0] - arc.rotated[0] * arc.rotated)
    changed = warps(arc, tilted, place[1], place[2])
    per_range = (tilted - place[0])[0] @ ray / step
    assert np.allclose((changed - warp)[0] @ ray / step, along[0] * per_range, atol=1e-4)


def test_speed_is_the_angle_per_inverse_range(world):
    arc = arc_of(world)
    s = np.array([0.0, 0.3, 1.0])
    turned = angle_between(arc.bearing(s + 1e-6), arc.bearing(s))
    assert np.allclose(turned / 1e-6, speed(arc, s), rtol=1e-3)


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(0).normal(size=(2, 5, 3))
    assert np.allclose((skew(a) @ b[..., None])[..., 0], np.cross(a, b))


@settings(max_examples=40, deadline=None)
@given(
    low=st.floats(0.0, 1.0),
    width=st.floats(0.0, 2.0),
    step=st.floats(0.002, 0.05),
    ray=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
)
def test_neighbours_are_less_than_a_step_apart(low, width, step, ray):
    translation = np.array([-0.5, -0.1, -0.05])
    probes = normalise(np.array(ray) + np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0]]))
    s = sample_inverse_ranges(probes, translation, (low, low + width), step)
    if len(s) > 1:
        assert s[0] == pytest.approx(low)
        assert s[-1] == pytest.approx(low + width)
        path = normalise(probes[None] + s[:, None, None] * translation)
        assert angle_between(path[1:], path[:-1]).max() < 1.3 * step


def test_at_the_epipole_the_corners_make_the_steps():
    translation = np.array([0.0, 0.0, -0.5])
    corners = normalise(np.array([[0.1, 0, 1], [-0.1, 0, 1], [0, 0.1, 1]]))
    assert len(sample_inverse_ranges(np.array([[0.0, 0.0, 1.0]]), translation, (0.0, 1.0), 0.005)) == 1
    assert len(sample_inverse_ranges(corners, translation, (0.0, 1.0), 0.005)) > 5


def test_offsets_are_symmetric_and_reach_the_band():
    offsets = sample_offsets(0.02, 0.006)
    assert offsets[0] == -0.02
    assert offsets[-1] == 0.02
    assert np.allclose(offsets, -offsets[::-1])
    assert np.diff(offsets).max() <= 0.006 + 1e-12
    assert sample_offsets(0.0, 0.01).tolist() == [0.0]


@settings(max_examples=30, deadline=None)
@given(s=st.floats(0.0, 1.0), offset=st.floats(-1.0, 1.0), roll=st.floats(-1.0, 1.0))
def test_turns_are_rotations_about_the_line_of_sight_then_across(world, s, offset, roll):
    arc = arc_of(world)
    turn = turns(arc, np.array([s]), np.array([offset]), np.array([roll])).rotation[0]
    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert angle_between(turn @ arc.bearing(s), arc.bearing(s)) == pytest.approx(abs(offset), abs=1e-9)
    rolled = turns(arc, np.array([s]), np.zeros(1), np.array([roll])).rotation[0]
    assert np.trace(rolled) == pytest.approx(1 + 2 * np.cos(roll))
