"""A driver's stamps are believed until they contradict the time at which its pictures come."""

from __future__ import annotations

import time
from contextlib import closing

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices import v4l2_stamps
from ptzd.devices.v4l2_capture import Tally, open_capture
from ptzd.devices.v4l2_stamps import FUTURE_NS, OLDEST_NS, PATIENCE, StampJudge

PERIOD_NS = 33_333_333
NOW_NS = 3_600_000_000_000


@pytest.fixture
def tally():
    return Tally()


@pytest.mark.parametrize(
    ("stamp", "says"),
    [
        (lambda number, now: 0, "do not rise|old"),
        (lambda number, now: NOW_NS, "do not rise"),
        (lambda number, now: 5_000_000_000, "old|do not rise"),
        (lambda number, now: time.time_ns(), "ahead"),
        (lambda number, now: now + 15_000_000_000 * (number > 20), "15.0 s ahead"),
        (lambda number, now: now - 15_000_000_000 * (number > 20), "15.0 s old"),
        (lambda number, now: now // 1000, "old"),
    ],
)
def test_stamps_that_cannot_be_are_given_up_with_one_reason_and_nothing_is_counted_as_lost(
    kernel, settings, jpeg, tally, stamp, says
):
    given_out = []
    with closing(open_capture(settings, kernel.open, tally)) as capture:
        for number in range(60):
            now = NOW_NS + number * PERIOD_NS
            kernel.device.shoot(jpeg(number), t_ns=stamp(number, now))
            kernel.now_ns = now + 5_000_000
            shot = capture.newest()
            if shot is not None:
                given_out.append((number, shot.t_monotonic_ns))
        assert any(part in capture.stamps.complaint for part in says.split("|"))
    assert len(given_out) >= 60 - PATIENCE
    assert given_out[-1] == (59, None)
    for number, stamped_ns in given_out:
        assert stamped_ns is None or abs(stamped_ns - NOW_NS - number * PERIOD_NS) <= OLDEST_NS
    assert tally.numbered == 60


@given(st.lists(st.floats(0.0, 0.5), min_size=1, max_size=80), st.integers(0, 4))
def test_honest_stamps_are_believed_whatever_the_loop_is_busy_with(delays, stood_still):
    """Even after the machine itself stood still: what waited in the buffers is passed over, its age is not guessed."""
    judge, clock = StampJudge(), {"now": 0}
    original, v4l2_stamps.monotonic_ns = v4l2_stamps.monotonic_ns, lambda: clock["now"]
    try:
        taken_ns = NOW_NS
        for delay_s in delays:
            taken_ns += PERIOD_NS
            clock["now"] = taken_ns + round(delay_s * 1e9)
            assert judge.judge(taken_ns)
        late_ns = taken_ns + 60_000_000_000
        for _ in range(stood_still):
            taken_ns += PERIOD_NS
            clock["now"] = late_ns
            assert not judge.judge(taken_ns)
        clock["now"] = late_ns + PERIOD_NS
        assert judge.judge(late_ns)
        assert judge.believed
    finally:
        v4l2_stamps.monotonic_ns = original


def test_the_rounding_of_two_clocks_is_not_the_future():
    judge = StampJudge()
    assert judge.judge(time.monotonic_ns() + FUTURE_NS // 2)
    assert judge.believed


@pytest.mark.parametrize(("asked", "known"), [("MJPG", "JPEG"), ("JPEG", "MJPG"), ("JPEG", "JPEG")])
def test_both_names_of_jpeg_pictures_are_one(kernel, settings, jpeg, tally, asked, known):
    kernel.sizes = {known: [(64, 48)]}
    with closing(open_capture(msgspec.structs.replace(settings, format=asked), kernel.open, tally)) as capture:
        kernel.device.shoot(jpeg(1))
        assert capture.newest().data == jpeg(1)
