from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ptzd.calibration.boards import calibrate_boards, plane_pairs, rotation_difference_rad
from ptzd.calibration.intrinsics import calibrate_lens
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED
from ptzd.calibration.pairs import decompose, essential_linear, join_planes, refine_pairs, sphere_homography
from ptzd.calibration.views import BoardView
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import angle_between, normalise, rotation_from_rotvec


def with_reversed(pairs, names):
    return [
        replace(pair, ptz=replace(pair.ptz, view=pair.ptz.view.orders()[1])) if pair.name in names else pair
        for pair in pairs
    ]


def test_the_stereo_pair_is_83_mm_apart(stereo_pairs):
    fit = calibrate_boards(stereo_pairs)
    assert 1e3 * np.linalg.norm(fit.translation) == pytest.approx(82.9, abs=0.5)
    assert fit.rms_px <= 0.30
    assert len(fit.verdicts) == 13


def test_boards_whose_order_is_reversed_in_one_camera_are_put_right(stereo_pairs):
    fit = calibrate_boards(with_reversed(stereo_pairs, {"02.jpg", "08.jpg"}))
    assert set(fit.reversed_names) == {"02.jpg", "08.jpg"}
    assert fit.rms_px <= 0.30
    assert np.allclose(fit.translation, calibrate_boards(stereo_pairs).translation, atol=1e-5)


def test_most_boards_reversed_is_the_same_rig(stereo_pairs):
    names = {pair.name for pair in stereo_pairs[:9]}
    fit = calibrate_boards(with_reversed(stereo_pairs, names))
    assert fit.rms_px <= 0.30


def test_a_mirrored_camera_is_named(stereo_pairs):
    mirrored = [replace(pair, ptz=replace(pair.ptz, view=pair.ptz.view.mirrored(640))) for pair in stereo_pairs[:5]]
    with pytest.raises(CalibrationError, match="mirrored"):
        calibrate_boards(mirrored)


def test_a_pair_of_another_moment_is_left_out_by_name(stereo_pairs):
    other = replace(stereo_pairs[0], ptz=replace(stereo_pairs[0].ptz, view=stereo_pairs[7].ptz.view))
    fit = calibrate_boards([other, *stereo_pairs[1:]])
    assert [verdict.name for verdict in fit.verdicts if not verdict.used] == [other.name]


def test_no_pair_says_what_to_do():
    with pytest.raises(CalibrationError, match="both see it whole"):
        calibrate_boards([])


def test_planes_essential_matrix_and_refinement_find_the_same_rig(stereo_pairs):
    board = calibrate_boards(stereo_pairs)
    planes = [plane_pairs(pair) for pair in stereo_pairs]
    rotation, direction = join_planes(planes)
    assert np.degrees(rotation_difference_rad(rotation, board.rotation)) < 0.2
    assert np.degrees(angle_between(direction, board.translation)) < 0.5
    rays_f, rays_h = (np.concatenate(side) for side in zip(*planes, strict=True))
    refined, unit, solution = refine_pairs(rotation, direction, rays_f, rays_h)
    assert np.degrees(rotation_difference_rad(refined, board.rotation)) < 0.05
    assert np.degrees(angle_between(unit, board.translation)) < 0.1
    assert np.degrees(solution.sigma) < 0.02
    linear, linear_unit = essential_linear(rays_f, rays_h)
    assert np.degrees(rotation_difference_rad(linear, board.rotation)) < 0.2
    assert np.degrees(angle_between(linear_unit, board.translation)) < 1.0


def test_a_single_plane_keeps_the_true_motion_among_its_two(stereo_pairs):
    board = calibrate_boards(stereo_pairs)
    rays = plane_pairs(stereo_pairs[3])
    motions = decompose(sphere_homography(*rays), rays[0])
    assert len(motions) <= 2
    assert min(np.degrees(rotation_difference_rad(motion.rotation, board.rotation)) for motion in motions) < 2.0


def test_a_single_plane_leaves_the_motion_open():
    rng = np.random.default_rng(6)
    rays_f = normalise(np.column_stack([rng.uniform(-0.4, 0.4, (40, 2)), np.ones(40)]))
    normal = normalise(np.array([0.3, -0.2, 1.0]))
    points = rays_f * (2.0 / (rays_f @ normal))[:, None]
    rotation = rotation_from_rotvec([0.05, -0.1, 0.02])
    rays_h = normalise(points @ rotation.T + np.array([-0.1, -0.1, -0.5]))
    assert len(decompose(sphere_homography(rays_f, rays_h), rays_f)) == 2
    with pytest.raises(CalibrationError, match="second plane"):
        join_planes([(rays_f, rays_h)])


def test_hetero_rig(real_data, pairing):
    fits = []
    for name, lens in (("cam_4_fisheye_2048x2048", UNIFIED), ("cam_7_pinhole_1920x1080", PERSPECTIVE)):
        document = json.loads((real_data / "hetero_rig" / f"{name}.json").read_text())
        views = [
            BoardView(name=key, points_m=np.array(document["object_points_m"]), pixels=np.array(pixels))
            for key, pixels in document["frames"].items()
        ]
        fits.append(calibrate_lens(views, tuple(document["image_size"]), lens, held_out=False))
    fit = calibrate_boards(pairing(*fits, lambda name: name))
    published_rotation = np.array(
        [[0.9923998628, 0.1102270544, 0.0547038287], [-0.0529547389, -0.0187357205, 0.9984211378],
         [0.1110779367, -0.9937298271, -0.0127562816]]
    )  # fmt: skip
    published_m = np.array([0.5132123397, -0.3455542564, 0.7851208075])
    assert len(fit.verdicts) == 2
    assert np.degrees(rotation_difference_rad(fit.rotation.T, published_rotation)) <= 1.5
    assert np.linalg.norm(-fit.rotation.T @ fit.translation - published_m) <= 0.08
