import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ptzd.control.planning.views import MAX_MARGIN_SHARE, plan_views
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import angle_between, rotation_from_rotvec
from ptzd.geometry.types import in_picture, pixel_angle_rad
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, HeadLimits, HeadReading

FREE = HeadLimits(pan_deg=(-180, 180), tilt_deg=(-90, 90), zoom=(1, 9999), endless_pan=True)
V5915 = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-20, 90), zoom=(1, 9999))
HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1)
MIDDLE = Box(x=300, y=220, w=30, h=30)
BARREL = (-0.15, 0.03, 5e-4, -5e-4, 0.0)
NONE = (0.0, 0.0, 0.0, 0.0, 0.0)


def make_rig(rotvec=(0.0, 0.0, 0.0), translation=(-0.5, -0.1, -0.05), *, misalignment=(0.0, 0.0, 0.0), **given_):
    values = SimpleNamespace(**({"pan": Axis(), "tilt": Axis(), "distortion": NONE, "cx": 319.5, "xi": 1.2} | given_))
    focals = ((1, 554.3), (2500, 1100.0), (5000, 2200.0), (9999, 9000.0))
    entries = [ZoomEntry(zoom=z, fx=f, fy=f, cx=values.cx, cy=239.5, distortion=values.distortion) for z, f in focals]
    return Rig(
        fisheye=UnifiedCamera(
            size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=values.xi, max_angle_rad=math.radians(92)
        ),
        zoom=ZoomTable(size_px=(640, 480), entries=tuple(entries)),
        head=HeadModel(pan=values.pan, tilt=values.tilt, camera_rotvec_rad=misalignment),
        head_from_fisheye_rotation=rotation_from_rotvec(np.array(rotvec)),
        head_from_fisheye_translation=np.array(translation),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=0.0035, translation=0.005, head_rad=0.001),
    )


def margins(rig, box, interval, arc):
    """Radius of region and band, as far as a view can hold them."""
    x, y = box.centre
    border = [*box.corners, (x, box.y), (x, box.y + box.h), (box.x, y), (box.x + box.w, y)]
    rays, valid = rig.fisheye.lift(np.array(border))
    centre = rig.fisheye.lift(np.array(box.centre))[0]
    fine = np.linspace(*interval, 2000)
    band = rig.band_rad(float(arc.head_inverse_range(fine).max()))
    return float(angle_between(centre, rays[valid]).max()) * float(arc.magnification(fine).max()) + band


def discs(arc, values, radius):
    """Rim of the disc around each direction of the arc, shape (n, 24, 3)."""
    turns = np.linspace(0.0, 2 * math.pi, 24, endpoint=False)
    middle = arc.bearing(values)
    ahead = np.cross(arc.normal, middle)
    rim = np.cos(turns)[None, :, None] * ahead[:, None] + np.sin(turns)[None, :, None] * arc.normal
    return math.cos(radius) * middle[:, None] + math.sin(radius) * rim


def shown(rig, view, points):
    """Which of the discs are whole in the picture of the view."""
    pixels, valid = rig.project_to_view(points, view.reading)
    camera = rig.camera(view.reading)
    return (valid & in_picture(camera, pixels, margin_px=-1e-6)).all(axis=-1)


ANGLE = st.floats(-0.5, 0.5)
RIGS = st.builds(
    make_rig,
    rotvec=st.tuples(ANGLE, ANGLE, st.floats(-3.0, 3.0)),
    translation=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: math.hypot(*v) > 0.1),
    misalignment=st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-1.5, 1.5)),
    pan=st.builds(Axis, sign=st.sampled_from([-1, 1]), scale=st.floats(0.98, 1.02), offset_rad=st.floats(-3.0, 3.0)),
    tilt=st.builds(Axis, sign=st.sampled_from([-1, 1]), offset_rad=st.floats(-0.1, 0.1)),
    distortion=st.sampled_from([NONE, BARREL]),
    cx=st.sampled_from([319.5, 330.0]),
)
BOXES = st.builds(Box, x=st.floats(180, 420), y=st.floats(80, 360), w=st.floats(8, 40), h=st.floats(8, 40))
INTERVALS = st.tuples(st.floats(0.0, 0.3), st.floats(0.3, 1.5))
LIMITS = st.one_of(
    st.just(FREE),
    st.just(V5915),
    st.builds(
        HeadLimits,
        pan_deg=st.tuples(st.floats(-180, -5), st.floats(5, 180)),
        tilt_deg=st.tuples(st.floats(-90, -1), st.floats(1, 90)),
        zoom=st.just((1.0, 9999.0)),
    ),
)
HFOVS = st.one_of(st.none(), st.floats(0.1, 1.0))


