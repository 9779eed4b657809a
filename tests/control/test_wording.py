"""What a step tells a person."""

from __future__ import annotations

from ptzd.control.wording import in_words, scaled


def test_units_are_signs_and_what_is_empty_is_left_out():
    detail = {"pan_deg": -27.9531, "zoom": 356.0, "range_m": 4.8413, "elapsed_ms": 2405, "phase": "", "state": "SCAN"}
    assert in_words(detail) == "pan -27.95°, zoom 356, range 4.841 m, elapsed 2405 ms, state SCAN"


def test_truth_values_and_texts_stay_what_they_are():
    assert in_words({"confirmed": True, "text": "scanning again"}) == "confirmed True, text scanning again"
    assert in_words({}) == ""


def test_ranges_of_a_rig_without_scale_are_never_in_metres():
    detail = {"range_m": 9.23, "range_near_m": 1.0, "range_far_m": None, "elapsed_ms": 3}
    assert scaled(detail, metric=True) == detail
    told = scaled(detail, metric=False)
    assert told == {"range_baselines": 9.23, "range_near_baselines": 1.0, "range_far_baselines": None, "elapsed_ms": 3}
    assert in_words({"range_baselines": 9.23}) == "range 9.23 baselines"
