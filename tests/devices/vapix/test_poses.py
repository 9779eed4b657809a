from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.devices.vapix.poses import PoseRing, Stillness, offset_of, wrapped_deg
from ptzd.model import HeadReading, Motion

MS = 1_000_000
STILL = Stillness(span_deg=0.025, span_zoom=4.0, rest_s=0.3, start_s=0.4)


def at(pan: float, tilt: float = 0.0, zoom: float = 1.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom)


def ring_of(pans, *, step_ms: int = 100, settle_ms: int = 200) -> tuple[PoseRing, list]:
    ring = PoseRing(STILL, settle_ms * MS)
    poses = [ring.add(index * step_ms * MS, MS, at(pan)) for index, pan in enumerate(pans)]
    return ring, poses


def test_rest_needs_three_reports_over_long_enough():
    ring, poses = ring_of([5, 5, 5])
    assert ring.rest is None
    ring, poses = ring_of([5, 5, 5, 5, 5])
    assert ring.rest.mean == at(5)
    assert [pose.motion for pose in poses][-1] is Motion.STABLE
    ring, _ = ring_of([5, 5], step_ms=500)
    assert ring.rest is None


def test_quick_reports_of_an_old_position_are_no_rest():
    ring, _ = ring_of([5] * 7, step_ms=40)
    assert ring.rest is None


def test_a_changed_report_is_motion():
    _, poses = ring_of([5, 5, 5, 5, 5, 6, 7, 7])
    assert [pose.motion for pose in poses[-3:]] == [Motion.MOVING, Motion.MOVING, Motion.SETTLING]
    assert poses[0].motion is Motion.UNKNOWN


def test_a_slow_drift_is_no_rest_for_ever():
    _, poses = ring_of([5 + 0.01 * index for index in range(40)])
    assert Motion.MOVING in [pose.motion for pose in poses[10:]]


def test_jitter_within_the_span_is_rest():
    ring, _ = ring_of([5, 5.004, 4.996, 5, 5.004])
    assert ring.rest.mean.pan_deg == pytest.approx(5.001)
    assert 0.005 < ring.rest.sigma_deg < 0.01


def test_an_old_report_that_comes_twice_does_not_spoil_the_mean():
    ring, _ = ring_of([5, 7, 7.99, 7.99, 8, 8, 8, 8])
    assert ring.rest.mean == at(8)
    assert ring.rest.sigma_deg == pytest.approx(0.005)


def test_motion_without_a_command_is_foreign_until_rest():
    _, poses = ring_of([5] * 5 + [6, 7, 8] + [9] * 6)
    assert [pose.foreign for pose in poses] == [False] * 5 + [True] * 6 + [False] * 3


def test_motion_after_a_command_is_own():
    ring = PoseRing(STILL, 200 * MS)
    for index in range(5):
        ring.add(index * 100 * MS, MS, at(5))
    ring.commanded(450 * MS)
    poses = [ring.add((500 + index * 100) * MS, MS, at(pan)) for index, pan in enumerate([5, 7, 9, 9, 9, 9, 9])]
    assert not any(pose.foreign for pose in poses)
    assert [pose.motion for pose in poses[:3]] == [Motion.MOVING] * 3
    assert ring.rest.mean == at(9)


def test_reports_from_before_a_possible_start_prove_nothing():
    ring, _ = ring_of([5] * 5)
    ring.commanded(450 * MS)
    proven_ms = None
    for t in range(500, 1400, 100):
        ring.add(t * MS, MS, at(5))
        if proven_ms is None and ring.rest is not None:
            proven_ms = t
    assert proven_ms == 1200


def test_a_command_during_motion_waits_the_whole_start():
    ring, _ = ring_of([5, 5, 5, 5, 6])
    ring.commanded(450 * MS)
    for t in (500, 600, 700, 800):
        ring.add(t * MS, MS, at(9))
    assert ring.rest is None


def test_the_cameras_own_word_shortens_the_proof():
    ring, _ = ring_of([5] * 5)
    ring.commanded(450 * MS)
    ring.started()
    for t, pan in ((500, 6.0), (550, 7.99), (600, 8.0)):
        ring.add(t * MS, MS, at(pan))
    ring.stopped(560 * MS)
    assert ring.confirmed_at_ns == 660 * MS
    ring.add(655 * MS, MS, at(8))
    assert ring.rest is None
    ring.add(660 * MS, MS, at(8))
    assert ring.rest.mean == at(8)
    assert ring.confirmed_at_ns is None


