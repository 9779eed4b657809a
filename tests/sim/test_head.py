import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.sim.head import Head, MoveBy, MoveTo, Turn, ZoomRun
from ptzd.sim.profile import PROFILES, profile

START_S = 1000.0
profiles = st.sampled_from(sorted(PROFILES))


def settled(head: Head, t_s: float) -> float:
    """First moment at which nothing waits or moves or swings."""
    while head.busy(t_s):
        t_s += 0.05
    return head.rest_s(t_s) + 0.3


@given(
    name=profiles,
    pan=st.floats(-180, 180),
    tilt=st.floats(-90, 90),
    zoom=st.integers(1, 9999),
    seed=st.integers(0, 99),
)
def test_an_absolute_move_arrives_within_the_quantum(name, pan, tilt, zoom, seed):
    kind = profile(name)
    head = Head(kind, seed=seed, t_s=START_S)
    head.submit(START_S, MoveTo(pan=pan, tilt=tilt, zoom=zoom))
    now = settled(head, START_S)
    goal_pan = pan if kind.pan.endless else kind.pan.clip(pan)
    report, optics = head.reported(now), head.optical(now)
    assert abs(math.remainder(report.pan_deg - goal_pan, 360)) <= kind.quantum_deg / 2 + 1e-9
    assert abs(report.tilt_deg - kind.tilt.clip(tilt)) <= kind.quantum_deg / 2 + 1e-9
    assert abs(report.zoom - zoom) <= kind.zoom_jitter
    assert abs(optics.tilt_deg - report.tilt_deg) <= kind.quantum_deg + 6 * kind.repeat_sigma_deg


@settings(max_examples=40)
@given(name=profiles, pan=st.floats(-150, 150))
def test_nothing_moves_before_the_latency_and_reports_lag_behind(name, pan):
    kind = profile(name)
    head = Head(kind, seed=3, t_s=START_S)
    taken_up = head.submit(START_S, MoveTo(pan=pan))
    low, high = kind.timing.latency_bounds_s
    assert low - 1e-9 <= taken_up - START_S <= high + 1e-9
    assert head.encoder(taken_up - 1e-3).pan_deg == 0
    for number in range(40):
        t = taken_up + number * 0.05
        ages = [kind.timing.report_lag_s, kind.timing.report_lag_s + kind.timing.report_refresh_s]
        seen = head.reported(t).pan_deg
        ends = [head.encoder(t - age).pan_deg for age in ages]
        assert min(ends) - kind.quantum_deg <= seen <= max(ends) + kind.quantum_deg


def test_a_newer_move_replaces_the_one_under_way():
    head = Head(profile("v5915"), seed=1, t_s=START_S)
    head.submit(START_S, MoveTo(pan=150))
    head.submit(START_S + 0.6, MoveTo(pan=-20))
    positions = [head.encoder(START_S + 0.02 * number).pan_deg for number in range(300)]
    assert max(positions) < 100
    assert positions[-1] == pytest.approx(-20, abs=0.01)


def test_an_old_driver_takes_up_commands_one_a_second():
    head = Head(profile("old214"), seed=1, t_s=START_S)
    starts = [head.submit(START_S, MoveTo(pan=value)) for value in (10, 20, 30)]
    assert starts[1] - starts[0] == pytest.approx(1.0)
    assert starts[2] - starts[1] == pytest.approx(1.0)


def test_a_relative_move_counts_from_where_the_motor_is():
    head = Head(profile("v5915"), seed=1, t_s=START_S)
    head.submit(START_S, MoveTo(pan=30, tilt=10, zoom=100))
    now = settled(head, START_S)
    head.submit(now, MoveBy(pan=-12.5, zoom=50))
    pose = head.encoder(settled(head, now))
    assert pose.pan_deg == pytest.approx(17.5, abs=1 / 256)
    assert pose.tilt_deg == pytest.approx(10, abs=1 / 256)
    assert pose.zoom == 150


