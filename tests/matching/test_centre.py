import numpy as np
import pytest

from ptzd.matching.centre import central_window
from ptzd.matching.job import match
from ptzd.matching.patch import Patch
from ptzd.model import Box, Matcher

BOX = Box(x=288, y=208, w=44, h=44)


@pytest.fixture(scope="module")
def two_surfaces(lab, textures):
    """A board 1.6 m away before a wall 4 m away; it fills a third of the box's width, at its middle."""
    rig = lab.make_rig()
    wall = lab.wall(textures[1], distance=4.0, normal=(0.0, 0.0, 1.0))
    ray, _ = rig.fisheye.lift(np.array(BOX.centre))
    board = lab.wall(textures[2], distance=1.6, normal=(0.0, 0.0, 1.0))
    right, down = board.frame()
    u, v = (ray * 1.6 / ray[2]) @ right, (ray * 1.6 / ray[2]) @ down
    board = lab.wall(textures[2], distance=1.6, normal=(0.0, 0.0, 1.0), bounds_m=(u - 0.09, u + 0.09, v - 2.0, v + 2.0))
    return lab.World(rig=rig, planes=(wall, board))


def test_the_answer_follows_the_surface_at_the_centre(two_surfaces):
    world = two_surfaces
    result = match(world.inputs(BOX, world.aimed(BOX, (2.0, 1.0)), noise=1.0), Matcher.SWEEP)
    _, s = world.truth(BOX.centre)
    assert s == pytest.approx(1 / 1.6, rel=0.02)
    assert world.error_deg(BOX, result.candidates[0]) < 0.3


def test_windows_shrink_to_a_least_size():
    shape = (20, 30)
    patch = Patch(
        grey=np.arange(600, dtype=np.float32),
        rays=np.zeros((600, 3), np.float32),
        weight=np.full(600, 1 / 600, np.float32),
        shape=shape,
        step_px=1,
        angle_rad=0.01,
    )
    half = central_window(patch, 0.5)
    assert half is not None
    assert half.shape == (10, 15)
    assert half.weight.sum() == pytest.approx(1.0, abs=1e-5)
    assert half.grey.reshape(10, 15)[0, 0] == 5 * 30 + 7
    small = central_window(half, 0.1)
    assert small is not None
    assert small.shape == (8, 8)
    assert central_window(small, 0.5) is None
