"""Laws of a scene: no seams, one truth for both viewpoints, nothing finer than a pixel, errors name the culprit."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

import ptzd.sim
from ptzd.errors import SimulationError
from ptzd.geometry.unified import UnifiedCamera
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.scene_cube import FACES, colour_cube, depth_cube, face_rays

SCENES = Path(ptzd.sim.__file__).parent / "scenes"
PAIRS = sorted(path.parent.name for path in SCENES.glob("pair_*/scene.yaml"))


@pytest.fixture(scope="module")
def room() -> Scene:
    return load_scene("room")


@pytest.fixture(scope="module", params=PAIRS)
def pair(request) -> Scene:
    return load_scene(request.param)


def unit(rays):
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def random_rays(n, seed=1, forward_only=True):
    rays = unit(np.random.default_rng(seed).normal(size=(n, 3)))
    return np.where((rays[:, 2:] < 0) & forward_only, -rays, rays)


def perspective(axis, hfov_deg, size_px):
    """Rays of a square picture along an axis."""
    right = unit(np.cross([0.0, 1.0, 0.0], axis))
    t = (np.arange(size_px) - (size_px - 1) / 2) * 2 * math.tan(math.radians(hfov_deg) / 2) / size_px
    return unit(np.asarray(axis) + t[None, :, None] * right + t[:, None, None] * np.cross(axis, right))


def camera(scene):
    c = scene.camera
    return UnifiedCamera(
        size_px=c.size_px, fx=c.fx, fy=c.fy, cx=c.cx, cy=c.cy, xi=c.xi, distortion=c.distortion,
        max_angle_rad=math.radians(c.max_angle_deg),
    )  # fmt: skip


def picture_rays(scene):
    width, height = scene.camera.size_px
    return camera(scene).lift(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float))


def centre_ray(scene, box):
    ray, valid = camera(scene).lift(np.array(box.centre_px))
    assert valid, box.name
    return ray


def smooth(rays):
    """A colour for every direction that changes slowly."""
    return np.clip(np.round(127.5 + 100 * rays[..., ::-1]), 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def smooth_cube():
    sizes = dict(zip(FACES, (256, 128, 64, 256, 128, 256), strict=True))
    return colour_cube({name: smooth(face_rays(name, size)) for name, size in sizes.items()})


@pytest.mark.parametrize("axis", [(0.3, 0.4, 1), (1, 0.9, 1.1), (-1, 1, -1), (0.02, -1, 0.05), (-1, 0.1, 0.9)])
@pytest.mark.parametrize("per_pixel", [False, True])
def test_no_seam_anywhere_on_a_cube_with_faces_of_different_sizes(smooth_cube, axis, per_pixel):
    rays = perspective(unit(np.array(axis, float)), 100, 240)
    angle = 0.01 if not per_pixel else np.full(rays.shape[:2], 0.013)
    drawn = smooth_cube.sample(rays, angle).astype(int)
    assert np.abs(drawn - smooth(rays)).max() <= 3


def test_every_direction_is_drawn(smooth_cube):
    rays = random_rays(40_000, forward_only=False).reshape(200, 200, 3)
    assert np.abs(smooth_cube.sample(rays, 0.02).astype(int) - smooth(rays)).max() <= 4


def test_detail_finer_than_a_pixel_becomes_grey():
    checks = np.indices((256, 256)).sum(axis=0) % 2
    cube = colour_cube({name: np.repeat(checks[..., None] * 255, 3, axis=2).astype(np.uint8) for name in FACES})
    coarse = cube.sample(perspective((0.0, 0.0, 1.0), 60, 64), math.radians(60 / 64))
    assert np.abs(coarse.astype(int) - 128).max() <= 2


def plane_cube(normal, n=128):
    """Inverse depths of a room of one plane in front: 1 / range = normal . ray, a far sphere elsewhere."""
    faces = {}
    for name, (_, _, forward) in FACES.items():
        rays = face_rays(name, n)
        faces[name] = np.maximum(rays @ normal, 0.05) / (rays @ np.array(forward, float))
    return depth_cube(faces)


def test_depth_of_a_plane_is_exact_between_texels_and_across_faces():
    normal = np.array([0.1, 0.05, 0.3])
    rays = random_rays(4000)
    rays = rays[rays @ normal > 0.06]
    np.testing.assert_allclose(plane_cube(normal).inverse_range(rays), rays @ normal, atol=2e-5)


def test_depth_at_an_edge_is_one_side_or_the_other_never_between():
    step = np.where(np.arange(64) < 30, 0.2, 0.7)
    cube = depth_cube({name: np.tile(step, (64, 1)) for name in FACES})
    u = np.linspace(-0.5, 0.5, 2001)
    rays = unit(np.stack((u, np.zeros_like(u), np.ones_like(u)), axis=-1))
    depth = cube.inverse_range(rays) / rays[:, 2]
    assert np.minimum(np.abs(depth - 0.2), np.abs(depth - 0.7)).max() < 1e-9


def test_truth_lies_on_the_epipolar_arc_at_its_range(room):
    R, T = room.head_from_fisheye_rotation, room.head_from_fisheye_translation_m
    for ray in random_rays(50):
        truth = room.truth(ray)
        np.testing.assert_allclose(truth.bearing_head, unit(R @ ray * truth.range_m + T), atol=1e-12)
        assert abs(np.cross(T, R @ ray) @ truth.bearing_head) < 1e-12
        assert 0.8 < truth.range_m < 9


def test_both_viewpoints_agree_on_the_surface(room):
    """What both see has one place: the depth at the PTZ's viewpoint gives the same point back to 0.02 deg."""
    R, T = room.head_from_fisheye_rotation, room.head_from_fisheye_translation_m
    there, errors = 0, []
    for ray in random_rays(600, seed=5):
        if not room.visible_from_ptz(ray):
            continue
        truth = room.truth(ray)
        s = room.ptz_depth.inverse_range(truth.bearing_head[None])[0]
        back = unit(R.T @ (truth.bearing_head / s - T))
        errors.append(math.degrees(math.acos(min(1.0, float(back @ ray)))))
        there += 1
    assert there > 400
    assert np.median(errors) < 0.005
    assert np.percentile(errors, 95) < 0.02