def test_an_absolute_move_of_one_axis_ends_a_continuous_one_of_both_but_not_of_the_zoom():
    head = Head(profile("dome"), seed=1, t_s=START_S)
    head.submit(START_S, Turn(pan_percent=30, tilt_percent=-10))
    head.submit(START_S, ZoomRun(percent=5))
    head.submit(START_S + 1.0, MoveTo(pan=0))
    now = START_S + 4.0
    head.advance(now)
    assert not head.axes["tilt"].moving(now)
    assert head.axes["zoom"].moving(now)
    head.submit(now, Turn(pan_percent=0, tilt_percent=0))
    head.advance(now + 1)
    assert head.axes["zoom"].moving(now + 1)
    head.submit(now + 1, ZoomRun(percent=0))
    assert not head.busy(now + 2)


def test_a_continuous_move_ends_at_the_stop_and_an_endless_one_never():
    limited, endless = Head(profile("v5915"), seed=1, t_s=0.0), Head(profile("dome"), seed=1, t_s=0.0)
    for head in (limited, endless):
        head.submit(0.0, Turn(pan_percent=100, tilt_percent=0))
    assert limited.encoder(60.0).pan_deg == 170
    assert not limited.busy(60.0)
    assert endless.busy(60.0)
    assert abs(endless.encoder(60.0).pan_deg) <= 180


def test_an_endless_head_goes_over_180_and_reports_the_jump():
    head = Head(profile("dome"), seed=1, t_s=0.0)
    head.submit(0.0, MoveTo(pan=170))
    now = settled(head, 0.0)
    head.submit(now, MoveTo(pan=-170))
    way = [head.encoder(now + 0.01 * number).pan_deg for number in range(300)]
    assert min(abs(pan) for pan in way) > 169
    assert way[-1] == pytest.approx(-170, abs=0.01)


def test_proportional_speed_slows_down_at_tele():
    def speed(zoom: int, share: float) -> float:
        head = Head(profile("dome"), seed=1, t_s=0.0)
        head.submit(0.0, MoveTo(zoom=zoom))
        head.submit(10.0, Turn(pan_percent=100, tilt_percent=0, proportional=share))
        head.advance(12.0)
        return head.axes["pan"].velocity(12.0)

    assert speed(1, 2.0) == pytest.approx(2 * 65, rel=0.02)
    assert speed(9999, 2.0) < 5
    assert speed(9999, 0.0) == 150


def test_the_speed_index_follows_the_documented_table():
    kind = profile("v5915")
    for index, speed in ((1, 0.05), (40, 9.0), (80, 74.0)):
        assert kind.move_speed(index) == pytest.approx(speed)
    head = Head(kind, seed=1, t_s=0.0)
    head.submit(0.0, MoveTo(pan=90), speed_index=40)
    head.advance(1.0)
    assert head.axes["pan"].velocity(1.0) == pytest.approx(9.0)


def test_the_same_seed_gives_the_same_motion_and_another_seed_another():
    def trace(seed: int) -> list[object]:
        head = Head(profile("inverted"), seed=seed, t_s=0.0)
        for number in range(5):
            head.submit(number * 1.0, MoveTo(pan=10.0 * number, tilt=5.0 * number, zoom=100 * number + 1))
        return [head.optical(0.1 * number) for number in range(80)]

    assert trace(4) == trace(4)
    assert trace(4) != trace(5)


def test_a_knock_moves_the_optics_and_not_the_encoders():
    head = Head(profile("v5915"), seed=1, t_s=0.0)
    before = head.optical(1.0)
    head.shift_zero(2.0, 0.4, -0.3)
    after = head.optical(3.0)
    assert after.pan_deg - before.pan_deg == pytest.approx(0.4)
    assert after.tilt_deg - before.tilt_deg == pytest.approx(-0.3)
    assert head.encoder(3.0) == head.encoder(1.0)
    assert head.optical(1.0) == before


