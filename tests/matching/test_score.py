import dataclasses

import numpy as np
import pytest

from ptzd.matching.patch import Patch
from ptzd.matching.score import make_template, score
from ptzd.matching.view import Samples

SHAPE = (24, 28)


def texture(seed: int) -> np.ndarray:
    import cv2

    return cv2.GaussianBlur(np.random.default_rng(seed).normal(0, 60, SHAPE), (0, 0), 1.2).ravel() + 120


def patch_of(grey: np.ndarray) -> Patch:
    weight = np.full(grey.size, 1.0 / grey.size, np.float32)
    rays = np.zeros((grey.size, 3), np.float32)
    return Patch(grey=grey.astype(np.float32), rays=rays, weight=weight, shape=SHAPE, step_px=1, angle_rad=0.01)


def samples_of(*greys: np.ndarray, inside: np.ndarray | None = None) -> Samples:
    grey = np.stack(greys).astype(np.float32)
    seen = np.ones(grey.shape, bool) if inside is None else inside
    return Samples(grey=grey, inside=seen, x=grey, y=grey, inverse_depth=grey)


def scored(one, *others, noise=(0.5, 0.5), inside=None):
    return score(make_template(patch_of(one), noise), samples_of(*others, inside=inside))


def test_the_same_pixels_score_one_and_others_near_zero():
    others = [texture(seed) for seed in range(1, 30)]
    total = scored(texture(0), texture(0), *others).total
    assert total[0] > 0.97
    assert total[1:].max() < 0.5
    assert abs(total[1:].mean()) < 0.2


def test_gain_offset_and_a_shade_do_not_matter():
    one = texture(0)
    shade = np.linspace(0.7, 1.3, one.size)
    total = scored(one, 0.4 * one + 30, 1.3 * one - 20, one * shade).total
    assert total[:2].min() > 0.95
    assert total[2] > 0.85


def test_reversed_contrast_is_recognised_with_a_penalty():
    total = scored(texture(0), texture(0), 255 - texture(0)).total
    assert 0.85 < total[1] < total[0]


def test_an_occluder_costs_its_share():
    one = texture(0)
    hidden = one.reshape(SHAPE).copy()
    hidden[:, :8] = texture(5).reshape(SHAPE)[:, :8]
    total = scored(one, hidden.ravel(), texture(5)).total
    assert total[0] > 0.55
    assert total[0] > total[1] + 0.3


def test_noise_is_taken_out():
    rng = np.random.default_rng(3)
    one = texture(0)
    noisy = [one + rng.normal(0, 12, one.size) for _ in range(20)]
    seen = one + rng.normal(0, 12, one.size)
    known = scored(seen, *noisy, noise=(12.0, 12.0)).total
    unknown = scored(seen, *noisy, noise=(0.5, 0.5)).total
    assert known.mean() > unknown.mean() + 0.05


def test_only_what_is_in_view_counts():
    one = texture(0)
    half = np.ones((1, one.size), bool)
    half[0, : one.size // 2] = False
    spoilt = np.where(half[0], one, 0.0)
    result = scored(one, spoilt, inside=half)
    assert result.total[0] > 0.95
    assert result.in_view[0] == pytest.approx(0.5, abs=0.02)


def test_flat_pixels_score_low():
    assert scored(texture(0), np.full(SHAPE[0] * SHAPE[1], 90.0)).total[0] < 0.1


def test_scores_do_not_depend_on_the_company():
    template = make_template(patch_of(texture(0)), (0.5, 0.5))
    alone = score(template, samples_of(texture(1))).total[0]
    together = score(template, samples_of(texture(2), texture(1), texture(0))).total[1]
    assert alone == pytest.approx(together, abs=1e-5)


def test_zero_weight_samples_do_not_matter():
    patch = patch_of(texture(0))
    weight = patch.weight.copy()
    weight[::3] = 0
    patch = dataclasses.replace(patch, weight=weight / weight.sum())
    whole = np.where(weight > 0, texture(0), 0.0)
    template = make_template(patch, (0.5, 0.5))
    assert score(template, samples_of(whole)).total[0] > 0.45
