"""Searches over more places than OpenCV's tables have rows: on a fisheye of 11 megapixels a small box has that many."""

import dataclasses

import numpy as np
import pytest

from ptzd.errors import MatchError
from ptzd.geometry.unified import UnifiedCamera
from ptzd.matching import budget, place, sweep
from ptzd.matching.job import match
from ptzd.matching.lookup import MOST_ROWS, look_up
from ptzd.model import Box, Matcher

BOX = Box(x=2100, y=1500, w=12, h=10)


@pytest.fixture(scope="module")
def large(lab, textures):
    fisheye = UnifiedCamera(
        size_px=(3840, 2880), fx=1692.0, fy=1692.0, cx=1919.5, cy=1439.5, xi=1.2, max_angle_rad=np.radians(92)
    )
    rig = dataclasses.replace(lab.make_rig(size=(640, 480)), fisheye=fisheye)
    return lab.World(rig=rig, planes=(lab.wall(textures[0]),))


def test_any_number_of_places_is_looked_up_as_one_by_one():
    rng = np.random.default_rng(3)
    picture = rng.uniform(0, 255, (30, 40)).astype(np.float32)
    x, y = (rng.uniform(-2, size + 2, (2 * MOST_ROWS + 9, 3)).astype(np.float32) for size in (40, 30))
    whole = look_up(picture, x, y)
    parts = [look_up(picture, x[k : k + 1000], y[k : k + 1000]) for k in range(0, len(x), 1000)]
    assert np.array_equal(whole, np.concatenate(parts))
    assert look_up(picture, x[:0], y[:0]).shape == (0, 3)


@pytest.mark.parametrize("matcher", list(Matcher))
def test_more_places_than_a_table_has_rows_are_searched(large, matcher, monkeypatch):
    counted = []
    refuse = budget.refuse_beyond_budget

    def noted(hypotheses, samples, budget_s):
        counted.append(hypotheses)
        refuse(hypotheses, samples, budget_s)

    monkeypatch.setattr(place, "refuse_beyond_budget", noted)
    reading = large.aimed(BOX, (1.0, -0.5))
    result = match(large.inputs(BOX, reading, noise=1.0, band_deg=6.0, inverse_range=(0.01, 1.0)), matcher)
    assert counted[0] > 32_767
    if matcher is Matcher.SWEEP:
        assert large.error_deg(BOX, result.candidates[0]) < 0.1


@pytest.mark.parametrize("matcher", list(Matcher))
def test_a_picture_without_anything_costs_no_more(large, matcher):
    """Every place is as good as any other then; all pairs of them would take gigabytes."""
    inputs = large.inputs(BOX, large.aimed(BOX), band_deg=6.0)
    flat = dataclasses.replace(inputs, view_grey=np.full_like(inputs.view_grey, 90))
    assert all(found.score < 0.5 for found in match(flat, matcher).candidates)


def test_blocks_do_not_change_the_answer(world, monkeypatch):
    inputs = world.inputs(Box(x=300, y=220, w=24, h=24), world.aimed(Box(x=300, y=220, w=24, h=24)), band_deg=2.0)
    whole = sweep.sweep(inputs)
    monkeypatch.setattr(place, "BLOCK_SAMPLES", 5000)
    parts = sweep.sweep(inputs)
    assert [one.pan_rad for one in parts[1]] == pytest.approx([one.pan_rad for one in whole[1]], abs=1e-6)
    assert [one.score for one in parts[1]] == pytest.approx([one.score for one in whole[1]], abs=1e-4)


@pytest.mark.parametrize("matcher", list(Matcher))
def test_beyond_its_budget_a_match_is_refused_with_the_work_and_the_cure(large, matcher):
    inputs = large.inputs(BOX, large.aimed(BOX), band_deg=6.0, budget_s=0.1)
    with pytest.raises(MatchError, match=r"\d+ places of \d+ samples.*match_budget_s is 0.1 s; narrow range_m"):
        match(inputs, matcher)


def test_separate_is_the_greedy_choice(lab, world):
    rng = np.random.default_rng(0)
    inputs = world.inputs(Box(x=300, y=220, w=24, h=24), world.aimed(Box(x=300, y=220, w=24, h=24)))
    arc = sweep.EpipolarArc.of(inputs.rig, inputs.rig.fisheye.lift(np.array(inputs.box.centre))[0], 0.0, 1.0)
    inverse_range = rng.uniform(0, 1, 300)
    many = place.Place(
        planes=inverse_range[:, None] * arc.rotated, offset=rng.uniform(-0.1, 0.1, 300), roll=np.zeros(300)
    )
    scores = rng.integers(0, 5, 300).astype(float)
    directions, left, chosen = many.bearings(arc), list(np.argsort(-scores, kind="stable")), []
    while left and len(chosen) < 9:
        chosen.append(left[0])
        left = [k for k in left if directions[k] @ directions[chosen[-1]] < 1.0 - 0.5 * 0.03**2]
    assert place.separate(many, scores, arc, 0.03, 9).tolist() == chosen