def test_a_gear_that_slips_leaves_the_optics_where_they_are_and_a_start_heals_both():
    head = Head(profile("v5915"), seed=1, t_s=0.0)
    head.shift_zero(1.0, 0.4, -0.3)
    head.stick(2.0)
    stands = head.optical(2.0)
    head.submit(3.0, MoveTo(pan=30, tilt=10, zoom=500))
    assert head.encoder(9.0).pan_deg == pytest.approx(30, abs=0.01)
    assert (head.optical(9.0).pan_deg, head.optical(9.0).tilt_deg) == (stands.pan_deg, stands.tilt_deg)
    assert head.optical(9.0).zoom == pytest.approx(500)
    head.find_zero(10.0)
    assert head.optical(11.0).pan_deg == pytest.approx(30, abs=0.01)
    assert head.optical(11.0).tilt_deg == pytest.approx(10, abs=0.01)


def test_of_two_moves_within_one_latency_only_the_newer_runs():
    head = Head(profile("v5915"), seed=1, t_s=START_S)
    turn_s = head.submit(START_S, MoveTo(pan=150, tilt=30, zoom=500))
    assert head.submit(START_S + 0.05, MoveTo(pan=-20)) == turn_s
    positions = [head.encoder(START_S + 0.01 * number).pan_deg for number in range(300)]
    assert max(positions) == 0
    assert positions[-1] == pytest.approx(-20, abs=0.01)
    assert head.encoder(START_S + 3.0).tilt_deg == pytest.approx(30, abs=0.01)
    assert head.encoder(START_S + 3.0).zoom == 500


def test_moves_that_follow_each_other_faster_than_the_latency_still_move_the_head():
    head = Head(profile("dome"), seed=1, t_s=START_S)
    for number in range(40):
        head.submit(START_S + 0.05 * number, MoveTo(pan=float(number)))
    assert head.encoder(START_S + 2.0).pan_deg > 30


@pytest.mark.parametrize("stop", [(Turn(pan_percent=0, tilt_percent=0), 300), (ZoomRun(percent=0), 1)])
def test_a_stop_takes_back_what_waits_on_its_own_axes_only(stop):
    head = Head(profile("v5915"), seed=1, t_s=START_S)
    order, zoom = stop
    head.submit(START_S, MoveTo(pan=50, zoom=300))
    head.submit(START_S, order)
    pose = head.encoder(START_S + 4.0)
    assert (pose.pan_deg, pose.zoom) == (0 if isinstance(order, Turn) else pytest.approx(50, abs=0.01), zoom)


def test_auto_flip_goes_on_beyond_the_stop_after_a_quick_turn_back():
    head, plain = Head(profile("inverted"), seed=1, t_s=START_S), Head(profile("inverted"), seed=1, t_s=START_S)
    head.auto_flip = True
    for one in (head, plain):
        one.submit(START_S, MoveTo(pan=170))
        one.submit(START_S + 3.0, Turn(pan_percent=40, tilt_percent=0))
    times = [START_S + 3.0 + 0.02 * number for number in range(400)]
    way = [head.encoder(t).pan_deg for t in times]
    assert max(way) == pytest.approx(180, abs=1e-3)
    assert min(way) == pytest.approx(-180, abs=1e-3)
    after = way[way.index(min(way)) :]
    assert after == sorted(after)
    assert after[-1] > -175
    assert head.busy(times[-1])
    assert plain.encoder(times[-1]).pan_deg == 180
    head.submit(times[-1], Turn(pan_percent=0, tilt_percent=0))
    assert not head.busy(times[-1] + 2.0)
    head.submit(times[-1] + 2.0, MoveTo(pan=170))
    head.submit(times[-1] + 8.0, MoveBy(pan=30))
    assert head.encoder(times[-1] + 16.0).pan_deg == pytest.approx(-160, abs=0.01)
    assert not head.busy(times[-1] + 16.0)
