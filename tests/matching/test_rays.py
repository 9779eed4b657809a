import numpy as np
import pytest

from ptzd.geometry.types import pixel_angle_rad
from ptzd.geometry.unified import UnifiedCamera
from ptzd.matching.rays import RayField
from ptzd.model import Box

CAMERA = UnifiedCamera(
    size_px=(640, 480),
    fx=270.0,
    fy=269.0,
    cx=321.3,
    cy=238.6,
    xi=1.1,
    distortion=(-0.04, 0.004, 0.0004, -0.0003),
    max_angle_rad=np.radians(92),
)


def grid_of(box: Box) -> tuple[np.ndarray, np.ndarray]:
    return np.arange(box.x, box.x + box.w), np.arange(box.y, box.y + box.h)


def lifted(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return CAMERA.lift(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2))


@pytest.mark.parametrize("side", [8, 40, 80, 300])
@pytest.mark.parametrize("centre", [(320, 240), (250, 130), (130, 230), (60, 60)])
def test_rays_are_those_of_the_camera(centre, side):
    box = Box(x=centre[0] - side / 2, y=centre[1] - side / 2, w=side, h=side)
    x, y = grid_of(box)
    rays, valid = RayField.of(CAMERA, box, 10.0).grid(x, y)
    expected, known = lifted(x, y)
    assert (valid == known).all()
    assert np.abs(rays - expected)[known].max(initial=0.0) < 1e-6


def test_beyond_the_margin_the_camera_is_asked():
    box = Box(x=300, y=220, w=20, h=20)
    x, y = np.arange(200.0, 240.0), np.arange(200.0, 240.0)
    assert np.array_equal(RayField.of(CAMERA, box, 10.0).grid(x, y)[0], lifted(x, y)[0])


def test_the_pixel_is_as_large_as_the_camera_says():
    box = Box(x=200, y=180, w=30, h=20)
    field = RayField.of(CAMERA, box, 10.0)
    assert field.pixel_rad == pytest.approx(pixel_angle_rad(CAMERA, box.centre), rel=1e-6)
    assert np.allclose(field.corners, CAMERA.lift(np.array(box.corners))[0])


def test_a_centre_outside_the_image_circle_is_told():
    assert not RayField.of(CAMERA, Box(x=-20, y=-20, w=20, h=20), 10.0).seen
