import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.control.planning.decision import MODELS, Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.model import Candidate, Matcher, MatchResult

BOX = ((0.0, 0.0), (9.0, 0.0), (9.0, 9.0), (0.0, 9.0))
LIMITS = Thresholds()


def candidate(score=0.9, pan_deg=0.0, tilt_deg=0.0, sigma_deg=0.03, in_view=1.0, s=0.3, inliers=0) -> Candidate:
    return Candidate(
        pan_rad=math.radians(pan_deg),
        tilt_rad=math.radians(tilt_deg),
        inverse_range=s,
        offset_rad=0.0,
        score=score,
        sharpness=0.3,
        sigma_rad=math.radians(sigma_deg),
        plane=(0.0, 0.0, s),
        box_px=BOX,
        inliers=inliers,
        in_view=in_view,
    )


def result(*candidates: Candidate, texture=20.0, matcher=Matcher.SWEEP) -> MatchResult:
    return MatchResult(
        matcher=matcher, texture=texture, candidates=candidates, coverage=(0.0, 1.0), seed=1, elapsed_ms=1.0
    )


def test_a_clear_match_is_found():
    best = candidate(0.95)
    decision = decide([(3, result(best, candidate(0.3, 8.0)))], LIMITS)
    assert decision.outcome is Verdict.FOUND
    assert decision.probability > 0.97
    assert decision.best is best
    assert decision.view == 3
    assert [rival.candidate.score for rival in decision.rivals] == [0.3]


def test_two_alike_places_are_ambiguous_and_both_told():
    decision = decide([(0, result(candidate(0.6), candidate(0.58, 8.0)))], LIMITS)
    assert decision.outcome is Verdict.AMBIGUOUS
    assert decision.best is not None
    assert len(decision.rivals) == 1
    assert "alike" in decision.reason


def test_a_rival_in_another_view_counts_as_one_in_the_same():
    one = decide([(0, result(candidate(0.6), candidate(0.58, 8.0)))], LIMITS)
    other = decide([(0, result(candidate(0.6))), (1, result(candidate(0.58, 8.0)))], LIMITS)
    assert other.outcome is one.outcome
    assert other.probability == pytest.approx(one.probability)
    assert other.rivals[0].view == 1


def test_one_place_seen_in_two_views_is_no_rival():
    decision = decide([(0, result(candidate(0.9))), (1, result(candidate(0.93, 0.2, 0.1)))], LIMITS)
    assert decision.outcome is Verdict.FOUND
    assert decision.view == 1
    assert decision.rivals == ()


def test_places_across_the_back_are_near():
    decision = decide([(0, result(candidate(0.9, 179.9))), (1, result(candidate(0.8, -179.9)))], LIMITS)
    assert decision.rivals == ()


def test_two_peaks_of_one_view_stay_apart_however_near():
    assert len(decide([(0, result(candidate(0.9), candidate(0.8, 0.3)))], LIMITS).rivals) == 1


def test_low_scores_are_not_found():
    decision = decide([(0, result(candidate(0.2), candidate(0.1, 8.0)))], LIMITS)
    assert decision.outcome is Verdict.NOT_FOUND
    assert decision.best is not None


def test_no_candidates_are_not_found():
    for results in ([], [(0, result())]):
        decision = decide(results, LIMITS)
        assert decision.outcome is Verdict.NOT_FOUND
        assert (decision.probability, decision.best, decision.view) == (0.0, None, None)


def test_texture_free_is_told_apart():
    decision = decide([(0, result(candidate(0.99), texture=0.6)), (1, result(texture=0.4))], LIMITS)
    assert decision.outcome is Verdict.NO_TEXTURE
    assert decision.best is None


def test_the_threshold_decides():
    results = [(0, result(candidate(0.62, sigma_deg=0.1), candidate(0.3, 9.0)))]
    p = decide(results, LIMITS).probability
    assert 0.05 < p < 0.999
    assert decide(results, Thresholds(accept_probability=p - 1e-6)).outcome is Verdict.FOUND
    assert decide(results, Thresholds(accept_probability=p + 1e-6)).outcome is not Verdict.FOUND


@settings(max_examples=100)
@given(
    score=st.floats(0.0, 1.0),
    rival=st.floats(0.0, 1.0),
    sigma_deg=st.floats(0.001, 5.0),
    in_view=st.floats(0.05, 1.0),
    matcher=st.sampled_from(list(Matcher)),
)
def test_better_evidence_never_lowers_the_probability(score, rival, sigma_deg, in_view, matcher):
    model = MODELS[matcher]
    p = model.probability(candidate(score, sigma_deg=sigma_deg, in_view=in_view), rival)
    assert 0.0 < p < 1.0
    assert model.probability(candidate(min(score + 0.1, 1.0), sigma_deg=sigma_deg, in_view=in_view), rival) >= p
    assert model.probability(candidate(score, sigma_deg=sigma_deg, in_view=in_view), max(rival - 0.1, 0.0)) >= p
    assert model.probability(candidate(score, sigma_deg=sigma_deg / 2, in_view=in_view), rival) >= p - 1e-12


@settings(max_examples=50)
@given(scores=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=6), order=st.randoms(use_true_random=False))
def test_the_order_of_the_views_does_not_matter(scores, order):
    results = [(k, result(candidate(score, 5.0 * k))) for k, score in enumerate(scores)]
    shuffled = results.copy()
    order.shuffle(shuffled)
    assert decide(shuffled, LIMITS) == decide(results, LIMITS)


def test_harris_is_judged_by_its_own_model():
    found = decide([(0, result(candidate(1.0, inliers=20), matcher=Matcher.HARRIS))], LIMITS)
    weak = decide([(0, result(candidate(0.1, inliers=5), matcher=Matcher.HARRIS))], LIMITS)
    assert found.probability > weak.probability
    assert weak.outcome is not Verdict.FOUND


@given(st.floats(-1.0, 1.0), st.floats(0.0, 2.0), st.floats(0.0, 1.0))
def test_what_a_direction_is_told_to_be_worth_never_beats_its_residuals_or_its_pixels(score, sigma_deg, pixel_deg):
    stated = direction_sigma_rad(candidate(score=score, sigma_deg=sigma_deg), math.radians(pixel_deg))
    assert stated >= math.radians(max(sigma_deg, 0.1 * pixel_deg)) * (1.0 - 1e-12)
    assert stated >= direction_sigma_rad(candidate(score=1.0, sigma_deg=sigma_deg), math.radians(pixel_deg))