@given(RIGS, BOXES, INTERVALS, LIMITS, HFOVS)
def test_every_direction_that_is_not_reported_unreachable_is_whole_in_a_view(rig, box, interval, limits, hfov_rad):
    plan = plan_views(rig, box, interval, limits, HOME, hfov_rad=hfov_rad)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], *interval)
    assume(not arc.degenerate)
    hfov = plan.views[0].hfov_rad if plan.views else 0.1
    radius = min(margins(rig, box, interval, arc), MAX_MARGIN_SHARE * 0.36 * hfov)
    values = arc.steps(max(arc.length_rad / 60, 1e-4))
    points = discs(arc, values, radius * (1 - 1e-9))
    covered = np.zeros(len(values), dtype=bool)
    for view in plan.views:
        whole = shown(rig, view, points)
        low, high = view.s_interval
        assert whole[(values >= low) & (values <= high)].all()
        covered |= whole
        assert limits.contains(view.reading)
    for low, high in plan.unreachable:
        assert interval[0] <= low < high <= interval[1]
        covered |= (values >= low) & (values <= high)
    assert covered.all()


@given(RIGS, BOXES, INTERVALS, LIMITS, HFOVS, st.floats(-170, 170), st.floats(-60, 60))
def test_the_walk_goes_one_way_from_the_nearer_end(rig, box, interval, limits, hfov_rad, pan, tilt):
    present = HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=1)
    plan = plan_views(rig, box, interval, limits, present, hfov_rad=hfov_rad)
    starts = [view.s_interval[0] for view in plan.views]
    ends = [view.s_interval[1] for view in plan.views]
    assert starts in (sorted(starts), sorted(starts, reverse=True))
    assert ends in (sorted(ends), sorted(ends, reverse=True))
    if len(plan.views) > 1:

        def travel(view):
            turn = view.reading.pan_deg - pan
            turn = (turn + 180) % 360 - 180 if limits.endless_pan else turn
            return max(abs(turn), abs(view.reading.tilt_deg - tilt))

        assert travel(plan.views[0]) <= travel(plan.views[-1])


@given(RIGS, BOXES, INTERVALS)
def test_nothing_is_unreachable_for_a_free_head(rig, box, interval):
    plan = plan_views(rig, box, interval, FREE, HOME)
    assert plan.views
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], *interval)
    poles = [abs(float(arc.bearing(s)[1])) for s in arc.steps(0.01)]
    assume(max(poles) < 0.99)
    assert plan.unreachable == ()


@given(BOXES, st.floats(1.2, 5.0))
def test_a_usual_arc_needs_one_view_that_centres_it(box, near):
    rig = make_rig()
    interval = (0.01, 1 / near)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], *interval)
    plan = plan_views(rig, box, interval, FREE, HOME)
    assume(arc.length_rad < math.radians(15) and len(plan.views) == 1)
    middle = arc.bearing(arc.inverse_range_at(0.5 * (arc.angle_at(interval[0]) + arc.angle_at(interval[1]))))
    axis = rig.head_from_camera(plan.views[0].reading) @ [0, 0, 1]
    assert angle_between(axis, middle) < 1e-6
    assert plan.views[0].s_interval == interval


def test_the_plan_is_not_wasteful():
    rig = make_rig()
    for hfov in (1.0, 0.6, 0.4):
        plan = plan_views(rig, MIDDLE, (0.0, 1.0), FREE, HOME, hfov_rad=hfov)
        arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(MIDDLE.centre))[0], 0.0, 1.0)
        margin = margins(rig, MIDDLE, (0.0, 1.0), arc)
        useful = plan.views[0].hfov_rad - 2 * margin
        assert len(plan.views) <= math.ceil(1.15 * arc.length_rad / useful)


