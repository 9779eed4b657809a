"""A fisheye whose lens nobody measured, in a room of planes, comes back with its rig; without them it says less."""

from __future__ import annotations

import numpy as np
import pytest

from ptzd.calibration.lens import UNIFIED, WIDE_RAD
from ptzd.calibration.planes import find_planes, refine_by_planes
from ptzd.calibration.scene_rig import ScenePairs, calibrate_scene_rig
from ptzd.geometry.sphere import angle_between, normalise, rotation_from_rotvec

SIZE = (640, 480)
LENS = np.array([268.0, 268.1, 322.0, 238.0, 1.15, -0.02, 0.003, 1e-4, -1e-4])
ROTATION = rotation_from_rotvec([-0.08, 0.07, 0.03])
BASELINE = np.array([-0.98, -0.17, -0.05])
WALLS = np.array([[0.0, 0.0, 0.2], [0.28, 0.0, 0.02], [-0.25, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, -0.45, 0.0]])


def room(seed, count=1200, noise_px=0.12):
    """Features on the walls of a box, and their pairs with chance matches among them; unit: baselines."""
    rng = np.random.default_rng(seed)
    directions = normalise(rng.normal([0.0, 0.0, 0.6], 1.0, (4 * count, 3)))
    s = (directions @ WALLS.T).max(axis=1)
    rays = normalise((directions - s[:, None] * BASELINE) @ ROTATION)
    seen = (s > 0.05) & (rays[:, 2] > np.cos(1.45))
    directions, rays, s = directions[seen][:count], rays[seen][:count], s[seen][:count]
    pixels = UNIFIED.project(LENS, rays)[0] + rng.normal(0.0, noise_px, (len(rays), 2))
    chance = rng.random(len(rays)) < 0.2
    pixels[chance] = pixels[rng.permutation(np.flatnonzero(chance))]
    return ScenePairs(fisheye_px=pixels, directions=directions, sigma_rad=np.full(len(rays), 2e-3)), s


def pointing_deg(fit):
    """At the walls all over the fisheye's picture."""
    across, down = np.meshgrid(np.arange(100.0, 560.0, 40.0), np.arange(40.0, 460.0, 40.0))
    pixels = np.stack([across.ravel(), down.ravel()], axis=-1)
    rays, valid = UNIFIED.camera(LENS, SIZE, WIDE_RAD).lift(pixels)
    mine, also = UNIFIED.camera(fit.values, SIZE, WIDE_RAD).lift(pixels)
    good = valid & also & (rays[:, 2] > 0.2)
    carried, own = rays[good] @ ROTATION.T, mine[good] @ fit.rotation.T
    near = 0.3
    return np.degrees(angle_between(carried + near * BASELINE, own + near * fit.translation))


def test_planes_bring_lens_and_rig_back_without_a_board():
    pairs, _ = room(3)
    fit = refine_by_planes(calibrate_scene_rig(pairs, SIZE), SIZE, held=False)
    assert fit.planes >= 3
    assert np.percentile(pointing_deg(fit), 95) <= 0.2


def test_planes_are_found_among_strays():
    pairs, s = room(5, count=600)
    rng = np.random.default_rng(1)
    s = s + rng.normal(0.0, 1e-3, len(s))
    s[::5] = rng.uniform(0.0, 0.6, len(s[::5]))
    planes = find_planes(pairs.directions, s, np.full(len(s), 2e-3), 2.0)
    for wall in WALLS[:3]:
        assert np.linalg.norm(planes.normals - wall, axis=1).min() < 0.02


@pytest.mark.parametrize("count", [0, 30])
def test_too_few_features_make_no_plane(count):
    directions = normalise(np.random.default_rng(2).normal(size=(count, 3)))
    planes = find_planes(directions, np.full(count, 0.2), np.full(count, 1e-3), 1.0)
    assert len(planes.normals) == 0
    assert (planes.owner == -1).all()
