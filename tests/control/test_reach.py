"""What no pose within the limits shows is told: in the plan, in the step `plan`, and in the reason of the result."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control import commands as cmd
from ptzd.control.planning.views import plan_views
from ptzd.geometry.arc import EpipolarArc
from ptzd.model import Box, HeadLimits, HeadReading, Outcome

BOX = Box(x=330, y=230, w=40, h=32)
HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)


def tight(pan_deg: float) -> HeadLimits:
    """A head that cannot turn further to the left, where near targets are."""
    return HeadLimits(pan_deg=(pan_deg, 170.0), tilt_deg=(-80.0, 80.0), zoom=(1.0, 9999.0))


@given(pan_deg=st.floats(-60.0, 90.0), near_m=st.floats(0.2, 1.0))
def test_the_share_is_that_of_the_angle_along_the_arc(rig, pan_deg: float, near_m: float) -> None:
    interval = (0.0, 1.0 / near_m)
    plan = plan_views(rig, BOX, interval, tight(pan_deg), HOME, hfov_rad=0.3)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(BOX.centre)[0], *interval)
    missing = sum(float(arc.angle_at(far) - arc.angle_at(near)) for near, far in plan.unreachable)
    assert plan.unreachable_share == pytest.approx(missing / float(arc.angle_at(interval[1])), abs=1e-6)
    assert bool(plan.unreachable) == bool(plan.unreachable_in_words(metric=True))
    assert (plan.unreachable_share == pytest.approx(1.0)) == (plan.views == ())


def test_the_words_are_range_from_near_to_far_in_the_rigs_unit(rig) -> None:
    plan = plan_views(rig, BOX, (0.0, 2.0), tight(-10.0), HOME, hfov_rad=0.3)
    ((far, near),) = plan.unreachable
    words = plan.unreachable_in_words(metric=True)
    assert words == f"range {1 / near:.3g} to {1 / far:.3g} m, {100 * plan.unreachable_share:.0f} % of the arc"
    assert " baselines," in plan.unreachable_in_words(metric=False)
    nothing = plan_views(rig, BOX, (0.0, 2.0), tight(120.0), HOME, hfov_rad=0.3)
    assert nothing.unreachable_in_words(metric=True) == "range 0.5 to infinity m, 100 % of the arc"


@pytest.mark.parametrize("score", [0.05, 0.2, 0.4])
def test_a_target_that_is_nowhere_else_is_told_to_be_perhaps_out_of_reach(make_world, config, score: float) -> None:
    world = make_world()
    world.limits, world.score, world.inverse_range = tight(10.0), score, 1.6
    world.start()
    world.request("a", range_m=(0.5, 100.0))
    (plan,) = [step for step in world.of(cmd.PublishFeedback) if step.step == "plan"]
    missing = plan.detail["unreachable"]
    assert str(missing).startswith("range 0.5 to ")
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome in {Outcome.NOT_FOUND, Outcome.AMBIGUOUS}
    assert f"no pose within the head's limits shows {missing}" in result.reason


def test_where_all_is_reached_nothing_is_said(world) -> None:
    world.score = 0.05
    world.request("a")
    world.run()
    assert "no pose" not in world.results()["a"][0].reason
    assert all("unreachable" not in step.detail for step in world.of(cmd.PublishFeedback))
