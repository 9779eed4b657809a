"""Accuracy on ray-traced regions of every kind, against exact truth: the committed part of the bench's scenes.

The folders in ``tests/data/accuracy`` are written by ``python -m tests.bench.subset``: per scene the first region of
every kind, with the views that scan its arc. Nobody chose them because they are found. The bounds leave slack; the
figures themselves stand in docs/accuracy.md.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from ptzd.calibration.file import load_rig
from ptzd.control.planning.decision import Decision, Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.geometry.types import pixel_angle_rad
from ptzd.matching.job import MatchInputs, match
from ptzd.model import Box, HeadReading, Matcher

DATA = Path(__file__).parents[1] / "data" / "accuracy"
SCENES = ("yard", "warehouse")
BAND_RAD = np.radians(1.0)
CONFIDENT_WRONG_DEG = 3.0

Change = Callable[[np.ndarray, np.random.Generator], np.ndarray]


@dataclass(frozen=True, kw_only=True)
class Sample:
    """One region and the views of its scan."""

    name: str
    views: tuple[MatchInputs, ...]
    truths: np.ndarray
    """(n, 3) directions of what the centre shows."""

    def error_deg(self, decision: Decision) -> float:
        if decision.best is None or len(self.truths) == 0:
            return np.inf
        found = bearing(decision.best.pan_rad, decision.best.tilt_rad)
        return float(np.degrees(min(angle_between(found, truth) for truth in self.truths)))

    def sigma_deg(self, decision: Decision) -> float:
        view = self.views[0]
        assert decision.best is not None
        pixel_rad = pixel_angle_rad(view.rig.fisheye, view.box.centre)
        return math.degrees(direction_sigma_rad(decision.best, pixel_rad))


@cache
def samples(scene: str) -> tuple[Sample, ...]:
    folder = DATA / scene
    rig = load_rig(folder / "rig.yaml")
    fisheye = cv2.imread(str(folder / "fisheye.jpg"), cv2.IMREAD_GRAYSCALE)
    listed = json.loads((folder / "regions.json").read_text())
    return tuple(sample(region, folder, fisheye, rig) for region in listed)


def sample(region: dict, folder: Path, fisheye: np.ndarray, rig) -> Sample:
    x, y, w, h = region["box"]
    views = tuple(
        MatchInputs(
            fisheye_grey=fisheye,
            view_grey=cv2.imread(str(folder / view["image"]), cv2.IMREAD_GRAYSCALE),
            rig=rig,
            box=Box(x=x, y=y, w=w, h=h),
            reading=HeadReading(pan_deg=view["pan_deg"], tilt_deg=view["tilt_deg"], zoom=view["zoom"]),
            inverse_range=tuple(region["inverse_range"]),
            band_rad=BAND_RAD,
            seed=1,
        )
        for view in region["views"]
    )
    pan, tilt = np.radians(np.array(region["truths_deg"])).T
    return Sample(name=f"{folder.name} {region['name']}", views=views, truths=bearing(pan, tilt))


def all_samples() -> list[Sample]:
    return [one for scene in SCENES for one in samples(scene)]


def changed(one: Sample, view: Change, fisheye: Change = lambda picture, _: picture) -> Sample:
    rng = np.random.default_rng(len(one.name))
    seen = as_bytes(fisheye(one.views[0].fisheye_grey.astype(float), rng))
    views = (replace(v, fisheye_grey=seen, view_grey=as_bytes(view(v.view_grey.astype(float), rng))) for v in one.views)
    return replace(one, views=tuple(views))


def as_bytes(picture: np.ndarray) -> np.ndarray:
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def noisy(sigma: float) -> Change:
    return lambda picture, rng: picture + rng.normal(0.0, sigma, picture.shape)


def answers(group: list[Sample], matcher: Matcher = Matcher.SWEEP) -> list[Decision]:
    return [decide([(i, match(view, matcher)) for i, view in enumerate(one.views)], Thresholds()) for one in group]


def surely_wrong(group: list[Sample], decisions: list[Decision]) -> list[str]:
    return [
        f"{one.name}: {one.error_deg(decision):.1f}°, told with {decision.probability:.2f}"
        for one, decision in zip(group, decisions, strict=True)
        if decision.outcome is Verdict.FOUND and one.error_deg(decision) > CONFIDENT_WRONG_DEG
    ]


def test_the_subset_holds_every_kind_in_both_scenes() -> None:
    for scene in SCENES:
        kinds = {region["kind"] for region in json.loads((DATA / scene / "regions.json").read_text())}
        assert kinds >= {"planar", "slightly_planar", "non_planar", "small", "weak_texture", "occluded", "repetitive"}


@pytest.mark.parametrize(
    ("view", "fisheye", "median_deg", "share"),
    [
        pytest.param(lambda p, _: p, lambda p, _: p, 0.1, 0.9, id="clean"),
        pytest.param(noisy(6.0), noisy(6.0), 0.2, 0.8, id="noise"),
        pytest.param(lambda p, _: 153.0 * (p / 255.0) ** 2.2, lambda p, _: p, 0.15, 0.8, id="dark"),
        pytest.param(lambda p, _: 255.0 - 0.8 * p, lambda p, _: p, 0.1, 0.85, id="reversed"),
    ],
)
def test_regions_of_every_kind_are_found_and_none_is_surely_wrong(
    view: Change, fisheye: Change, median_deg: float, share: float
) -> None:
    group = [changed(one, view, fisheye) for one in all_samples()]
    decisions = answers(group)
    errors = np.array([one.error_deg(decision) for one, decision in zip(group, decisions, strict=True)])
    assert surely_wrong(group, decisions) == []
    assert np.median(errors) <= median_deg
    assert np.mean(errors <= 1.0) >= share


def test_what_is_in_no_view_is_not_found() -> None:
    """Every box is cut from the other scene's fisheye picture."""
    strangers = []
    for mine, other in (SCENES, SCENES[::-1]):
        fisheye = samples(mine)[0].views[0].fisheye_grey
        strangers += [
            replace(one, truths=np.zeros((0, 3)), views=tuple(replace(v, fisheye_grey=fisheye) for v in one.views))
            for one in samples(other)
        ]
    assert surely_wrong(strangers, answers(strangers)) == []


def test_errors_keep_within_three_of_the_sigma_they_are_told_with() -> None:
    group = all_samples()
    told = [(one, d) for one, d in zip(group, answers(group), strict=True) if d.outcome is Verdict.FOUND]
    assert len(told) >= 0.8 * len(group)
    assert np.mean([one.error_deg(d) <= 3.0 * one.sigma_deg(d) for one, d in told]) >= 0.8


def test_more_noise_does_not_make_it_surer() -> None:
    means = []
    for sigma in (0.0, 15.0, 45.0):
        group = [changed(one, noisy(sigma), noisy(sigma)) for one in all_samples()]
        means.append(float(np.mean([decision.probability for decision in answers(group)])))
    assert all(later <= earlier + 0.01 for earlier, later in itertools.pairwise(means)), means
    assert means[-1] < means[0] - 0.3


def test_the_papers_matcher_finds_some_and_is_never_surely_wrong() -> None:
    group = all_samples()
    decisions = answers(group, Matcher.HARRIS)
    assert surely_wrong(group, decisions) == []
    assert sum(one.error_deg(decision) <= 1.0 for one, decision in zip(group, decisions, strict=True)) >= 3
