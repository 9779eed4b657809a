from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices.v4l2_loss import WINDOW, WRAP, Numbering

PERIOD_NS = 33_333_333


@given(
    fates=st.lists(st.sampled_from(["arrives"] * 6 + ["skipped", "unsent"]), max_size=200),
    jitter=st.lists(st.integers(-5_000_000, 5_000_000), min_size=200, max_size=200),
    first=st.integers(0, 1000),
    start=st.integers(0, WRAP - 1),
)
def test_gaps_are_the_lost_pictures_whichever_way_they_are_lost(fates, jitter, first, start):
    """Skipped ones keep their sequence number, unsent ones have none; both take their time."""
    numbering = Numbering(PERIOD_NS / 1e9, first)
    sequence, expected = start, None
    lost = {"skipped": 0, "unsent": 0}
    for tick, fate in enumerate(["arrives", *fates]):
        if fate != "unsent":
            sequence = (sequence + 1) % WRAP
        if fate != "arrives":
            lost[fate] += 1
            continue
        number = numbering.note(sequence, tick * PERIOD_NS + jitter[tick - 1] + 10**9)
        if expected is None:
            assert number == first
        else:
            missing = sum(lost.values())
            assert number == expected + missing
        expected = number + 1
        lost = {"skipped": 0, "unsent": 0}


@given(sequences=st.lists(st.integers(0, WRAP - 1), max_size=50), stamps=st.lists(st.integers(0, 10**12), min_size=50))
def test_no_number_is_given_twice_whatever_the_driver_says(sequences, stamps):
    numbering = Numbering(None)
    numbers = [numbering.note(sequence, stamp) for sequence, stamp in zip(sequences, stamps, strict=False)]
    assert numbers == sorted(set(numbers))


def test_a_camera_that_halves_its_rate_stops_counting_as_losing():
    numbering = Numbering(PERIOD_NS / 1e9)
    numbers = [numbering.note(i, i * 2 * PERIOD_NS) for i in range(4 * WINDOW)]
    steps = [after - before for before, after in pairwise(numbers)]
    assert set(steps[: WINDOW // 2]) == {2}
    assert set(steps[WINDOW:]) == {1}


def test_without_stamps_only_the_sequence_tells():
    numbering = Numbering(PERIOD_NS / 1e9)
    assert [numbering.note(sequence, None) for sequence in (7, 8, 11, 12)] == [0, 1, 4, 5]


def test_a_counter_that_starts_again_is_no_loss():
    numbering = Numbering(None)
    assert [numbering.note(sequence, None) for sequence in (100, 101, 0, 1)] == [0, 1, 2, 3]


def test_the_counter_wraps_without_a_loss():
    numbering = Numbering(None)
    assert [numbering.note(sequence % WRAP, None) for sequence in (WRAP - 2, WRAP - 1, WRAP, WRAP + 1)] == [0, 1, 2, 3]


@pytest.mark.parametrize("stamp", [0, -5, PERIOD_NS])
def test_a_stamp_that_stands_still_or_goes_back_is_no_loss(stamp):
    numbering = Numbering(PERIOD_NS / 1e9)
    numbering.note(0, PERIOD_NS)
    assert numbering.note(1, stamp) == 1