def test_a_pixel_of_the_view_is_as_fine_as_the_fisheyes_and_no_finer_than_needed():
    coarse = plan_views(make_rig(), MIDDLE, (0.1, 0.3), FREE, HOME)
    assert coarse.views[0].reading.zoom == 1.0
    rig = make_rig(xi=0.0)
    fine = Rig(
        fisheye=UnifiedCamera(
            size_px=(6400, 4800), fx=900.0, fy=900.0, cx=3199.5, cy=2399.5, xi=0.0, max_angle_rad=1.2
        ),
        zoom=rig.zoom,
        head=rig.head,
        head_from_fisheye_rotation=rig.head_from_fisheye_rotation,
        head_from_fisheye_translation=rig.head_from_fisheye_translation,
        metric=True,
        uncertainty=rig.uncertainty,
    )
    box = Box(x=3180, y=2380, w=30, h=30)
    plan = plan_views(fine, box, (0.0, 0.0), FREE, HOME)
    zoom = plan.views[0].reading.zoom
    assert zoom == round(zoom)
    size = pixel_angle_rad(fine.fisheye, box.centre)
    assert 1 / rig.zoom.camera_at(zoom).fx <= size
    assert 1 / rig.zoom.camera_at(zoom - 1).fx > size
    narrow = HeadLimits(pan_deg=(-180, 180), tilt_deg=(-90, 90), zoom=(1, 5), endless_pan=True)
    assert plan_views(fine, box, (0.0, 0.0), narrow, HOME).views[0].reading.zoom == 5.0


def test_a_field_of_view_asked_for_is_kept_to_a_zoom_unit():
    plan = plan_views(make_rig(), MIDDLE, (0.0, 0.5), FREE, HOME, hfov_rad=0.4)
    assert plan.views[0].hfov_rad == pytest.approx(0.4, rel=1e-3)
    assert plan.views[0].reading.zoom == round(plan.views[0].reading.zoom)


def test_between_whole_units_the_zoom_is_as_it_is():
    fractional = HeadLimits(pan_deg=(-180, 180), tilt_deg=(-90, 90), zoom=(1.2, 1.8), endless_pan=True)
    assert plan_views(make_rig(), MIDDLE, (0.0, 0.5), fractional, HOME).views[0].reading.zoom == 1.2
    hfov = make_rig().zoom.camera_at(1.5).hfov_rad
    plan = plan_views(make_rig(), MIDDLE, (0.0, 0.5), fractional, HOME, hfov_rad=hfov)
    assert plan.views[0].reading.zoom == pytest.approx(1.5, abs=1e-3)


def test_an_axis_outside_the_limits_still_shows_what_its_picture_reaches():
    rig = make_rig()
    box = Box(x=305, y=290, w=30, h=30)
    direction = rig.fisheye.lift(np.array(box.centre))[0]
    tilt = math.degrees(math.asin(-direction[1]))
    below = HeadLimits(pan_deg=(-170, 170), tilt_deg=(tilt + 5, 90), zoom=(1, 9999))
    plan = plan_views(rig, box, (0.0, 0.05), below, HOME)
    assert plan.unreachable == ()
    assert [view.reading.tilt_deg for view in plan.views] == [tilt + 5]
    far_below = HeadLimits(pan_deg=(-170, 170), tilt_deg=(tilt + 25, 90), zoom=(1, 9999))
    plan = plan_views(rig, box, (0.0, 0.05), far_below, HOME)
    assert plan.views == ()
    assert plan.unreachable == ((0.0, 0.05),)


def test_a_stop_in_the_middle_of_the_arc_leaves_a_gap_between_views():
    rig = make_rig(pan=Axis(offset_rad=math.pi), translation=(-3.0, 0.0, 0.0))
    stop = HeadLimits(pan_deg=(-150, 150), tilt_deg=(-90, 90), zoom=(1, 9999))
    box = Box(x=385, y=225, w=30, h=30)
    plan = plan_views(rig, box, (0.0, 0.6), stop, HOME, hfov_rad=0.3)
    (gap,) = plan.unreachable
    assert any(view.s_interval[1] <= gap[0] for view in plan.views)
    assert any(view.s_interval[0] >= gap[1] for view in plan.views)
    assert all(stop.contains(view.reading) for view in plan.views)


def test_an_endless_head_crosses_half_a_turn_without_turning_back():
    rig = make_rig(pan=Axis(offset_rad=math.pi), translation=(-3.0, 0.0, 0.0))
    box = Box(x=330, y=225, w=30, h=30)
    present = HeadReading(pan_deg=-179.0, tilt_deg=0.0, zoom=1)
    plan = plan_views(rig, box, (0.0, 0.6), FREE, present, hfov_rad=0.3)
    pans = np.unwrap(np.radians([view.reading.pan_deg for view in plan.views]))
    assert plan.unreachable == ()
    assert len(pans) > 2
    assert np.abs(np.degrees(np.diff(pans))).max() < 20.0


