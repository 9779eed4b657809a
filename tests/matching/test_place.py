import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.matching.patch import MARGIN_PX, cut_patch
from ptzd.matching.place import Place, make_grid, peaks, separate
from ptzd.matching.rays import RayField
from ptzd.matching.view import prepare_view
from ptzd.model import Box

BOX = Box(x=300, y=220, w=24, h=24)


def make(world, off=(0.0, 0.0)):
    reading = world.aimed(BOX, off)
    rig = world.rig
    inputs = world.inputs(BOX, reading, band_deg=1.0)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(BOX.centre))[0], 0.0, 1.0)
    field = RayField.of(rig.fisheye, BOX, MARGIN_PX)
    patch = cut_patch(inputs.fisheye_grey, field, rig.head_from_fisheye_rotation, BOX, 1)
    view = prepare_view(inputs.view_grey, rig.camera(reading), rig.head_from_camera(reading).T, patch.angle_rad)
    return arc, make_grid(inputs, arc, patch, view, patch.angle_rad, len(patch.rays)), patch


def test_grid_covers_interval_and_band(world):
    arc, grid, _ = make(world)
    s = grid.place.planes @ arc.rotated
    assert grid.coverage[0] <= s.min() + 1e-9
    assert grid.coverage[1] >= s.max() - 1e-9
    assert np.degrees(np.abs(grid.place.offset).max()) > 0.9
    assert len(grid.cell) <= grid.shape[0] * grid.shape[1]


def test_view_off_the_arc_leaves_part_of_the_grid(world):
    _, whole, _ = make(world)
    _, part, _ = make(world, (30.0, 0.0))
    assert 0 < len(part.cell) < len(whole.cell)


def test_peaks_are_local_maxima_best_first(world):
    arc, grid, patch = make(world)
    scores = np.zeros(len(grid.cell))
    near, far = len(scores) // 4, 3 * len(scores) // 4
    scores[near], scores[far] = 0.9, 0.7
    found = peaks(grid, scores, arc, 2.0 * patch.angle_rad, 2)
    assert found.tolist() == [near, far]


def test_left_out_hypotheses_are_no_peaks(world):
    arc, grid, patch = make(world)
    scores = np.full(len(grid.cell), -np.inf)
    scores[5] = 0.3
    assert peaks(grid, scores, arc, patch.angle_rad, 9).tolist() == [5]


def test_close_candidates_are_one(world):
    arc, _, _ = make(world)
    place = Place(planes=np.array([0.30, 0.301, 0.6])[:, None] * arc.rotated, offset=np.zeros(3), roll=np.zeros(3))
    assert separate(place, np.array([0.5, 0.8, 0.6]), arc, 0.005, 9).tolist() == [1, 2]
    assert separate(place, np.array([0.5, 0.8, 0.6]), arc, 0.005, 1).tolist() == [1]
