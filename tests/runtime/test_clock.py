from __future__ import annotations

import time

from ptzd.runtime.clock import SteadyClock


def test_it_never_falls_and_starts_at_the_wall_clock() -> None:
    before = time.time_ns()
    clock = SteadyClock()
    stamps = [clock.now_ns() for _ in range(100)]
    assert stamps == sorted(stamps)
    assert abs(stamps[0] - before) < 60_000_000_000


def test_monotonic_stamps_fall_between_the_readings_around_them() -> None:
    clock = SteadyClock()
    before = clock.now_ns()
    stamp = clock.from_monotonic_ns(time.monotonic_ns())
    assert before <= stamp <= clock.now_ns()
