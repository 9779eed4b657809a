import math

import numpy as np
import pytest

from ptzd.errors import GeometryError
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import checked, in_picture, pixel_angle_rad

PINHOLE = PerspectiveCamera(size_px=(640, 480), fx=500.0, fy=500.0, cx=319.5, cy=239.5)
EQUIDISTANT = KannalaBrandtCamera(size_px=(640, 480), fx=200.0, fy=200.0, cx=319.5, cy=239.5, max_angle_rad=1.0)


def test_a_wrong_shape_is_named():
    with pytest.raises(GeometryError, match=r"rays: expected shape \(\.\.\., 3\), got \(4, 2\)"):
        checked(np.zeros((4, 2)), 3, "rays")
    with pytest.raises(GeometryError, match=r"got \(\)"):
        checked(1.0, 3, "rays")


def test_the_picture_reaches_half_a_pixel_past_the_outer_centres():
    points = [[-0.5, -0.5], [639.5, 479.5], [-0.51, 0], [0, 479.6], [np.nan, 0]]
    assert in_picture(PINHOLE, points).tolist() == [True, True, False, False, False]
    assert in_picture(PINHOLE, [[0.0, 0.0], [-0.1, 0.0]], margin_px=0.5).tolist() == [True, False]


def test_a_pixel_at_the_centre_is_one_over_the_focal_length():
    assert pixel_angle_rad(PINHOLE, (319.5, 239.5)) == pytest.approx(1 / 500, rel=1e-5)
    assert pixel_angle_rad(EQUIDISTANT, (319.5, 239.5)) == pytest.approx(1 / 200, rel=1e-5)


def test_an_equidistant_pixel_shrinks_across_the_radius_only():
    angle = 0.8
    across = math.sin(angle) / angle
    size = pixel_angle_rad(EQUIDISTANT, (319.5 + 200 * angle, 239.5))
    assert size == pytest.approx(math.sqrt(across) / 200, rel=1e-5)


def test_at_the_rim_the_inner_half_stands_for_the_pixel():
    inside = pixel_angle_rad(EQUIDISTANT, (319.5 + 200 * 0.99, 239.5))
    assert pixel_angle_rad(EQUIDISTANT, (319.5 + 199.9, 239.5)) == pytest.approx(inside, rel=0.01)


def test_no_pixel_outside_the_circle_has_a_size():
    with pytest.raises(GeometryError, match=r"pixel \(5, 5\) lies outside"):
        pixel_angle_rad(EQUIDISTANT, (5, 5))
