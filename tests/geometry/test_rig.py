import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.rig import BAND_SIGMAS
from ptzd.geometry.sphere import angle_between, bearing, normalise
from ptzd.model import HeadReading

READINGS = st.builds(
    HeadReading, pan_deg=st.floats(-170.0, 170.0), tilt_deg=st.floats(-60.0, 60.0), zoom=st.floats(1.0, 5000.0)
)


@given(READINGS, st.floats(-0.5, 639.5), st.floats(-0.5, 479.5))
def test_a_view_lifts_and_projects_back(make_rig, reading, x, y):
    rig = make_rig(misalignment=(0.01, -0.02, 0.3))
    pixels, valid = rig.project_to_view(rig.lift_from_view([x, y], reading), reading)
    assert valid
    assert pixels == pytest.approx([x, y], abs=1e-7)


@given(st.floats(-3.1, 3.1), st.floats(-1.2, 1.2), st.floats(1.0, 5000.0))
def test_what_is_aimed_at_is_at_the_principal_point(make_rig, pan, tilt, zoom):
    rig = make_rig(misalignment=(0.01, -0.02, 0.3))
    reading = rig.aim(bearing(pan, tilt), zoom)
    camera = rig.camera(reading)
    pixel, valid = rig.project_to_view(bearing(pan, tilt), reading)
    assert valid
    assert pixel == pytest.approx([camera.cx, camera.cy], abs=1e-4)


@given(READINGS)
def test_right_in_the_picture_is_right_in_the_head_frame(make_rig, reading):
    rig = make_rig()
    left, right = rig.lift_from_view([[300.0, 239.5], [340.0, 239.5]], reading)
    axis = rig.head_from_camera(reading)[:, 0]
    assert (right - left) @ axis > 0


def test_behind_the_view_nothing_projects(make_rig):
    rig = make_rig()
    reading = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    axis = rig.head_from_camera(reading) @ [0, 0, 1]
    assert rig.project_to_view([axis, -axis], reading)[1].tolist() == [True, False]


def test_a_pixel_past_the_fold_is_refused(make_rig):
    with pytest.raises(GeometryError, match="1 pixel"):
        make_rig().lift_from_view([[319.0, 239.0], [1e40, 0.0]], HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0))


def test_the_band_is_three_sigma_of_everything(make_rig):
    rig = make_rig()
    far = BAND_SIGMAS * math.hypot(0.003, 0.001)
    assert rig.band_rad() == pytest.approx(far)
    assert rig.band_rad(0.5) == pytest.approx(BAND_SIGMAS * math.hypot(0.003, 0.001, 0.0025))


@given(st.floats(0.8, 3.0), st.floats(0.0, 6.2))
def test_the_share_of_t_in_the_band_is_what_an_error_of_t_does(make_rig, distance, turn):
    target = normalise([0.2, 0.1, 1.0]) * distance
    side = normalise(np.cross(target, [math.cos(turn), math.sin(turn), 0.2]))
    sigma = 0.005
    moved = angle_between(target, target + sigma * side)
    none = make_rig().uncertainty.__class__(rotation_rad=0.0, translation=sigma, head_rad=0.0)
    assert make_rig(uncertainty=none).band_rad(1 / distance) == pytest.approx(3 * moved, rel=1e-3)


def test_without_uncertainty_the_band_is_asked_for(make_rig):
    with pytest.raises(CalibrationError, match=r"^uncertainty: missing"):
        make_rig(uncertainty=None).band_rad()


def test_the_arrays_cannot_be_written_and_are_copies(make_rig):
    rotation = np.eye(3)
    rig = make_rig(rotation)
    rotation[0, 0] = 5.0
    assert rig.head_from_fisheye_rotation[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        rig.head_from_fisheye_translation[0] = 1.0


@pytest.mark.parametrize(
    ("rotation", "translation", "message"),
    [
        (1.1 * np.eye(3), (1, 0, 0), "not a rotation"),
        (np.full((3, 3), np.nan), (1, 0, 0), "not a rotation"),
        (np.eye(3)[:2], (1, 0, 0), "not a rotation"),
        (np.diag([1.0, 1.0, -1.0]), (1, 0, 0), "mirrored"),
        (np.eye(3), (0, 0, 0), "not all zero"),
        (np.eye(3), (np.nan, 0, 0), "not all zero"),
        (np.eye(3), ((1, 0, 0),), "not all zero"),
    ],
)
def test_what_is_no_rig_is_refused(make_rig, rotation, translation, message):
    with pytest.raises(GeometryError, match=message):
        make_rig(rotation, translation)
