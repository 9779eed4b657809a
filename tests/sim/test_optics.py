import numpy as np
import pytest

from ptzd.sim.imager import camera_rays
from ptzd.sim.optics import calibrated_zooms, camera_at, hfov_deg, magnification


def test_magnification_rises_from_one_and_digital_zoom_goes_on(kind):
    curve = [magnification(kind, zoom) for zoom in range(1, 10000, 7)]
    assert curve[0] == 1
    assert np.all(np.diff(curve) > 0)
    assert magnification(kind, 19998) == pytest.approx(2 * magnification(kind, 9999))


def test_the_ends_have_the_stated_fields_of_view(kind):
    assert hfov_deg(kind, 1, (1920, 1440)) == pytest.approx(kind.optics.hfov_wide_deg, abs=0.02)
    assert hfov_deg(kind, 9999, (1920, 1440)) == pytest.approx(kind.optics.hfov_tele_deg, rel=0.02)


def test_other_shapes_of_picture_are_cut_out_of_the_middle(kind):
    assert hfov_deg(kind, 1, (640, 360)) == pytest.approx(hfov_deg(kind, 1, (640, 480)), abs=0.05)
    assert hfov_deg(kind, 1, (480, 480)) < hfov_deg(kind, 1, (640, 480)) - 5


def test_the_zoom_table_spans_the_optical_range_in_even_steps(kind):
    zooms = calibrated_zooms(kind)
    assert (zooms[0], zooms[-1]) == (1, 9999)
    steps = np.diff(np.log([magnification(kind, zoom) for zoom in zooms]))
    assert steps.max() < 0.3


@pytest.mark.parametrize("zoom", [1, 400, 9999])
def test_rays_agree_with_the_lens_in_every_resolution(kind, zoom):
    for resolution in kind.resolutions[-4:]:
        width, height = map(int, resolution.split("x"))
        camera = camera_at(kind, zoom, (width, height))
        pixels, valid = camera.project(camera_rays(camera).astype(float))
        expected = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        assert valid.all()
        assert np.abs(pixels - expected).max() < 0.05
