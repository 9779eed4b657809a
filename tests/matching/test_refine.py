import numpy as np
import pytest

from ptzd.geometry.arc import EpipolarArc
from ptzd.matching.patch import MARGIN_PX, cut_patch
from ptzd.matching.place import Place
from ptzd.matching.rays import RayField
from ptzd.matching.refine import Bounds, photometric, refine
from ptzd.matching.view import prepare_view
from ptzd.model import Box

BOX = Box(x=290, y=210, w=32, h=32)


@pytest.fixture(scope="module")
def setup(world):
    rig, reading = world.rig, world.aimed(BOX, (2.0, 1.0))
    field = RayField.of(rig.fisheye, BOX, MARGIN_PX)
    patch = cut_patch(world.fisheye(BOX, 1.0), field, rig.head_from_fisheye_rotation, BOX, 1)
    view = prepare_view(world.view(reading, 1.0), rig.camera(reading), rig.head_from_camera(reading).T, patch.angle_rad)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(BOX.centre))[0], 0.0, 1.0)
    return patch, view, arc


def place_at(arc, s, offset=0.0, roll=0.0):
    return Place(planes=(s * arc.rotated)[None], offset=np.array([offset]), roll=np.array([roll]))


def bounds(band_deg=1.0):
    return Bounds(inverse_range=(0.0, 1.0), band_rad=np.radians(band_deg), noise=0.6)


@pytest.mark.parametrize("steps_off", [-1.5, -0.7, 0.0, 0.7, 1.5])
@pytest.mark.parametrize("offset_steps", [-0.7, 0.7])
def test_converges_to_the_plane(world, setup, steps_off, offset_steps):
    patch, view, arc = setup
    truth, s = world.truth(BOX.centre)
    start = place_at(arc, s + steps_off * patch.angle_rad / 0.45, offset_steps * patch.angle_rad)
    refined = refine(patch, view, arc, start, bounds(), 8)
    found = refined.place.bearings(arc)[0]
    assert np.degrees(np.linalg.norm(found - truth)) < 0.04
    assert np.degrees(np.abs(refined.place.offset[0])) < 0.03
    normal = refined.place.planes[0] / np.linalg.norm(refined.place.planes[0])
    expected = world.rig.head_from_fisheye_rotation @ world.planes[0].normal
    assert np.degrees(np.arccos(normal @ expected)) < 12.0


def test_sigma_tells_the_error(world, setup):
    patch, view, arc = setup
    truth, s = world.truth(BOX.centre)
    refined = refine(patch, view, arc, place_at(arc, s), bounds(), 6)
    error = np.linalg.norm(refined.place.bearings(arc)[0] - truth)
    assert error < 5.0 * refined.sigma_rad[0]
    assert refined.sigma_rad[0] < np.radians(0.05)


def test_held_offset_and_roll_stay(world, setup):
    patch, view, arc = setup
    _, s = world.truth(BOX.centre)
    start = place_at(arc, s + 0.01, 0.004, 0.01)
    refined = refine(patch, view, arc, start, bounds(), 3, hold=True)
    assert refined.place.offset[0] == start.offset[0]
    assert refined.place.roll[0] == start.roll[0]
    assert refined.place.planes[0] @ arc.rotated != pytest.approx(s + 0.01, abs=1e-5)


def test_without_a_band_the_offset_stays_on_the_arc(world, setup):
    patch, view, arc = setup
    _, s = world.truth(BOX.centre)
    refined = refine(patch, view, arc, place_at(arc, s), bounds(0.0), 5)
    assert abs(refined.place.offset[0]) < 1e-6


def test_candidates_do_not_influence_each_other(world, setup):
    patch, view, arc = setup
    _, s = world.truth(BOX.centre)
    alone = refine(patch, view, arc, place_at(arc, s + 0.01), bounds(), 3)
    both = refine(patch, view, arc, place_at(arc, 0.1).join(place_at(arc, s + 0.01)), bounds(), 3)
    assert np.allclose(both.place.planes[1], alone.place.planes[0], atol=1e-5)


def test_photometric_finds_gain_and_offset():
    wanted = np.random.default_rng(0).normal(100, 20, 500).astype(np.float32)
    seen = ((wanted - 30) / 2)[None]
    gain, left = photometric(np.full((1, 500), 1 / 500, np.float32), seen, wanted)
    assert gain[0] == pytest.approx(2.0, rel=1e-3)
    assert np.abs(left).max() < 0.05
