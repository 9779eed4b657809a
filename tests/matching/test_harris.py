import dataclasses
import itertools

import numpy as np
import pytest

from ptzd.matching.harris import _digits_above_chance, _matches
from ptzd.matching.job import match
from ptzd.model import Box, Matcher

BOX = Box(x=285, y=205, w=50, h=50)


@pytest.fixture(scope="module")
def result(world):
    return match(world.inputs(BOX, world.aimed(BOX, (3.0, -2.0)), noise=1.5), Matcher.HARRIS)


def test_a_textured_plane_is_found(world, result):
    best = result.candidates[0]
    assert world.error_deg(BOX, best) < 0.5
    assert best.inliers >= 8
    assert best.score > 0.5
    assert best.score > 2.0 * max((c.score for c in result.candidates[1:]), default=0.0)
    assert result.texture > 5


def test_the_plane_carries_the_setpoint(world, result):
    best = result.candidates[0]
    ray, _ = world.rig.fisheye.lift(np.array(BOX.centre))
    assert np.dot(best.plane, world.rig.head_from_fisheye_rotation @ ray) == pytest.approx(best.inverse_range, abs=1e-6)


def test_another_seed_gives_a_like_answer(world):
    inputs = world.inputs(BOX, world.aimed(BOX, (3.0, -2.0)), noise=1.5, seed=99)
    assert world.error_deg(BOX, match(inputs, Matcher.HARRIS).candidates[0]) < 0.5


def test_absent_region_is_no_better_than_chance(world):
    elsewhere = Box(x=180, y=110, w=50, h=50)
    inputs = world.inputs(BOX, world.aimed(BOX), noise=1.0)
    shifted = np.roll(world.fisheye(elsewhere, 1.0), (95, 105), (0, 1))
    found = match(dataclasses.replace(inputs, fisheye_grey=shifted), Matcher.HARRIS).candidates
    assert not found or found[0].score < 0.35


def test_flat_region_has_no_candidates(world):
    inputs = world.inputs(BOX, world.aimed(BOX))
    flat = np.full_like(inputs.fisheye_grey, 90)
    assert match(dataclasses.replace(inputs, fisheye_grey=flat), Matcher.HARRIS).candidates == ()


def test_outside_the_image_circle_there_is_nothing(world):
    inputs = dataclasses.replace(world.inputs(BOX, world.aimed(BOX)), box=Box(x=-60, y=-60, w=20, h=20))
    result = match(inputs, Matcher.HARRIS)
    assert (result.texture, result.candidates) == (0.0, ())


def test_every_corner_counts_once():
    distance = np.array([[0.1, 5.0], [0.2, 5.0], [9.0, 0.3]])
    ray, corner = _matches(distance, 1.0)
    assert ray.tolist() == [0, 2]
    assert corner.tolist() == [0, 1]


def test_digits_grow_with_inliers_and_fall_with_trials_and_clutter():
    digits = [_digits_above_chance(k, 20, 0.1, 500) for k in range(21)]
    assert all(a < b for a, b in itertools.pairwise(digits))
    assert digits[0] == pytest.approx(-np.log10(500))
    assert _digits_above_chance(10, 20, 0.1, 5000) < digits[10]
    assert _digits_above_chance(10, 20, 0.3, 500) < digits[10]