def test_on_the_baseline_one_view_shows_all():
    rig = make_rig(translation=(0.0, 0.0, -0.5))
    box = Box(x=309.5, y=229.5, w=20, h=20)
    plan = plan_views(rig, box, (0.0, 0.5), FREE, HOME)
    assert [view.s_interval for view in plan.views] == [(0.0, 0.5)]
    assert (plan.views[0].reading.pan_deg, plan.views[0].reading.tilt_deg) == pytest.approx((0.0, 0.0))


def test_through_the_head_the_target_is_before_or_behind_it():
    rig = make_rig(translation=(0.0, 0.0, -0.5))
    box = Box(x=309.5, y=229.5, w=20, h=20)
    plan = plan_views(rig, box, (0.0, 4.0), FREE, HOME)
    assert [abs(view.reading.pan_deg) for view in plan.views] == pytest.approx([0.0, 180.0])
    assert plan.views[0].s_interval == (0.0, pytest.approx(2.0, rel=1e-5))
    ahead_only = HeadLimits(pan_deg=(-90, 90), tilt_deg=(-90, 90), zoom=(1, 9999))
    plan = plan_views(rig, box, (0.0, 4.0), ahead_only, HOME)
    assert len(plan.views) == 1
    assert plan.unreachable == ((pytest.approx(2.0, rel=1e-5), 4.0),)


def test_a_region_larger_than_the_view_is_planned_by_its_middle():
    plan = plan_views(make_rig(), Box(x=200, y=120, w=240, h=240), (0.1, 0.3), FREE, HOME, hfov_rad=0.3)
    assert plan.views
    assert plan.unreachable == ()


def test_band_and_overlap_are_room_around_the_region():
    rig, box, interval = make_rig(), Box(x=310, y=230, w=10, h=10), (0.0, 1.0)
    narrow = plan_views(rig, box, interval, FREE, HOME, hfov_rad=0.6, band_rad=0.0)
    wide = plan_views(rig, box, interval, FREE, HOME, hfov_rad=0.6, band_rad=0.05)
    padded = plan_views(rig, box, interval, FREE, HOME, hfov_rad=0.6, band_rad=0.0, overlap_rad=0.05)
    assert [len(plan.views) for plan in (narrow, wide)] == [1, 2]
    assert padded == wide


def test_the_band_is_asked_for():
    rig = make_rig()
    unknown = Rig(**{name: getattr(rig, name) for name in rig.__slots__ if name != "uncertainty"}, uncertainty=None)
    with pytest.raises(CalibrationError, match="uncertainty"):
        plan_views(unknown, MIDDLE, (0.0, 0.5), FREE, HOME)
    assert plan_views(unknown, MIDDLE, (0.0, 0.5), FREE, HOME, band_rad=0.01).views


@pytest.mark.parametrize(
    ("rig", "box", "limits", "hfov_rad", "message"),
    [
        ({}, Box(x=0, y=0, w=10, h=10), FREE, None, "outside the fisheye's image circle"),
        (
            {},
            MIDDLE,
            HeadLimits(pan_deg=(-9, 9), tilt_deg=(-9, 9), zoom=(10000, 12000)),
            None,
            "zoom: calibrated 1 to 9999",
        ),
        ({}, MIDDLE, HeadLimits(pan_deg=(-9, 9), tilt_deg=(-9, 9), zoom=(1, 100)), 0.2, "both calibrated and allowed"),
        ({}, MIDDLE, FREE, 2.0, "field of view"),
        ({"distortion": (-0.9, 0.0, 0.0, 0.0, 0.0)}, MIDDLE, FREE, None, "folds inside the PTZ's picture"),
        ({"cx": 700.0}, MIDDLE, FREE, None, "principal point"),
    ],
)
def test_what_cannot_be_planned_says_why(rig, box, limits, hfov_rad, message):
    with pytest.raises(GeometryError, match=message):
        plan_views(make_rig(**rig), box, (0.0, 0.5), limits, HOME, hfov_rad=hfov_rad)


@pytest.mark.bench
def test_planning_takes_milliseconds():
    rig = make_rig()
    for box in (MIDDLE, Box(x=200, y=150, w=30, h=30)):
        plan_views(rig, box, (0.01, 0.67), V5915, HOME)
        begin = time.process_time()
        for _ in range(50):
            plan_views(rig, box, (0.01, 0.67), V5915, HOME)
        took_ms = (time.process_time() - begin) * 1e3 / 50
        print(f"plan_views: {took_ms:.2f} ms")
        assert took_ms < 50.0
