import dataclasses

import numpy as np
import pytest

from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing, rotation_from_rotvec
from ptzd.matching.job import match
from ptzd.model import Box, HeadReading, Matcher

BOX = Box(x=290, y=210, w=32, h=32)


def best(inputs):
    result = match(inputs, Matcher.SWEEP)
    return result.candidates[0], result


@pytest.mark.parametrize(("side", "limit_deg"), [(8, 0.15), (14, 0.08), (24, 0.05), (40, 0.04), (90, 0.04), (200, 0.1)])
def test_a_plane_is_found_to_a_fraction_of_a_pixel(world, side, limit_deg):
    box = Box(x=315.3 - side / 2, y=232.7 - side / 2, w=side, h=side)
    candidate, result = best(world.inputs(box, world.aimed(BOX, (3.0, -2.0)), noise=1.5, band_deg=0.5))
    _, s = world.truth(box.centre)
    assert world.error_deg(box, candidate) < limit_deg
    assert candidate.inverse_range == pytest.approx(s, abs=0.01)
    assert np.dot(
        candidate.plane, world.rig.head_from_fisheye_rotation @ world.rig.fisheye.lift(np.array(box.centre))[0]
    ) == pytest.approx(candidate.inverse_range, abs=1e-6)
    assert candidate.score > 0.8
    assert result.texture > 5


def test_box_through_the_plane_surrounds_the_setpoint(world):
    candidate, result = best(world.inputs(BOX, reading := world.aimed(BOX, (3.0, -2.0))))
    x, y = world.rig.project_to_view(bearing(candidate.pan_rad, candidate.tilt_rad), reading)[0]
    corners = np.array(candidate.box_px)
    assert corners.shape == (4, 2)
    assert (corners.min(axis=0) < [x, y]).all()
    assert (corners.max(axis=0) > [x, y]).all()
    assert result.coverage[0] <= candidate.inverse_range <= result.coverage[1]


def test_rotating_both_frames_rotates_the_answer(world):
    """The same pictures with the head's pan axis counted from elsewhere."""
    reading = world.aimed(BOX, (1.0, 2.0))
    inputs = world.inputs(BOX, reading)
    turn = rotation_from_rotvec([0.0, np.radians(25.0), 0.0])
    rig = world.rig
    turned = Rig(
        fisheye=rig.fisheye,
        zoom=rig.zoom,
        head=rig.head,
        head_from_fisheye_rotation=turn @ rig.head_from_fisheye_rotation,
        head_from_fisheye_translation=turn @ rig.head_from_fisheye_translation,
        metric=True,
    )
    moved = HeadReading(pan_deg=reading.pan_deg + 25.0, tilt_deg=reading.tilt_deg, zoom=reading.zoom)
    one, _ = best(inputs)
    other, _ = best(dataclasses.replace(inputs, rig=turned, reading=moved))
    assert other.pan_rad - one.pan_rad == pytest.approx(np.radians(25.0), abs=2e-4)
    assert other.tilt_rad == pytest.approx(one.tilt_rad, abs=2e-4)
    assert other.score == pytest.approx(one.score, abs=0.02)


def test_wrong_extrinsics_inside_the_band_are_measured_as_offset(world, lab):
    rig = world.rig
    ray, _ = rig.fisheye.lift(np.array(BOX.centre))
    direction = rig.head_from_fisheye_rotation @ ray
    baseline = rig.head_from_fisheye_translation / np.linalg.norm(rig.head_from_fisheye_translation)
    axis = baseline - (baseline @ direction) * direction
    wrong = rotation_from_rotvec(np.radians(0.8) * axis / np.linalg.norm(axis)) @ rig.head_from_fisheye_rotation
    changed = Rig(
        fisheye=rig.fisheye,
        zoom=rig.zoom,
        head=rig.head,
        head_from_fisheye_rotation=wrong,
        head_from_fisheye_translation=rig.head_from_fisheye_translation,
        metric=True,
    )
    candidate, _ = best(dataclasses.replace(world.inputs(BOX, world.aimed(BOX), band_deg=1.2), rig=changed))
    assert world.error_deg(BOX, candidate) < 0.1
    assert np.degrees(abs(candidate.offset_rad)) == pytest.approx(0.8, abs=0.15)


def test_infinitely_far_is_within_reach(lab, textures):
    world = lab.World(rig=lab.make_rig(), planes=(lab.wall(textures[0], distance=400.0),))
    far = dataclasses.replace(world.planes[0], texture=textures[1])
    assert far.distance == 400.0
    scaled = lab.World(rig=lab.make_rig(translation=(-0.005, -0.001, -0.0005)), planes=(lab.wall(textures[0]),))
    box = BOX
    candidate, _ = best(scaled.inputs(box, scaled.aimed(box), inverse_range=(0.0, 1.0), noise=1.0))
    assert scaled.error_deg(box, candidate) < 0.05
    assert candidate.inverse_range >= 0.0


def test_a_region_on_the_epipole_needs_no_range(lab, textures):
    ahead = lab.make_rig(rotvec_deg=(0.0, 0.0, 0.0), translation=(0.0, 0.0, -0.4))
    world = lab.World(rig=ahead, planes=(lab.wall(textures[0]),))
    centre, _ = ahead.fisheye.project(np.array([0.0, 0.0, 1.0]))
    box = Box(x=centre[0] - 16, y=centre[1] - 16, w=32, h=32)
    candidate, _ = best(world.inputs(box, world.aimed(box, (1.0, 1.0)), noise=1.0))
    assert world.error_deg(box, candidate) < 0.05
    assert candidate.score > 0.8


