"""What holds for every region, view and interval: an answer or an honest refusal, never an exception."""

import dataclasses

import numpy as np
import pytest

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.unified import UnifiedCamera
from ptzd.matching.job import match
from ptzd.matching.place import Place
from ptzd.model import Box, HeadReading, Matcher, MatchResult

BOX = Box(x=300, y=220, w=40, h=40)


def honest(result: MatchResult) -> bool:
    """Whether every number of an answer is finite and in its range."""
    return np.isfinite([result.texture, *result.coverage]).all() and all(
        np.isfinite([c.pan_rad, c.tilt_rad, c.offset_rad, c.sharpness, *c.plane, *np.ravel(c.box_px)]).all()
        and -1.0 <= c.score <= 1.0
        and 0.0 <= c.in_view <= 1.0
        and 0.0 <= c.inverse_range < np.inf
        and 0.0 < c.sigma_rad < np.inf
        for c in result.candidates
    )


def resized(world, lab, scale: float):
    """The world before a fisheye of other size and like field of view."""
    camera = world.rig.fisheye
    width, height = (round(side * scale) for side in camera.size_px)
    fisheye = UnifiedCamera(
        size_px=(width, height),
        fx=camera.fx * scale,
        fy=camera.fy * scale,
        cx=(camera.cx + 0.5) * scale - 0.5,
        cy=(camera.cy + 0.5) * scale - 0.5,
        xi=camera.xi,
        max_angle_rad=camera.max_angle_rad,
    )
    return lab.World(rig=dataclasses.replace(world.rig, fisheye=fisheye), planes=world.planes)


@pytest.mark.parametrize("matcher", list(Matcher))
@pytest.mark.parametrize("side", [1, 3, 8, 400])
def test_boxes_of_any_size(world, matcher, side):
    box = Box(x=320.2 - side / 2, y=240.4 - side / 2, w=side, h=side)
    drawn = np.resize(world.fisheye(BOX)[220:260, 300:340], (480, 640))
    inputs = world.inputs(BOX, world.aimed(BOX), fisheye_grey=drawn)
    assert honest(match(dataclasses.replace(inputs, box=box), matcher))


@pytest.mark.parametrize("matcher", list(Matcher))
def test_narrow_boxes(world, matcher):
    for box in (Box(x=250, y=238, w=120, h=4), Box(x=318, y=180, w=3, h=120)):
        assert honest(match(world.inputs(box, world.aimed(BOX)), matcher))


def test_a_fisheye_of_many_pixels(world, lab):
    large = resized(world, lab, 4.8)
    box = Box(x=1500, y=1100, w=200, h=180)
    result = match(large.inputs(box, large.aimed(box, (1.0, 1.0)), noise=1.0), Matcher.SWEEP)
    assert honest(result)
    assert large.error_deg(box, result.candidates[0]) < 0.05


@pytest.mark.parametrize("matcher", list(Matcher))
@pytest.mark.parametrize("interval", [(0.0, 0.0), (0.0, 1e-6), (0.0, 50.0), (0.3, 0.3), (3.0, 1e4)])
def test_any_interval_of_ranges(world, matcher, interval):
    assert honest(match(world.inputs(BOX, world.aimed(BOX), inverse_range=interval), matcher))


@pytest.mark.parametrize("matcher", list(Matcher))
def test_boxes_around_the_image_circle(world, matcher):
    camera = world.rig.fisheye
    rim, _ = camera.project([np.sin(camera.limit_rad - 1e-6), 0.0, np.cos(camera.limit_rad - 1e-6)])
    for shift in (-30.0, -20.0, -10.0, 0.0):
        box = Box(x=rim[0] + shift - 15, y=rim[1] - 15, w=30, h=30)
        assert honest(match(world.inputs(box, HeadReading(pan_deg=80.0, tilt_deg=0.0, zoom=1.0)), matcher))


@pytest.mark.parametrize("matcher", list(Matcher))
def test_views_that_show_ever_less(world, matcher):
    for pan_deg in (10.0, 25.0, 29.0, 33.0, 120.0):
        assert honest(match(world.inputs(BOX, world.aimed(BOX, (pan_deg, 0.0))), matcher))


def test_boxes_around_the_epipole(lab, textures):
    rig = lab.make_rig(rotvec_deg=(0.0, 0.0, 0.0), translation=(0.0, 0.0, -0.4))
    world = lab.World(rig=rig, planes=(lab.wall(textures[0]),))
    centre, _ = rig.fisheye.project(np.array([0.0, 0.0, 1.0]))
    for shift in (0.0, 0.3, 2.0, 15.0):
        box = Box(x=centre[0] + shift - 16, y=centre[1] - 16, w=32, h=32)
        result = match(world.inputs(box, world.aimed(box, (1.0, 1.0)), noise=1.0), Matcher.SWEEP)
        assert honest(result)
        assert world.error_deg(box, result.candidates[0]) < 0.05


def test_a_plane_before_both_cameras_leaves_no_residual(world):
    """The homography of the true plane carries every ray of the region to where the head sees its point."""
    rig, plane = world.rig, world.planes[0]
    ray, _ = rig.fisheye.lift(np.array(BOX.centre))
    arc = EpipolarArc.of(rig, ray, 0.0, 1.0)
    normal = rig.head_from_fisheye_rotation @ plane.normal / plane.distance
    warp = Place(planes=normal[None], offset=np.zeros(1), roll=np.zeros(1)).warps(arc)[0]
    for corner in BOX.corners:
        seen = warp @ (rig.head_from_fisheye_rotation @ rig.fisheye.lift(np.array(corner))[0])
        assert np.allclose(seen / np.linalg.norm(seen), world.truth(corner)[0], atol=1e-12)