def test_the_word_of_an_earlier_stop_proves_nothing_about_a_later_move():
    ring, _ = ring_of([5] * 5)
    ring.stopped(410 * MS)
    ring.commanded(450 * MS)
    ring.started()
    ring.add(900 * MS, MS, at(6))
    ring.add(950 * MS, MS, at(6))
    assert ring.rest is None


def test_motion_after_a_short_rest_between_two_commands_is_own():
    ring, _ = ring_of([5] * 5)
    ring.commanded(450 * MS)
    ring.started()
    ring.add(500 * MS, MS, at(6))
    ring.stopped(500 * MS)
    for t in (600, 650):
        ring.add(t * MS, MS, at(6))
    assert ring.rest is not None
    assert not ring.add(750 * MS, MS, at(8)).foreign


def test_an_exposure_is_at_rest_only_inside_one_proven_run():
    ring, _ = ring_of([0, 3, 6, 6, 6, 6, 6, 9])
    assert ring.rest_over(210 * MS, 590 * MS).mean == at(6)
    assert ring.rest_over(190 * MS, 500 * MS) is None
    assert ring.rest_over(300 * MS, 610 * MS) is None
    assert ring.rest_over(610 * MS, 650 * MS) is None


def test_a_late_report_is_worth_less_at_both_ends():
    ring = PoseRing(STILL, 200 * MS)
    for t, half in ((0, 90), (200, 1), (400, 1), (600, 120)):
        ring.add(t * MS, half * MS, at(5))
    assert ring.rest_over(95 * MS, 475 * MS) is not None
    assert ring.rest_over(80 * MS, 475 * MS) is None
    assert ring.rest_over(95 * MS, 490 * MS) is None


def test_between_reports_the_pose_is_interpolated_the_short_way_round():
    ring, _ = ring_of([178, -178])
    reading, motion = ring.at(25 * MS)
    assert reading.pan_deg == pytest.approx(179)
    assert motion is Motion.MOVING
    assert ring.at(75 * MS)[0].pan_deg == pytest.approx(-179)


def test_beyond_the_latest_report_a_moving_head_goes_on_for_a_while():
    ring, _ = ring_of([0, 10])
    assert ring.at(150 * MS)[0].pan_deg == pytest.approx(15)
    assert ring.at(900 * MS)[0].pan_deg == pytest.approx(30)
    ring, _ = ring_of([10, 10, 10])
    assert ring.at(900 * MS)[0].pan_deg == 10


def test_nothing_is_known_before_the_first_report():
    assert PoseRing(STILL, 0).at(5) is None
    ring, _ = ring_of([5])
    assert ring.at(-1) == (at(5), Motion.UNKNOWN)
    assert ring.at(60_000 * MS)[1] is Motion.UNKNOWN


def test_memory_is_bounded():
    ring, _ = ring_of([float(index % 7) for index in range(1000)])
    assert len(ring._poses) <= 101
    assert len(ring._runs) <= 101


def test_a_reset_forgets():
    ring, _ = ring_of([5] * 6)
    ring.reset()
    assert (ring.rest, ring.latest, ring.at(0)) == (None, None, None)


@given(st.floats(-1e4, 1e4))
def test_wrapping_keeps_the_direction(angle):
    wrapped = wrapped_deg(angle)
    assert -180 < wrapped <= 180
    assert offset_of(at(wrapped), at(angle))[0] == pytest.approx(0, abs=1e-6)


@given(st.lists(st.tuples(st.integers(1, 400), st.floats(-170, 170)), min_size=1, max_size=60))
def test_whatever_is_reported_rest_holds_only_equal_reports(steps):
    ring, now, seen = PoseRing(STILL, 0), 0, []
    for step_ms, pan in steps:
        now += step_ms * MS
        ring.add(now, 0, at(round(pan / 60) * 60))
        seen.append((now, round(pan / 60) * 60))
        run = ring.rest
        if run is not None:
            inside = {pan for t, pan in seen if run.first_ns <= t <= run.last_ns}
            assert inside == {run.mean.pan_deg}
            assert run.last_ns - run.first_ns >= 285 * MS