def test_both_pictures_show_the_same_thing_along_the_truth(room):
    for box in room.demo_boxes:
        ray = centre_ray(room, box)
        around = perspective(ray, 3, 48)
        s = room.fisheye_depth.inverse_range(around.reshape(-1, 3)).reshape(48, 48, 1)
        turned = around @ room.head_from_fisheye_rotation.T
        seen = unit(turned / s + room.head_from_fisheye_translation_m)
        pair = [room.fisheye_colour.sample(around, 0.003), room.ptz_colour.sample(seen, 0.003)]
        grey = [cv2.GaussianBlur(p, (0, 0), 1).mean(axis=2).ravel() for p in pair]
        assert np.corrcoef(*grey)[0, 1] > 0.9, box.name


def test_every_demo_box_of_the_room_is_textured_and_seen_by_both(room):
    assert len(room.demo_boxes) >= 4
    picture = room.sample_fisheye(*picture_rays(room))
    for box in room.demo_boxes:
        assert room.visible_from_ptz(centre_ray(room, box)), box.name
        cut = picture[int(box.y) : int(box.y + box.h), int(box.x) : int(box.x + box.w)]
        assert cut.mean(axis=2).std() > 12, box.name


def test_regions_are_of_every_kind_and_inside_the_picture(room):
    assert len(room.regions) >= 20
    kinds = {"planar", "slightly_planar", "non_planar", "occluded", "small", "weak_texture", "texture_free"}
    assert kinds <= {box.kind for box in room.regions}
    assert len({box.name for box in room.regions}) == len(room.regions)
    for box in room.regions:
        assert room.truth(centre_ray(room, box)).range_m > 1
        assert room.visible_from_ptz(centre_ray(room, box)), box.name


