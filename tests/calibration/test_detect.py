"""Every kind of board in rendered pictures: found, in its order, where it is, through a fisheye and straight."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from ptzd.calibrate.studio import samples, tilted
from ptzd.calibration.detect import charuco_board, detect
from ptzd.calibration.intrinsics import in_camera
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED, WIDE_RAD
from ptzd.calibration.target import Target, TargetKind, parse_target
from ptzd.calibration.views import Status
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import rotvec_from_rotation

SIZE = (640, 480)
FISHEYE = UNIFIED.camera(np.array([360.0, 360.0, 320.0, 239.0, 1.1, -0.02, 0.0, 0.0, 0.0]), SIZE, WIDE_RAD)
STRAIGHT = PERSPECTIVE.camera(np.array([520.0, 521.0, 322.0, 238.0, -0.1, 0.02, 0.0, 0.0, 0.0]), SIZE, WIDE_RAD)
CHESS = Target(columns=8, rows=6, pitch_m=0.03)
CIRCLES = Target(kind=TargetKind.CIRCLES, columns=4, rows=11, pitch_m=0.03)
DOTS = Target(kind=TargetKind.SYMMETRIC_CIRCLES, columns=7, rows=5, pitch_m=0.04)
CHARUCO = Target(kind=TargetKind.CHARUCO, columns=7, rows=5, pitch_m=0.04, dictionary="DICT_4X4_50")
PX_PER_M = 2000


def print_of(target):
    """The printed board and where its frame's origin lies on it, px."""
    if target.kind is TargetKind.CHARUCO:
        side = round(target.pitch_m * PX_PER_M)
        board = charuco_board(target).generateImage(((target.columns + 1) * side, (target.rows + 1) * side), None, 0, 1)
        sheet = cv2.copyMakeBorder(board, side, side, side, side, cv2.BORDER_CONSTANT, value=255)
        return cv2.GaussianBlur(sheet, (0, 0), 1.8), 2.0 * side - 0.5
    rim = 0.06 * PX_PER_M
    points = target.points_m()[:, :2] * PX_PER_M + rim
    width, height = (np.ceil(points.max(axis=0)) + rim).astype(int)
    sheet = np.full((height, width), 255, np.uint8)
    radius = (0.6 if target.kind is TargetKind.CIRCLES else 0.25) * target.pitch_m * PX_PER_M
    for x, y in points:
        cv2.circle(sheet, (round(16 * x), round(16 * y)), round(16 * radius), 0, -1, cv2.LINE_AA, 4)
    return sheet, rim


@cache
def rays_of(camera):
    return samples(camera, side=2)[0]


def drawn(camera, target, board):
    """The board as a camera sees it, on grey."""
    rays = rays_of(camera)
    if target.kind is TargetKind.CHESSBOARD:
        return board.over(np.full((SIZE[1], SIZE[0]), 120, np.uint8), rays)
    sheet, origin = print_of(target)
    local, away = rays @ board.rotation, board.origin_m @ board.rotation
    depth = away[2] / local[..., 2]
    at = [((local[..., k] * depth - away[k]) * PX_PER_M + origin).astype(np.float32) for k in (0, 1)]
    flat = [np.where(depth > 0, part, -9.0).reshape(SIZE[1], -1).astype(np.float32) for part in at]
    seen = cv2.remap(sheet, *flat, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120)
    return np.rint(seen.reshape(SIZE[1], SIZE[0], -1).mean(axis=-1)).astype(np.uint8)


def placed(target, seed, range_m, off_axis_rad):
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 6.28)
    side = np.sin(off_axis_rad)
    return tilted(rng, target, np.array([side * np.cos(turn), side * np.sin(turn), np.cos(off_axis_rad)]), range_m)


def rms_px(camera, board, view):
    pose = np.append(rotvec_from_rotation(board.rotation), board.origin_m)
    return min(
        float(np.sqrt(((camera.project(in_camera(way.points_m, pose))[0] - view.pixels) ** 2).sum(axis=1).mean()))
        for way in view.orders()
    )


@pytest.mark.parametrize("target", [CHESS, CIRCLES, DOTS, CHARUCO], ids=lambda target: target.kind.value)
@pytest.mark.parametrize(
    ("camera", "range_m", "off_axis_rad"),
    [(FISHEYE, 0.30, 0.15), (FISHEYE, 0.32, 0.6), (STRAIGHT, 0.8, 0.08)],
    ids=["fisheye", "fisheye, off the axis", "straight"],
)
def test_boards_are_found_where_they_are(target, camera, range_m, off_axis_rad):
    board = placed(target, 11, range_m, off_axis_rad)
    found = detect(drawn(camera, target, board), target, "picture")
    assert found.status is Status.USED, found.reason
    assert rms_px(camera, board, found.view) < 0.3


