import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.sim.motion import Axis, AxisSpec, plan_cruise, plan_move

LIMITED = AxisSpec(low=-170, high=170, v_max=100, a_max=400, ring_s=4e-4)
ENDLESS = AxisSpec(low=-180, high=180, v_max=150, a_max=500, endless=True)

angles = st.floats(-170, 170)
speeds = st.floats(-100, 100)


def samples(start_s: float, end_s: float, count: int = 200) -> list[float]:
    return [start_s + (end_s - start_s) * number / count for number in range(count + 1)]


@given(x=angles, v=speeds, target=angles, v_max=st.floats(0.5, 150), a_max=st.floats(10, 1000))
def test_a_plan_starts_where_the_axis_is_and_rests_at_the_target(x, v, target, v_max, a_max):
    plan = plan_move(5.0, x, v, target, v_max, a_max)
    assert plan.at(5.0) == pytest.approx((x, v), abs=1e-9)
    before, speed = plan.segments[-1].at(plan.end_s)
    assert before == pytest.approx(target, abs=1e-6)
    assert speed == pytest.approx(0, abs=1e-6)


@given(x=angles, v=speeds, target=angles, v_max=st.floats(1, 150), a_max=st.floats(50, 1000))
def test_speed_and_acceleration_keep_their_limits(x, v, target, v_max, a_max):
    plan = plan_move(0.0, x, v, target, v_max, a_max)
    top = max(v_max, abs(v)) + 1e-6
    times = samples(0.0, plan.end_s)
    states = [plan.at(t) for t in times]
    assert all(abs(speed) <= top for _, speed in states)
    for (t0, (x0, v0)), (t1, (x1, v1)) in zip(
        zip(times, states, strict=True), zip(times[1:], states[1:], strict=False), strict=False
    ):
        assert abs(v1 - v0) <= a_max * (t1 - t0) + 1e-6
        assert abs(x1 - x0) <= top * (t1 - t0) + 1e-6


@given(target=angles, v_max=st.floats(1, 100))
def test_a_move_from_rest_takes_the_time_of_its_trapezoid(target, v_max):
    plan = plan_move(0.0, 0.0, 0.0, target, v_max, 400.0)
    way = abs(target)
    expected = way / v_max + v_max / 400 if way > v_max * v_max / 400 else 2 * math.sqrt(way / 400)
    assert plan.end_s == pytest.approx(expected, abs=1e-6)


def test_a_cruise_keeps_its_speed_for_ever():
    plan = plan_cruise(0.0, 10.0, -20.0, 30.0, 100.0)
    assert plan.at(0.5) == pytest.approx((12.5, 30.0))
    assert plan.at(100.5) == pytest.approx((12.5 + 3000.0, 30.0))


orders = st.lists(
    st.tuples(st.floats(0.01, 2.0), st.sampled_from(["move", "cruise", "brake", "turn"]), st.floats(-200, 200)),
    min_size=1,
    max_size=8,
)


@given(orders=orders)
def test_any_series_of_orders_moves_smoothly_inside_the_stops(orders):
    axis = Axis(LIMITED, t_s=0.0, x=3.0)
    now = 0.0
    for wait, kind, value in orders:
        now += wait
        before, swing = axis.position(now), axis.optical(now)
        if kind == "move":
            axis.move_to(now, value)
        elif kind == "turn":
            axis.turn_to(now, axis.position(now) + value)
        elif kind == "cruise":
            axis.cruise(now, value)
        else:
            axis.brake(now)
        assert axis.position(now) == pytest.approx(before, abs=1e-9)
        assert axis.optical(now) == pytest.approx(swing, abs=1e-9)
    axis.brake(now + 3.0)
    for t in samples(0.0, now + 5.0, 150):
        assert LIMITED.low <= axis.optical(t) <= LIMITED.high
        assert LIMITED.low - 1e-6 <= axis.position(t) <= LIMITED.high + 1e-6
        assert abs(axis.velocity(t)) <= LIMITED.v_max + 1e-6
    assert not axis.moving(now + 5.0)
    assert axis.rest_s(now + 5.0) < now + 5.0


@given(start=st.floats(-1000, 1000), target=st.floats(-180, 180))
def test_an_endless_axis_takes_the_shorter_way(start, target):
    axis = Axis(ENDLESS, t_s=0.0, x=start)
    plan = axis.move_to(0.0, target)
    assert abs(plan.target - start) <= 180 + 1e-9
    assert math.remainder(plan.target - target, 360) == pytest.approx(0, abs=1e-6)


def test_an_order_beyond_the_stop_ends_at_the_stop():
    axis = Axis(LIMITED, t_s=0.0, x=0.0)
    plan = axis.move_to(0.0, 500.0)
    assert plan.target == LIMITED.high
    assert axis.optical(plan.end_s + 0.01) <= LIMITED.high


def test_the_optics_swing_after_the_motor_stopped_and_come_to_rest():
    axis = Axis(LIMITED, t_s=0.0, x=0.0)
    plan = axis.move_to(0.0, 60.0)
    swing = [abs(axis.optical(t) - 60.0) for t in samples(plan.end_s, axis.rest_s(plan.end_s))]
    assert max(swing) > 0.01
    assert swing[-1] < 1e-3
    assert 0.1 < axis.rest_s(plan.end_s) - plan.end_s < 0.5


def test_the_past_stays_known():
    axis = Axis(LIMITED, t_s=0.0, x=0.0)
    axis.move_to(1.0, 40.0)
    early = axis.position(1.2)
    axis.move_to(2.0, -40.0)
    assert axis.position(1.2) == early
    assert axis.position(0.5) == 0.0