def test_texture_free_regions_have_none(room):
    picture = room.sample_fisheye(*picture_rays(room))
    for box in (box for box in room.regions if box.kind == "texture_free"):
        cut = picture[int(box.y) : int(box.y + box.h), int(box.x) : int(box.x + box.w)].astype(float)
        assert cv2.Laplacian(cut.mean(axis=2), cv2.CV_64F).std() < 1.5, box.name


def test_some_of_what_the_fisheye_sees_is_hidden_from_the_ptz(room):
    hidden = [not room.visible_from_ptz(ray) for ray in random_rays(600, seed=3)]
    assert 0.005 < np.mean(hidden) < 0.3


def test_outside_the_image_circle_is_black(room):
    rays, valid = picture_rays(room)
    picture = room.sample_fisheye(rays, valid)
    assert picture.dtype == np.uint8
    assert not picture[~valid].any()
    assert picture[valid].mean() > 40


def test_rendered_room_is_small_enough_to_ship():
    assert sum(path.stat().st_size for path in (SCENES / "room").iterdir()) <= 8_000_000


def test_a_scene_says_where_it_comes_from():
    for path in SCENES.glob("*/scene.yaml"):
        file = load_scene(path.parent).file
        assert file.licence
        assert file.credit


def test_truth_of_a_pair_is_given_for_its_boxes_and_lies_on_the_arc(pair):
    assert len(pair.demo_boxes) >= 4
    R, T = pair.head_from_fisheye_rotation, pair.head_from_fisheye_translation_m
    for box in pair.demo_boxes:
        ray = centre_ray(pair, box)
        truth = pair.truth(ray)
        arc = unit(np.cross(T, R @ ray))
        assert abs(math.degrees(float(arc @ truth.bearing_head))) < 0.02, box.name
        assert math.degrees(math.acos(float(unit(R @ ray * truth.range_m + T) @ truth.bearing_head))) < 0.02
        assert 0 < math.degrees(truth.sigma_rad) <= 0.2
        assert pair.visible_from_ptz(ray)


def test_both_real_pictures_show_the_same_thing_along_the_truth(pair):
    for box in pair.demo_boxes:
        ray = centre_ray(pair, box)
        around = perspective(ray, 6, 24)
        seen = around @ pair.head_from_fisheye_rotation.T * pair.truth(ray).range_m
        seen = unit(seen + pair.head_from_fisheye_translation_m)
        pictures = [pair.sample_fisheye(around, np.ones((24, 24), bool)), pair.sample_ptz(seen, 0.005)]
        assert np.corrcoef(*(p.mean(axis=2).ravel() for p in pictures))[0, 1] > 0.8, box.name


def test_truth_of_an_unlisted_ray_of_a_pair_is_an_error(pair):
    with pytest.raises(SimulationError, match="no depth and no listed box"):
        pair.truth(np.array([0.0, 0.0, -1.0]))
    with pytest.raises(SimulationError):
        pair.visible_from_ptz(np.array([0.0, -1.0, 0.0]))


def test_an_unknown_scene_names_those_that_exist():
    with pytest.raises(SimulationError, match="room"):
        load_scene("ballroom")


def test_an_unknown_key_and_a_missing_picture_are_named(tmp_path):
    good = (SCENES / "room" / "scene.yaml").read_text()
    (tmp_path / "scene.yaml").write_text(good + "colour: red\n")
    with pytest.raises(SimulationError, match="colour"):
        load_scene(tmp_path)
    (tmp_path / "scene.yaml").write_text(good)
    with pytest.raises(SimulationError, match=r"fisheye_front\.jpg"):
        load_scene(tmp_path)
