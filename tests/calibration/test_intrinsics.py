from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ptzd.calibration.detect import detect
from ptzd.calibration.intrinsics import calibrate_lens, in_camera
from ptzd.calibration.lens import KANNALA_BRANDT, PERSPECTIVE, UNIFIED, WIDE_RAD
from ptzd.calibration.pictures import read_boards
from ptzd.calibration.target import Target
from ptzd.calibration.views import Status
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import angle_between

PUBLISHED = np.array(
    [398.77492706579216, 398.7685638672075, 319.17879590584187, 319.71743712432686, 1.1331346732794045,
     -0.24972089525362837, 0.009672326567075125, 0.0, 0.0]
)  # fmt: skip
SIZE = (640, 720)


def rays_apart_deg(one, other, pixels):
    first, valid_first = one.lift(pixels)
    second, valid_second = other.lift(pixels)
    both = valid_first & valid_second
    first, second = first[both], second[both]
    left, _, right = np.linalg.svd(first.T @ second)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return np.degrees(angle_between(first, second @ turn.T))


@pytest.fixture(scope="module")
def fit(fisheye_views):
    return calibrate_lens(fisheye_views, SIZE)


@pytest.mark.parametrize("lens", [UNIFIED, KANNALA_BRANDT, PERSPECTIVE], ids=lambda lens: lens.name)
def test_derivatives_of_the_models_are_those_of_differences(lens):
    rng = np.random.default_rng(3)
    values = np.array([400.0, 410.0, 320.0, 240.0, 1.1, -0.1, 0.02, 0.003, -0.002])[: lens.size]
    if lens is not UNIFIED:
        values[4:] = [-0.1, 0.02, 0.003, -0.002, 0.01][: lens.size - 4]
    points = rng.normal(size=(50, 3)) + np.array([0.0, 0.0, 4.0])
    pixels, by_values, by_points = lens.project(values, points)
    assert np.abs(pixels - lens.camera(values, (640, 480), WIDE_RAD).project(points)[0]).max() < 1e-9
    for column in range(lens.size):
        step = np.zeros(lens.size)
        step[column] = 1e-6
        difference = (lens.project(values + step, points)[0] - lens.project(values - step, points)[0]) / 2e-6
        assert np.abs(difference - by_values[:, :, column]).max() < 1e-4
    for column in range(3):
        step = np.eye(3)[column] * 1e-6
        difference = (lens.project(values, points + step)[0] - lens.project(values, points - step)[0]) / 2e-6
        assert np.abs(difference - by_points[:, :, column]).max() < 1e-3


def test_all_26_real_views_are_used_at_half_a_pixel(fit):
    assert sum(verdict.used for verdict in fit.verdicts) == 26
    assert fit.rms_px <= 0.49
    assert all(verdict.rms_px <= verdict.held_out_rms_px < 1.0 for verdict in fit.verdicts)


def test_rays_are_those_of_the_published_fit(fit):
    published = UNIFIED.camera(PUBLISHED, SIZE, np.radians(95.0))
    x, y = np.meshgrid(np.arange(0.0, 640.0, 10.0), np.arange(0.0, 720.0, 10.0))
    apart = rays_apart_deg(fit.camera(np.radians(92.0)), published, np.stack([x.ravel(), y.ravel()], axis=-1))
    assert np.median(apart) <= 0.45
    assert np.percentile(apart, 95) <= 0.6


@pytest.mark.parametrize("half", [0, 1])
def test_half_of_the_views_tells_nearly_the_same_rays(fit, fisheye_views, half):
    other = calibrate_lens(fisheye_views[half::2], SIZE, held_out=False)
    pixels = np.concatenate([view.pixels for view in fisheye_views])
    assert np.median(rays_apart_deg(fit.camera(), other.camera(), pixels)) <= 0.2


def test_both_models_agree_on_the_rays(fit, fisheye_views):
    other = calibrate_lens(fisheye_views, SIZE, KANNALA_BRANDT, held_out=False)
    pixels = np.concatenate([view.pixels for view in fisheye_views])
    assert other.rms_px <= 0.49
    assert np.median(rays_apart_deg(fit.camera(), other.camera(np.radians(95.0)), pixels)) < 0.3


def test_each_of_the_stereo_cameras_fits_to_a_quarter_pixel(stereo_fits):
    assert [len(fit.views) for fit in stereo_fits] == [13, 13]
    assert max(fit.rms_px for fit in stereo_fits) <= 0.25


def test_one_spoilt_view_is_left_out_by_name(fisheye_views):
    rng = np.random.default_rng(1)
    spoilt = [*fisheye_views[1:], replace(fisheye_views[0], pixels=fisheye_views[0].pixels + rng.normal(0, 9, (24, 2)))]
    verdicts = calibrate_lens(spoilt, SIZE, held_out=False).verdicts
    assert [verdict.name for verdict in verdicts if verdict.status is Status.OUTLIER] == [fisheye_views[0].name]


def test_a_mirrored_view_among_others_is_left_out_by_name(fisheye_views):
    flipped = fisheye_views[4]
    upside_down = replace(flipped, pixels=flipped.pixels * (1.0, -1.0) + (0.0, SIZE[1] - 1.0))
    views = [*fisheye_views[:4], upside_down, *fisheye_views[5:]]
    verdicts = calibrate_lens(views, SIZE, held_out=False).verdicts
    assert [verdict.name for verdict in verdicts if not verdict.used] == [flipped.name]


def test_too_few_views_say_what_to_take(fisheye_views):
    with pytest.raises(CalibrationError, match="1 with a board; take at least 10"):
        calibrate_lens(fisheye_views[:1], SIZE)


def test_views_all_alike_are_refused(fisheye_views):
    rng = np.random.default_rng(2)
    alike = [replace(fisheye_views[0], pixels=fisheye_views[0].pixels + rng.normal(0, 0.1, (24, 2))) for _ in range(12)]
    with pytest.raises(CalibrationError, match="all alike"):
        calibrate_lens(alike, SIZE)


def test_boards_all_parallel_are_refused():
    points = Target(columns=8, rows=6, pitch_m=0.03).points_m()
    values = np.array([600.0, 600.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rng = np.random.default_rng(4)
    base = load_view_template()
    views = []
    for index in range(12):
        pose = np.array([0.0, 0.0, 0.0, *rng.uniform(-0.15, 0.0, 2), 0.5 + 0.05 * index])
        pixels = PERSPECTIVE.project(values, in_camera(points, pose))[0] + rng.normal(0, 0.2, (48, 2))
        views.append(replace(base, name=f"{index}", points_m=points, pixels=pixels))
    with pytest.raises(CalibrationError, match="tilt the board"):
        calibrate_lens(views, (640, 480), PERSPECTIVE)


def load_view_template():
    from ptzd.calibration.views import BoardView

    return BoardView(name="", points_m=np.zeros((0, 3)), pixels=np.zeros((0, 2)))


def test_a_board_with_another_count_is_refused(fisheye_views):
    wrong = Target(columns=6, rows=4, pitch_m=0.05).points_m()
    with pytest.raises(CalibrationError, match="size"):
        calibrate_lens([replace(view, points_m=wrong) for view in fisheye_views], SIZE)


def test_a_grey_picture_holds_no_board():
    found = detect(np.full((480, 640), 128, np.uint8), Target(columns=4, rows=6, pitch_m=0.05), "grey")
    assert found.status is Status.NOT_FOUND


def test_all_boards_of_the_real_pictures_are_found(real_data):
    boards = read_boards(real_data / "fisheye_chessboard", Target(columns=4, rows=6, pitch_m=0.05))
    assert len(boards.views) == 26