def test_half_a_charuco_board_is_a_view_of_its_corners():
    board = placed(CHARUCO, 11, 0.8, 0.08)
    grey = drawn(STRAIGHT, CHARUCO, board)
    grey[:, : round(np.median(np.nonzero(grey == 255)[1]))] = 120
    found = detect(grey, CHARUCO, "half")
    assert found.status is Status.USED
    assert 8 <= len(found.view.pixels) < CHARUCO.count
    assert rms_px(STRAIGHT, board, found.view) < 0.3


def test_a_mirrored_charuco_board_is_named():
    grey = drawn(STRAIGHT, CHARUCO, placed(CHARUCO, 11, 0.8, 0.08))
    found = detect(np.ascontiguousarray(grey[:, ::-1]), CHARUCO, "mirror")
    assert found.status is Status.MIRRORED
    assert "mirror" in found.reason


def test_a_board_at_the_border_is_told():
    board = placed(CHESS, 11, 0.8, 0.0)
    grey = drawn(STRAIGHT, CHESS, board)
    corner = STRAIGHT.project(
        in_camera(CHESS.points_m(), np.append(rotvec_from_rotation(board.rotation), board.origin_m))
    )
    left = int(corner[0][:, 0].min()) - 1
    found = detect(np.ascontiguousarray(grey[:, left:]), CHESS, "border")
    assert found.status in (Status.EDGE, Status.NOT_FOUND)
    assert found.reason


@pytest.mark.parametrize("target", [CHESS, replace(CHESS, columns=7, rows=5)], ids=["8x6", "7x5"])
def test_a_board_turned_by_half_a_turn_has_its_points_the_other_way_round(target):
    board = placed(target, 3, 0.8, 0.05)
    grey = drawn(STRAIGHT, target, board)
    upright, turned = (detect(picture, target, "") for picture in (grey, np.ascontiguousarray(grey[::-1, ::-1])))
    back = np.array(SIZE) - 1.0 - turned.view.pixels
    same = np.linalg.norm(back - upright.view.pixels, axis=1).max()
    other = np.linalg.norm(back[::-1] - upright.view.pixels, axis=1).max()
    assert min(same, other) < 0.1
    one, reverse = turned.view.orders()
    assert np.allclose(one.points_m, reverse.points_m[::-1])


@pytest.mark.parametrize("share", [0.6, 0.75])
@pytest.mark.parametrize("legacy", [False, True])
def test_corners_of_charuco_boards_are_measured_as_finely_as_those_of_chessboards(share, legacy):
    target = replace(CHARUCO, marker_share=share, legacy=legacy)
    errors = [
        rms_px(FISHEYE, board, detect(drawn(FISHEYE, target, board), target, "picture").view)
        for board in (placed(target, seed, 0.36, 0.3) for seed in range(11, 15))
    ]
    assert np.median(errors) < 0.12, errors


@pytest.mark.parametrize(
    ("printed", "asked", "told"),
    [
        (replace(CHARUCO, legacy=True), CHARUCO, "before 4.6"),
        (replace(CHARUCO, columns=6, rows=5, legacy=True), replace(CHARUCO, columns=5, rows=6), "--board 6x5"),
        (CHARUCO, replace(CHARUCO, columns=5, rows=7), "--board 7x5"),
        (CIRCLES, replace(CIRCLES, columns=11, rows=4), "--board 4x11"),
        (CHESS, replace(CHESS, columns=6, rows=8), ""),
        (DOTS, replace(DOTS, columns=5, rows=7), ""),
    ],
    ids=["old layout", "old layout, swapped", "ChArUco", "circles", "chessboard", "symmetric circles"],
)
def test_a_board_described_otherwise_is_read_as_it_is_and_named(printed, asked, told):
    board = placed(printed, 11, 0.34, 0.2)
    found = detect(drawn(FISHEYE, printed, board), asked, "picture")
    assert found.status is Status.USED, found.reason
    assert told in found.view.remark
    assert bool(told) == bool(found.view.remark)
    if told:
        assert rms_px(FISHEYE, board, found.view) < 0.3
    else:
        assert found.view.pixels.shape == (printed.count, 2)


def test_a_board_described_as_it_is_needs_no_remark():
    board = placed(CHARUCO, 11, 0.34, 0.2)
    assert detect(drawn(FISHEYE, CHARUCO, board), CHARUCO, "picture").view.remark == ""


@pytest.mark.parametrize(
    ("pitch", "cure"), [(25.0, "0.025"), (30.0, "0.03 if millimetres"), (2.5, "0.025 if centimetres"), (1e-5, "in m")]
)
def test_a_pitch_in_another_unit_is_questioned(pitch, cure):
    with pytest.raises(CalibrationError, match=f"pitch of {pitch:g} m.*{cure}"):
        parse_target("chessboard", "9x6", pitch)
