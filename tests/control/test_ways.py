"""No way the head takes leads through a no-go zone, however its axes run ahead of each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ptzd.control.planning.grid import axes_at, walk
from ptzd.control.planning.reach import Reach
from ptzd.control.planning.span import Span
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.outline import Outline
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.geometry.zones import Zone
from ptzd.model import HeadLimits, HeadReading, HeadSpeed, ZoneKind

HEAD = HeadModel(
    pan=Axis(offset_rad=0.03), tilt=Axis(sign=-1, offset_rad=-0.02), camera_rotvec_rad=(0.004, -0.003, 0.007)
)
FIXED = HeadLimits(pan_deg=(-170.0, 170.0), tilt_deg=(-90.0, 20.0), zoom=(1.0, 9999.0))
ENDLESS = HeadLimits(pan_deg=(-180.0, 180.0), tilt_deg=(-90.0, 20.0), zoom=(1.0, 9999.0), endless_pan=True)


def patch(pan_deg: float, tilt_deg: float, wide_deg: float, high_deg: float) -> Outline:
    """A quadrangle around a direction of the head frame."""
    pans = np.radians([pan_deg - wide_deg, pan_deg + wide_deg, pan_deg + wide_deg, pan_deg - wide_deg])
    tilts = np.radians([tilt_deg - high_deg, tilt_deg - high_deg, tilt_deg + high_deg, tilt_deg + high_deg])
    return Outline(bearing(pans, tilts))


def zone(*outlines: Outline, kind: ZoneKind = ZoneKind.NO_GO, name: str = "zone") -> Zone:
    return Zone(name=name, kind=kind, head_outlines=outlines, fisheye_outlines=outlines)


def at(pan_deg: float, tilt_deg: float, zoom: float = 1.0) -> HeadReading:
    return HeadReading(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=zoom)


def way(reach: Reach, start: HeadReading, end: HeadReading) -> tuple[HeadReading, ...] | None:
    return reach.way(Span.at(start), end, start.zoom) if reach.contains(end) else None


outlines = st.builds(patch, st.floats(-180, 180), st.floats(-60, 40), st.floats(0.7, 30.0), st.floats(0.2, 25.0))
zones = st.lists(outlines.map(zone), min_size=1, max_size=3)
places = st.builds(at, st.floats(-169, 169), st.floats(-89, 19))
limits_of = st.sampled_from([FIXED, ENDLESS])


@pytest.fixture(scope="module")
def askew(rig: Rig) -> Rig:
    """A rig whose axes count otherwise and whose camera sits askew."""
    return Rig(
        fisheye=rig.fisheye,
        zoom=rig.zoom,
        head=HEAD,
        head_from_fisheye_rotation=np.eye(3),
        head_from_fisheye_translation=np.array([0.1, 0.0, 0.0]),
        metric=True,
    )


def poses_between(start: HeadReading, end: HeadReading, *, endless: bool) -> np.ndarray:
    """Axes all over the rectangle that the two motors may be in on their way, ``(n, 3)``."""
    turn = end.pan_deg - start.pan_deg
    if endless:
        turn = math.remainder(turn, 360.0)
    shares = np.linspace(0.0, 1.0, 15)
    pans, tilts = np.meshgrid(start.pan_deg + shares * turn, start.tilt_deg + shares * (end.tilt_deg - start.tilt_deg))
    return axes_at(HEAD, pans, tilts).reshape(-1, 3)


@settings(max_examples=30, deadline=None)
@given(zones, places, places, limits_of)
def test_no_pose_that_a_way_allows_lies_in_a_zone(askew, no_go, start, end, limits):
    reach = Reach(limits=limits, rig=askew, no_go=tuple(no_go))
    assume(reach.contains(start))
    found = way(reach, start, end)
    if found is None:
        return
    assert found[-1] == end
    for leg_start, leg_end in zip((start, *found), found, strict=False):
        axes = poses_between(leg_start, leg_end, endless=limits.endless_pan)
        assert not any(outline.contains(axes).any() for one in no_go for outline in one.head_outlines)


@settings(max_examples=30, deadline=None)
@given(zones, places, st.floats(-60, 60), st.floats(-60, 60), st.floats(0.0, 1.0), limits_of)
def test_a_velocity_is_free_for_as_long_as_is_said(askew, no_go, start, pan_deg_s, tilt_deg_s, share, limits):
    reach = Reach(limits=limits, rig=askew, no_go=tuple(no_go))
    assume(reach.contains(start))
    speed = HeadSpeed(pan_deg_s=pan_deg_s, tilt_deg_s=tilt_deg_s, zoom_rate=0.0)
    free_s = reach.free_s(Span.at(start), speed, 3.0)
    assert 0.0 <= free_s <= 3.0
    there = at(start.pan_deg + share * free_s * pan_deg_s, start.tilt_deg + share * free_s * tilt_deg_s)
    if limits.contains(there):
        axes = poses_between(start, there, endless=False)
        assert not any(outline.contains(axes).any() for one in no_go for outline in one.head_outlines)


@settings(max_examples=30, deadline=None)
@given(zones, places, limits_of)
def test_the_nearest_pose_is_one_where_the_head_may_rest(askew, no_go, target, limits):
    reach = Reach(limits=limits, rig=askew, no_go=tuple(no_go))
    found = reach.nearest(target)
    inside = reach.objection(target) is not None
    assert reach.contains(found) or not reach._border
    assert inside or (found.pan_deg, found.tilt_deg) == (target.pan_deg, target.tilt_deg)


@settings(max_examples=30, deadline=None)
@given(outlines, places, st.sampled_from([1.0, 900.0, 5000.0]), limits_of)
def test_no_set_point_points_at_a_privacy_zone_or_zooms_in_beside_it(askew, outline, target, zoom, limits):
    reach = Reach(limits=limits, rig=askew, privacy=(zone(outline, kind=ZoneKind.PRIVACY),))
    pose = at(target.pan_deg, target.tilt_deg, zoom)
    if reach.objection(pose) is not None:
        pose = reach.nearest(pose)
    axis = axes_at(HEAD, np.array(pose.pan_deg), np.array(pose.tilt_deg))
    assert not outline.contains(axis)
    camera = askew.zoom.camera_at(pose.zoom)
    width, height = camera.size_px
    pixels = np.stack(np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)), axis=-1)
    shown = outline.contains(askew.lift_from_view(pixels, pose))
    assert pose.zoom == 1.0 or not shown.any()
    assert reach.leg_free(Span.at(target), pose), "it may be passed"


@given(places, places, limits_of)
def test_without_zones_every_move_is_one_leg(askew, start, end, limits):
    assert way(Reach(limits=limits, rig=askew), start, end) == (end,)


def test_a_zone_in_between_is_gone_around_and_the_zoom_changes_last(askew):
    reach = Reach(limits=FIXED, rig=askew, no_go=(zone(patch(0.0, 10.0, 5.0, 8.0)),))
    found = way(reach, at(-30.0, -10.0, zoom=200.0), at(30.0, -10.0, zoom=900.0))
    assert found is not None
    assert 1 < len(found) <= 4
    assert [corner.zoom for corner in found] == [200.0] * (len(found) - 1) + [900.0]


def test_a_wall_of_zones_across_the_whole_tilt_is_gone_around_only_by_an_endless_head(askew):
    parts = [patch(0.0, tilt, 6.0, 20.0) for tilt in (-60.0, -30.0, 0.0, 30.0, 60.0)]
    pole = Outline(bearing(np.radians([-6.0, 6.0, 180.0]), np.radians([70.0, 70.0, 87.0])))
    wall = zone(*parts, pole, name="wall")
    start, end = at(-40.0, 0.0), at(40.0, 0.0)
    assert way(Reach(limits=FIXED, rig=askew, no_go=(wall,)), start, end) is None
    assert way(Reach(limits=ENDLESS, rig=askew, no_go=(wall,)), start, end) is not None


def test_a_set_point_in_a_zone_is_named(askew):
    reach = Reach(limits=FIXED, rig=askew, no_go=(zone(patch(40.0, 0.0, 5.0, 5.0), name="bedroom"),))
    inside = at(math.degrees(math.radians(40.0) - 0.03), 0.0)
    assert reach.objection(inside) == "in the no_go zone bedroom"
    assert not reach.contains(inside)


def test_a_head_that_stands_in_a_zone_leaves_it(askew):
    reach = Reach(limits=FIXED, rig=askew, no_go=(zone(patch(40.0, 0.0, 5.0, 5.0)),))
    found = way(reach, at(38.0, 0.0), at(0.0, 0.0))
    assert found is not None
    assert found[-1] == at(0.0, 0.0)
    assert all(reach.contains(corner) for corner in found)


@settings(max_examples=20, deadline=None)
@given(st.floats(-170, 170), st.floats(-60, 0), st.floats(0.0, 0.4))
def test_a_zone_thinner_than_a_cell_is_none_the_less_kept_out_of(askew, pan, tilt, wide):
    thin = zone(patch(pan, -tilt, 0.06 + wide, 6.0))
    reach = Reach(limits=ENDLESS, rig=askew, no_go=(thin,))
    middle = HEAD.vapix_from_pan_tilt(*HEAD.aim(bearing(math.radians(pan), math.radians(-tilt))), 1.0)
    assert not reach.contains(middle)
    assert way(reach, at(0.0, 10.0), middle) is None


def test_a_span_of_an_endless_head_goes_over_the_seam():
    span = Span.at(at(170.0, 0.0)).to(at(-170.0, -5.0), endless_pan=True)
    assert span == Span(pan_deg=(170.0, 190.0), tilt_deg=(-5.0, 0.0))


@pytest.mark.parametrize("turn", [180.0, 179.5, -179.7])
def test_half_a_turn_may_go_either_way(turn):
    assert Span.at(at(10.0, 0.0)).to(at(10.0 + turn, 0.0), endless_pan=True).pan_deg == (-180.0, 180.0)


@given(st.integers(0, 2**32 - 1), st.booleans())
def test_a_walk_is_as_short_as_any_and_over_free_cells(seed, wraps):
    chance = np.random.default_rng(seed)
    free = chance.random((8, 11)) > 0.3
    start, end = ((int(chance.integers(8)), int(chance.integers(11))) for _ in range(2))
    steps = {start: 0} if free[start] else {}
    front = list(steps)
    while front:
        cell = front.pop(0)
        for down, aside in ((0, 1), (0, -1), (1, 0), (-1, 0)):
            row, column = cell[0] + down, (cell[1] + aside) % 11 if wraps else cell[1] + aside
            if 0 <= row < 8 and 0 <= column < 11 and free[row, column] and (row, column) not in steps:
                steps[row, column] = steps[cell] + 1
                front.append((row, column))
    found = walk(free, start, end, wraps=wraps)
    assert (None if found is None else len(found) - 1) == (steps.get(end) if free[end] else None)
    assert found is None or (found[0] == start and found[-1] == end and all(free[cell] for cell in found))


@settings(max_examples=30, deadline=None)
@given(zones, places, places)
def test_a_head_past_its_limits_comes_back_through_no_zone_and_by_set_points_within(askew, no_go, start, end):
    limits = HeadLimits(pan_deg=(-60.0, 50.0), tilt_deg=(-45.0, 10.0), zoom=(1.0, 9999.0))
    reach = Reach(limits=limits, rig=askew, no_go=tuple(no_go))
    assume(reach.objection(start) is None)
    found = way(reach, start, end)
    for leg_start, leg_end in zip((start, *(found or ())), found or (), strict=False):
        assert limits.contains(leg_end)
        axes = poses_between(leg_start, leg_end, endless=False)
        assert not any(outline.contains(axes).any() for one in no_go for outline in one.head_outlines)


def test_a_zone_past_the_limits_is_in_the_way_of_a_head_that_others_moved_behind_it(askew):
    limits = HeadLimits(pan_deg=(-60.0, 60.0), tilt_deg=(-45.0, 10.0), zoom=(1.0, 9999.0))
    reach = Reach(limits=limits, rig=askew, no_go=(zone(patch(90.0, 0.0, 6.0, 8.0), name="sun"),))
    assert way(reach, at(120.0, 0.0), at(0.0, 0.0)) is None
    around = way(reach, at(120.0, -40.0), at(0.0, 0.0))
    assert around is not None
    assert len(around) == 2