def test_a_box_over_the_edge_of_the_image_circle(lab, textures):
    rig = lab.make_rig(rotvec_deg=(0.0, 0.0, 0.0))
    side = lab.wall(textures[0], distance=2.0, normal=(1.0, 0.0, 0.3))
    world = lab.World(rig=rig, planes=(side,))
    limit = rig.fisheye.limit_rad
    edge, _ = rig.fisheye.project([np.sin(limit - 1e-3), 0.0, np.cos(limit - 1e-3)])
    box = Box(x=edge[0] - 24, y=edge[1] - 15, w=30, h=30)
    candidate, _ = best(world.inputs(box, world.aimed(box), noise=1.0))
    assert world.error_deg(box, candidate) < 0.15


def test_view_that_shows_a_part_of_the_region(world):
    reading = world.aimed(BOX, (27.0, 0.0))
    candidate, _ = best(world.inputs(BOX, reading, noise=1.0))
    assert candidate.in_view < 0.9
    assert world.error_deg(BOX, candidate) < 0.15


@pytest.mark.parametrize("zoom", [5000.0, 9999.0])
def test_zoomed_views_narrower_than_the_region(world, zoom):
    reading = world.aimed(BOX, (0.5, 0.3), zoom)
    _, s = world.truth(BOX.centre)
    candidate, _ = best(world.inputs(BOX, reading, noise=1.0, inverse_range=(s - 0.05, s + 0.05), band_deg=0.3))
    assert world.error_deg(BOX, candidate) < 0.1
    if zoom > 9000:
        assert candidate.in_view < 0.6


def test_distorted_views(lab, textures):
    world = lab.World(rig=lab.make_rig(distortion=(-0.2, 0.05, 0.001, -0.001, 0.0)), planes=(lab.wall(textures[0]),))
    candidate, _ = best(world.inputs(BOX, world.aimed(BOX, (10.0, -8.0)), noise=1.0))
    assert world.error_deg(BOX, candidate) < 0.05


def test_region_in_no_view_scores_low(world):
    elsewhere = Box(x=200, y=120, w=32, h=32)
    inputs = world.inputs(BOX, world.aimed(BOX), noise=1.0)
    inputs = dataclasses.replace(inputs, fisheye_grey=np.roll(world.fisheye(elsewhere, 1.0), (90, 90), (0, 1)))
    result = match(inputs, Matcher.SWEEP)
    assert result.candidates[0].score < 0.55


def test_view_that_cannot_show_the_arc_has_no_candidates(world):
    reading = world.aimed(BOX, (120.0, 0.0))
    result = match(world.inputs(BOX, reading), Matcher.SWEEP)
    assert result.candidates == ()
    assert result.coverage == (0.0, 0.0)


def test_box_that_the_fisheye_does_not_see_has_no_texture(world):
    inputs = world.inputs(BOX, world.aimed(BOX))
    result = match(dataclasses.replace(inputs, box=Box(x=-60, y=-60, w=20, h=20)), Matcher.SWEEP)
    assert result.texture == 0.0
    assert result.candidates == ()


def test_noise_alone_is_texture_free(world):
    inputs = world.inputs(BOX, world.aimed(BOX))
    rng = np.random.default_rng(0)
    for sigma in (0.0, 3.0, 15.0):
        grey = np.clip(np.round(120 + rng.normal(0, 1, (480, 640)) * sigma), 0, 255).astype(np.uint8)
        assert match(dataclasses.replace(inputs, fisheye_grey=grey), Matcher.SWEEP).texture < 1.0


@pytest.mark.parametrize(
    "change",
    [lambda v: 0.5 * v + 20, lambda v: 255 * (v / 255) ** 1.8, lambda v: 255 - 0.8 * v],
    ids=["gain", "gamma", "reversed"],
)
def test_illumination_does_not_matter(world, change):
    inputs = world.inputs(BOX, world.aimed(BOX, (2.0, 1.0)), noise=1.0)
    view = np.clip(np.round(change(inputs.view_grey.astype(float))), 0, 255).astype(np.uint8)
    candidate, _ = best(dataclasses.replace(inputs, view_grey=view))
    assert world.error_deg(BOX, candidate) < 0.05
    assert candidate.score > 0.75


@pytest.mark.parametrize("share", [0.2, 0.3])
def test_an_occluder_in_the_view_does_not_pull(world, textures, share):
    reading = world.aimed(BOX, (2.0, 1.0))
    clean, _ = best(world.inputs(BOX, reading, noise=1.0))
    corners = np.array(clean.box_px)
    (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0)
    view = world.view(reading, 1.0).copy()
    wide = int((right - left) * share)
    view[int(top) : int(bottom), int(left) : int(left) + wide] = textures[2][
        100 : 100 + int(bottom) - int(top), 50 : 50 + wide
    ]
    candidate, _ = best(world.inputs(BOX, reading, noise=1.0, view_grey=view))
    assert world.error_deg(BOX, candidate) < 0.1


def test_a_view_of_nothing_alike_still_gets_an_answer(world):
    """Scores may all be negative in a narrow search."""
    inputs = world.inputs(BOX, world.aimed(BOX), inverse_range=(0.3, 0.31), band_deg=0.1)
    fisheye = inputs.fisheye_grey.copy()
    fisheye[210:242, 290:322] = np.where((np.arange(32) // 4) % 2, 200, 50)
    view = np.broadcast_to(np.where((np.arange(240) // 9)[:, None] % 2, 190, 60), (240, 320)).astype(np.uint8)
    result = match(dataclasses.replace(inputs, fisheye_grey=fisheye, view_grey=view), Matcher.SWEEP)
    assert result.candidates
    assert result.candidates[0].score < 0.3
