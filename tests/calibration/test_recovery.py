"""Random rigs: the truth lies inside the 3 sigma ellipsoid of what is estimated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from ptzd.calibration.boards import BoardPair, Seen, calibrate_boards
from ptzd.calibration.features import Features
from ptzd.calibration.intrinsics import calibrate_lens, in_camera
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED, WIDE_RAD
from ptzd.calibration.pairs import refine_pairs
from ptzd.calibration.rotation import Matches, TurnedPicture, calibrate_turning
from ptzd.calibration.target import Target
from ptzd.calibration.turned_boards import TurnedBoard, calibrate_head
from ptzd.calibration.turning import Signs, head_rotations
from ptzd.calibration.views import BoardView
from ptzd.errors import CalibrationError
from ptzd.geometry.sphere import normalise, rotation_from_rotvec, rotvec_from_rotation
from ptzd.model import HeadReading

TARGET = Target(columns=8, rows=6, pitch_m=0.06)
SIZE = (640, 480)


def random_lens(rng):
    xi, focal = rng.uniform(0.9, 1.4), rng.uniform(240.0, 300.0)
    middle = rng.uniform([310, 230], [330, 250])
    return np.array(
        [focal, focal * rng.uniform(0.995, 1.005), *middle, xi, *rng.normal(0.0, [0.03, 0.004, 3e-4, 3e-4])]
    )


def random_pose(rng, angle, range_m):
    """A board whose middle lies at an angle off the axis, facing the camera up to 30° of tilt."""
    turn = rng.uniform(0.0, 2 * np.pi)
    forward = np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
    right = normalise(np.cross([0.0, 1.0, 0.0], forward))
    facing = np.column_stack([right, np.cross(forward, right), forward])
    rotation = facing @ rotation_from_rotvec(rng.uniform(-0.5, 0.5, 3))
    return np.append(rotvec_from_rotation(rotation), forward * range_m - rotation @ TARGET.points_m().mean(axis=0))


def view_of(lens, values, pose, rng, noise, name):
    pixels = lens.project(values, in_camera(TARGET.points_m(), pose))[0]
    pixels = pixels + rng.normal(0.0, noise, pixels.shape)
    return BoardView(name=name, points_m=TARGET.points_m(), pixels=pixels, about_m=TARGET.about_m())


def random_fisheye(rng, noise=0.2, count=15):
    values = random_lens(rng)
    views = [
        view_of(UNIFIED, values, random_pose(rng, rng.uniform(0.0, 1.2), rng.uniform(0.4, 0.8)), rng, noise, f"{i}")
        for i in range(count)
    ]
    return values, views


def inside(error, covariance):
    """Whether an error lies in the ellipsoid that holds as much as 3 sigma of one variable do."""
    distance = float(error @ np.linalg.pinv(covariance, rcond=1e-14) @ error)
    return distance <= chi2.ppf(0.9973, len(error))


def lens_run(seed):
    rng = np.random.default_rng(seed)
    values, views = random_fisheye(rng)
    fit = calibrate_lens(views, SIZE, UNIFIED, held_out=False)
    # The lens's parameters trade against each other along bent valleys; what they predict does not: compare pixels.
    angle, turn = (grid.ravel() for grid in np.meshgrid([0.3, 0.6, 0.9], [0.2, 1.8, 3.3, 4.9]))
    rays = np.stack([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)], axis=-1)
    pixels, by_values, _ = UNIFIED.project(fit.values, rays)
    error = (pixels - UNIFIED.project(values, rays)[0]).ravel()
    by = by_values.reshape(-1, UNIFIED.size)
    spread, modes = np.linalg.eigh(by @ fit.covariance @ by.T)
    strong = spread > 1e-7 * spread.max()
    distance = float(((modes[:, strong].T @ error) ** 2 / spread[strong]).sum())
    return distance <= chi2.ppf(0.9973, int(strong.sum()))


def rig_run(seed):
    rng = np.random.default_rng(seed)
    values = random_lens(rng)
    ptz = np.array([520.0, 520.0, 320.0, 240.0, -0.1, 0.02, 0.0, 0.0, 0.0])
    rotation = rotation_from_rotvec(rng.uniform(-0.2, 0.2, 3))
    translation = rng.uniform([-0.6, -0.2, -0.2], [-0.2, 0.2, 0.2])
    pairs = []
    for index in range(8):
        pose = random_pose(rng, rng.uniform(0.0, 0.3), rng.uniform(1.2, 2.0))
        turned = rotation_from_rotvec(rng.uniform(-0.05, 0.05, 3))
        board = rotation_from_rotvec(pose[:3])
        in_head = np.append(
            rotvec_from_rotation(turned.T @ rotation @ board), turned.T @ (rotation @ pose[3:] + translation)
        )
        pairs.append(
            BoardPair(
                name=f"{index}",
                fisheye=Seen(
                    lens=UNIFIED, values=values, camera=UNIFIED.camera(values, SIZE, WIDE_RAD),
                    view=view_of(UNIFIED, values, pose, rng, 0.2, "f"), head_from_camera=np.eye(3),
                ),
                ptz=Seen(
                    lens=PERSPECTIVE, values=ptz, camera=PERSPECTIVE.camera(ptz, SIZE, WIDE_RAD),
                    view=view_of(PERSPECTIVE, ptz, in_head, rng, 0.2, "p").orders()[index % 2], head_from_camera=turned,
                ),
            )
        )  # fmt: skip
    fit = calibrate_boards(pairs)
    error = np.append(rotvec_from_rotation(fit.rotation @ rotation.T), fit.translation - translation)
    return inside(error, fit.covariance)


def pairs_run(seed):
    rng = np.random.default_rng(seed)
    rotation = rotation_from_rotvec(rng.uniform(-0.3, 0.3, 3))
    unit = normalise(rng.normal(size=3))
    points = normalise(rng.normal(size=(300, 3)) + np.array([0.0, 0.0, 1.5])) * rng.uniform(2.0, 12.0, (300, 1))
    rays_f = normalise(normalise(points) + rng.normal(0.0, 1e-3, points.shape))
    rays_h = normalise(normalise(points @ rotation.T + unit) + rng.normal(0.0, 1e-3, points.shape))
    found, _, solution = refine_pairs(
        rotation_from_rotvec(rng.normal(0, 0.03, 3)) @ rotation, normalise(unit + rng.normal(0, 0.1, 3)), rays_f, rays_h
    )
    turn = rotvec_from_rotation(found @ rotation.T)
    return inside(turn, solution.covariance[:3, :3])


@pytest.mark.parametrize("run", [lens_run, rig_run, pairs_run], ids=lambda run: run.__name__)
def test_truth_lies_inside_three_sigma(run):
    assert sum(run(seed) for seed in range(5)) >= 4


def turned_board(rng, values, signs, angles, offset_m, place_pose, lens, index):
    turned = head_rotations(values, signs, angles[None])[0]
    rotation = turned.T @ rotation_from_rotvec(place_pose[:3])
    pose = np.append(rotvec_from_rotation(rotation), turned.T @ place_pose[3:] - offset_m)
    camera = PERSPECTIVE.camera(lens, SIZE, WIDE_RAD)
    view = view_of(PERSPECTIVE, lens, pose, rng, 0.1, f"{index}")
    return TurnedBoard(
        place=0,
        reading=HeadReading(pan_deg=np.degrees(angles[0]), tilt_deg=np.degrees(angles[1]), zoom=1.0),
        seen=Seen(lens=PERSPECTIVE, values=lens, camera=camera, view=view, head_from_camera=np.eye(3)),
    )


@pytest.mark.parametrize("signs", [Signs(pan=1, tilt=1), Signs(pan=-1, tilt=1), Signs(pan=-1, tilt=-1)])
def test_head_and_its_neglected_offset_come_back_from_boards(signs):
    rng = np.random.default_rng(7)
    values, offset_m = np.array([1.002, 0.999, 0.015, -0.004, 0.008]), np.array([0.012, -0.02, 0.05])
    lens = np.array([700.0, 700.0, 320.0, 240.0, -0.1, 0.0, 0.0, 0.0, 0.0])
    pose = np.array([0.2, 0.3, 0.1, -0.2, -0.15, 1.6])
    boards = [
        turned_board(rng, values, signs, np.radians([pan, tilt]), offset_m, pose, lens, index)
        for index, (pan, tilt) in enumerate((p, t) for p in (-12, -4, 4, 12) for t in (-9, 0, 9))
    ]
    fit = calibrate_head(boards)
    assert fit.signs == signs
    assert np.abs(fit.offset_m - offset_m).max() < 0.004
    assert np.abs(fit.values[2:] - values[2:]).max() < 0.003
    assert np.degrees(fit.offset_error_rad(2.0)) == pytest.approx(np.degrees(np.hypot(0.012, 0.02) / 2), rel=0.2)


def test_a_head_that_hardly_turns_is_refused():
    rng = np.random.default_rng(8)
    lens = np.array([700.0, 700.0, 320.0, 240.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    pose = np.array([0.2, 0.3, 0.1, -0.2, -0.15, 1.6])
    neutral = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
    boards = [
        turned_board(rng, neutral, Signs(), np.radians([index, 0.1 * index]), np.zeros(3), pose, lens, index)
        for index in range(6)
    ]
    with pytest.raises(CalibrationError, match="turn it by at least"):
        calibrate_head(boards)


@pytest.mark.parametrize("signs", [Signs(pan=1, tilt=1), Signs(pan=-1, tilt=-1)])
def test_turning_about_a_scene_gives_lens_and_head(signs):
    rng = np.random.default_rng(9)
    head = np.array([1.0, 1.0, 0.012, -0.003, 0.007])
    lenses = {1.0: (500.0, 324.0, 237.0, -0.1), 800.0: (1900.0, 322.0, 238.0, -0.03)}
    empty = Features(pixels=np.zeros((0, 2)), descriptors=np.zeros((0, 128), np.float32))
    readings = [
        HeadReading(pan_deg=10.0 + across * width, tilt_deg=-5.0 + up * width, zoom=zoom)
        for zoom, width in ((1.0, 60.0), (800.0, 18.0))
        for across, up in ((0, 0), (0.35, 0), (-0.35, 0), (0, 0.28), (0, -0.28), (0.3, 0.25))
    ]
    angles = np.radians([[reading.pan_deg, reading.tilt_deg] for reading in readings])
    turned = head_rotations(head, signs, angles)
    parts = []
    for i in range(len(readings)):
        for j in range(i + 1, len(readings)):
            rays = (
                normalise(
                    np.column_stack(
                        [rng.uniform(-0.6, 0.6, (60, 2)) * 500.0 / lenses[readings[i].zoom][0], np.ones(60)]
                    )
                )
                @ turned[i].T
            )
            pixels, good = [], np.ones(60, bool)
            for k in (i, j):
                f, cx, cy, k1 = lenses[readings[k].zoom]
                seen = rays @ turned[k]
                pixel, _, _ = PERSPECTIVE.project(np.array([f, f, cx, cy, k1, 0, 0, 0, 0]), seen)
                good &= (seen[:, 2] > 0.2) & ((pixel > 0) & (pixel < SIZE)).all(axis=1)
                pixels.append(pixel + rng.normal(0.0, 0.2, pixel.shape))
            rows = np.flatnonzero(good)
            parts.append((np.full(len(rows), i), np.full(len(rows), j), pixels[0][rows], pixels[1][rows]))
    first, second, first_px, second_px = (np.concatenate(side) for side in zip(*parts, strict=True))
    matches = Matches(first=first, second=second, first_px=first_px, second_px=second_px)
    pictures = [TurnedPicture(name=f"{k}", reading=reading, features=empty) for k, reading in enumerate(readings)]
    fit = calibrate_turning(pictures, SIZE, matches)
    assert fit.signs == signs
    for entry in fit.entries:
        assert entry.fx == pytest.approx(lenses[entry.zoom][0], rel=3e-3)
    assert np.degrees(np.abs(fit.head[2:] - head[2:]).max()) < 0.1
