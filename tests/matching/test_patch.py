import numpy as np
import pytest

from ptzd.matching.patch import MARGIN_PX, cut_patch, step_for
from ptzd.matching.rays import RayField
from ptzd.model import Box


def cut(world, box, step=1, grey=None):
    camera = world.rig.fisheye
    grey = np.random.default_rng(0).integers(0, 255, camera.size_px[::-1], dtype=np.uint8) if grey is None else grey
    return cut_patch(grey, RayField.of(camera, box, MARGIN_PX), world.rig.head_from_fisheye_rotation, box, step)


def test_samples_sit_on_pixels(world):
    patch = cut(world, Box(x=300.3, y=199.6, w=20, h=16))
    pixels, _ = world.rig.fisheye.project(patch.rays @ world.rig.head_from_fisheye_rotation)
    assert patch.shape == (16, 20)
    assert np.abs(pixels - np.round(pixels)).max() < 1e-3
    assert np.abs(pixels.mean(axis=0) - np.array([310.3, 207.6])).max() <= 0.5


@pytest.mark.parametrize("step", [1, 2, 3, 5])
def test_grid_is_centred_on_the_box_to_half_a_pixel(world, step):
    box = Box(x=251.3, y=203.8, w=47.0, h=33.0)
    patch = cut(world, box, step)
    centre, _ = world.rig.fisheye.lift(np.array(box.centre))
    middle = patch.rays.mean(axis=0) / np.linalg.norm(patch.rays.mean(axis=0))
    off = np.linalg.norm(middle - world.rig.head_from_fisheye_rotation @ centre)
    assert off < (0.75 + 0.02 * step) * patch.angle_rad / step


def test_weights_sum_to_one_and_fall_from_the_centre(world):
    patch = cut(world, Box(x=300, y=200, w=30, h=30))
    weight = patch.weight.reshape(patch.shape)
    assert weight.sum() == pytest.approx(1.0, abs=1e-5)
    assert weight[15, 15] > 1.5 * weight[0, 15] > weight[0, 0] > 0


def test_what_lies_outside_the_image_circle_has_no_weight(world):
    camera = world.rig.fisheye
    box = Box(x=-6, y=225, w=30, h=30)
    patch = cut(world, box)
    weight = patch.weight.reshape(patch.shape)
    assert (weight[:, :6] == 0).all()
    assert camera.size_px[0] > 0
    far = cut(world, Box(x=-100, y=225, w=30, h=30))
    assert (far.weight == 0).all()


def test_averaging_over_steps_keeps_the_mean(world):
    grey = np.random.default_rng(1).integers(0, 255, (480, 640), dtype=np.uint8)
    box = Box(x=200, y=100, w=160, h=120)
    patch = cut(world, box, 4, grey)
    assert patch.shape == (30, 40)
    assert patch.grey.mean() == pytest.approx(grey[100:220, 200:360].mean(), abs=1.0)


@pytest.mark.parametrize(("side", "most", "step"), [(8, 40, 1), (40, 40, 1), (41, 40, 2), (400, 40, 10), (80, 16, 5)])
def test_step_bounds_the_number_of_samples(side, most, step):
    assert step_for(Box(x=0, y=0, w=side, h=5), most, 1) == step


def test_small_boxes_borrow_a_rim(world):
    assert min(cut(world, Box(x=300, y=200, w=8, h=9)).shape) >= 14
