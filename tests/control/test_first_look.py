"""A scene whose ranges are partly known: the likeliest place is looked at first, and no place is left out."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control.planning.expected import Expected, Hump
from ptzd.control.planning.first_look import likeliest_first
from ptzd.control.planning.views import plan_views
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import angle_between
from ptzd.geometry.types import in_picture
from ptzd.model import Box, HeadLimits, HeadReading

BOX = Box(x=330, y=230, w=40, h=32)
FREE = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
WHOLE = (0.01, 1.25)


def planned(rig, humps, hfov_deg=None, interval=WHOLE, box=BOX, limits=FREE, closest_deg=3.0):
    """The plain plan, the one by the map, and what is expected along the arc."""

    def plan(part, other_rad, towards):
        wish = None if hfov_deg is None else math.radians(hfov_deg)
        hfov_rad = wish if other_rad is None else other_rad
        return plan_views(rig, box, part, limits, HOME, hfov_rad=hfov_rad, towards=towards)

    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], *interval)
    there = Expected(humps=tuple(humps)).along(arc)
    by_map = likeliest_first(plan, interval, there, math.radians(closest_deg))
    return plan(interval, None, None), by_map, there


def shown(rig, view, there, inverse_ranges):
    pixels, valid = rig.project_to_view(there.arc.bearing(inverse_ranges), view.reading)
    return valid & in_picture(rig.camera(view.reading), pixels)


humps = st.lists(
    st.builds(Hump, mean=st.floats(0.0, 1.4), sigma=st.floats(0.003, 0.3), share=st.floats(0.0, 0.18)), max_size=4
)


@given(humps=humps, hfov_deg=st.sampled_from([None, 50.0, 8.0]), far=st.floats(0.0, 0.2), near=st.floats(0.4, 1.3))
def test_as_much_is_looked_at_as_without_a_map(rig, humps, hfov_deg, far: float, near: float) -> None:
    plain, by_map, there = planned(rig, humps, hfov_deg, (far, near))
    assert by_map.unreachable == plain.unreachable
    inverse_ranges = there.arc.inverse_range_at(np.linspace(*there.arc.angle_at([far, near]), 200))
    seen = [shown(rig, view, there, inverse_ranges) for view in by_map.views]
    assert np.any(seen, axis=0).all()
    least = min(shown(rig, view, there, inverse_ranges).sum() for view in plain.views)
    if len(plain.views) == 1:
        assert len(by_map.views) == 1, "a copy at the other end of the arc is seen beside the target"
    else:
        assert {view.hfov_rad for view in by_map.views} == {plain.views[0].hfov_rad}
        assert seen[0].sum() >= 0.7 * least
    assert len(by_map.views) <= len(plain.views) + 1


@given(mean=st.floats(0.02, 1.2), hfov_deg=st.sampled_from([15.0, 8.0]))
def test_the_first_look_is_where_the_target_is_expected(rig, mean: float, hfov_deg: float) -> None:
    plain, by_map, there = planned(rig, [Hump(mean=mean, sigma=0.02 * mean, share=0.7)], hfov_deg)
    assert shown(rig, by_map.views[0], there, mean)
    best = max(there.mass(*view.s_interval) for view in plain.views)
    assert there.mass(*by_map.views[0].s_interval) >= best - 0.02


@given(mean=st.floats(0.02, 0.49))
def test_a_single_view_turns_and_zooms_towards_it(rig, mean: float) -> None:
    plain, by_map, there = planned(rig, [Hump(mean=mean, sigma=0.02, share=0.7)], interval=(0.01, 0.5))
    (before,), (after,) = plain.views, by_map.views
    assert after.hfov_rad <= before.hfov_rad
    target = there.arc.bearing(mean)
    off = [float(angle_between(rig.head_from_camera(view.reading)[:, 2], target)) for view in (before, after)]
    assert off[1] <= off[0] + 1e-6


def test_it_zooms_no_closer_than_is_allowed(rig) -> None:
    plain, by_map, _ = planned(rig, [Hump(mean=0.3, sigma=0.02, share=0.7)], closest_deg=180.0)
    assert by_map.views[0].hfov_rad == pytest.approx(plain.views[0].hfov_rad)


@pytest.mark.parametrize("humps", [[], [Hump(mean=0.3, sigma=0.02, share=0.1)], [Hump(mean=3.0, sigma=0.1, share=0.7)]])
def test_with_too_little_known_the_plan_is_the_plain_one(rig, humps) -> None:
    plain, by_map, _ = planned(rig, humps, 8.0)
    assert by_map == plain
    assert by_map.expected is None


def test_a_place_past_the_limits_is_told_as_ever(rig) -> None:
    cut = HeadLimits(pan_deg=(-4, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
    plain, by_map, _ = planned(rig, [Hump(mean=1.2, sigma=0.02, share=0.7)], 8.0, limits=cut)
    assert plain.unreachable
    assert by_map.unreachable == plain.unreachable
    assert all(cut.contains(view.reading) for view in by_map.views)
    assert len(by_map.views) >= len(plain.views)
