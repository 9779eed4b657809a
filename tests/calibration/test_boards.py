from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from ptzd.calibration.boards import calibrate_boards
from ptzd.calibration.intrinsics import calibrate_lens
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED
from ptzd.calibration.pairs import essential_linear, refine_pairs
from ptzd.calibration.views import BoardView
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import angle_between, rotvec_from_rotation


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


def places(seen):
    """Pixels by the point of the board."""
    return {tuple(np.round(point, 9)): pixel for point, pixel in zip(seen.view.points_m, seen.view.pixels, strict=True)}


def rays_of(pair):
    """Rays ``(n, 3)`` of the points that both cameras found, in the fisheye's and the head's frame."""
    one, other = places(pair.fisheye), places(pair.ptz)
    both = sorted(one.keys() & other.keys())
    rays_f, valid_f = pair.fisheye.camera.lift(np.array([one[point] for point in both]))
    rays_c, valid_c = pair.ptz.camera.lift(np.array([other[point] for point in both]))
    good = valid_f & valid_c
    return rays_f[good], rays_c[good] @ pair.ptz.head_from_camera.T


def apart_deg(one, other):
    return np.degrees(np.linalg.norm(rotvec_from_rotation(one @ other.T)))


def test_essential_matrix_and_refinement_find_the_rig_that_boards_give(stereo_pairs):
    board = calibrate_boards(stereo_pairs)
    rays_f, rays_h = (np.concatenate(side) for side in zip(*map(rays_of, stereo_pairs), strict=True))
    linear, linear_unit = essential_linear(rays_f, rays_h)
    assert apart_deg(linear, board.rotation) < 0.2
    assert np.degrees(angle_between(linear_unit, board.translation)) < 1.0
    refined, unit, solution = refine_pairs(linear, linear_unit, rays_f, rays_h)
    assert apart_deg(refined, board.rotation) < 0.05
    assert np.degrees(angle_between(unit, board.translation)) < 0.1
    assert np.degrees(solution.sigma) < 0.02


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
    assert apart_deg(fit.rotation.T, published_rotation) <= 1.5
    assert np.linalg.norm(-fit.rotation.T @ fit.translation - published_m) <= 0.08
