import numpy as np
import pytest

from ptzd.geometry.sphere import normalise
from ptzd.matching.view import prepare_view

BARREL = (-0.25, 0.06, 0.001, -0.0008, 0.0)


def ramps(size):
    y, x = np.mgrid[: size[1], : size[0]]
    return (20 + 0.6 * x + 0.2 * y).astype(np.uint8)


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BARREL])
@pytest.mark.parametrize("step_deg", [0.1, 0.45, 1.3])
def test_a_direction_finds_its_pixel_s_grey_value(world, lab, distortion, step_deg):
    rig = lab.make_rig(distortion=distortion)
    reading = world.rig.aim([0.1, -0.05, 1.0], 1.0)
    camera, turn = rig.camera(reading), rig.head_from_camera(reading).T
    view = prepare_view(ramps(camera.size_px), camera, turn, np.radians(step_deg))
    rng = np.random.default_rng(0)
    pixels = rng.uniform([60, 60], [260, 180], (200, 2))
    rays = rig.lift_from_view(pixels, reading)
    samples = view.sample(np.eye(3)[None], rays.astype(np.float32))
    assert samples.inside.all()
    expected = 20 + 0.6 * pixels[:, 0] + 0.2 * pixels[:, 1]
    assert np.abs(samples.grey[0] - expected).max() < 1.0
    assert np.abs(samples.grey[0] - expected).mean() < 0.6


def test_directions_outside_or_behind_are_not_inside(world):
    reading = world.rig.aim([0.0, 0.0, 1.0], 1.0)
    camera, turn = world.rig.camera(reading), world.rig.head_from_camera(reading).T
    view = prepare_view(ramps(camera.size_px), camera, turn, 0.008)
    rays = normalise(np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.1, 0.0, -1.0], [1.0, 0.0, 0.0]]))
    assert view.sample(np.eye(3)[None], rays.astype(np.float32)).inside[0].tolist() == [
        True,
        False,
        False,
        False,
        False,
    ]


@pytest.mark.parametrize("distortion", [(0.0,) * 5, BARREL])
def test_a_part_of_the_view_samples_like_the_whole(lab, distortion):
    rig = lab.make_rig(distortion=distortion)
    reading = rig.aim([0.0, 0.0, 1.0], 1.0)
    camera, turn = rig.camera(reading), rig.head_from_camera(reading).T
    grey = np.random.default_rng(0).integers(0, 255, camera.size_px[::-1], dtype=np.uint8)
    rays = rig.lift_from_view(np.random.default_rng(1).uniform([100, 80], [160, 140], (50, 2)), reading)
    whole = prepare_view(grey, camera, turn, 0.008)
    part = prepare_view(grey, camera, turn, 0.008, area_px=(100, 80, 160, 140))
    assert part.image.size < 0.4 * whole.image.size
    one, other = (v.sample(np.eye(3)[None], rays.astype(np.float32)) for v in (whole, part))
    assert other.inside.all()
    assert np.abs(one.grey - other.grey).max() < 2.5


def test_noise_gain_is_what_the_low_pass_leaves(world):
    reading = world.rig.aim([0.0, 0.0, 1.0], 1.0)
    camera, turn = world.rig.camera(reading), world.rig.head_from_camera(reading).T
    noise = np.random.default_rng(0).normal(120, 20, camera.size_px[::-1])
    for step_deg in (0.2, 0.45, 1.2):
        view = prepare_view(np.clip(noise, 0, 255).astype(np.uint8), camera, turn, np.radians(step_deg))
        assert view.image.std() == pytest.approx(20 * view.noise_gain, rel=0.25)


def test_slopes_are_derivatives(world):
    reading = world.rig.aim([0.0, 0.0, 1.0], 1.0)
    camera, turn = world.rig.camera(reading), world.rig.head_from_camera(reading).T
    view = prepare_view(ramps(camera.size_px), camera, turn, 0.008)
    samples = view.sample(np.eye(3)[None], np.array([[0.0, 0.0, 1.0]], np.float32))
    factor = round(camera.size_px[0] / view.image.shape[1])
    slope_x, slope_y = view.slopes(samples)
    assert slope_x[0, 0] == pytest.approx(0.6 * factor, rel=0.05)
    assert slope_y[0, 0] == pytest.approx(0.2 * factor, rel=0.1)
