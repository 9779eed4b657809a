from __future__ import annotations

from ptzd.backoff import Backoff


def test_pauses_double_up_to_the_longest_and_start_small_after_success() -> None:
    backoff = Backoff(15.0)
    assert [backoff.pause_s() for _ in range(7)] == [0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 15.0]
    backoff.reset()
    assert backoff.pause_s() == 0.5


def test_pauses_are_spread_by_up_to_half() -> None:
    half = Backoff(jitter=lambda: 0.999999)
    assert [round(half.pause_s(), 2) for _ in range(3)] == [0.25, 0.5, 1]
