"""How far rays reach and how much of the picture has any: areas and angles that are known from geometry."""

from __future__ import annotations

import math

import pytest

from ptzd.calibration.reach import percent, reach_of
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.unified import UnifiedCamera


@pytest.mark.parametrize("size_px", [(1000, 1000), (1600, 900), (900, 1600)], ids=str)
@pytest.mark.parametrize("edge_deg", [40.0, 90.0, 110.0])
def test_share_of_an_image_circle_is_its_area(size_px, edge_deg):
    radius = 0.4 * min(size_px)
    focal, (width, height) = radius / math.radians(edge_deg), size_px
    camera = KannalaBrandtCamera(
        size_px=size_px, fx=focal, fy=focal, cx=width / 2, cy=height / 2, max_angle_rad=math.radians(edge_deg)
    )
    reach = reach_of(camera)
    assert reach.angle_rad == pytest.approx(math.radians(edge_deg))
    assert reach.share == pytest.approx(math.pi * radius**2 / (width * height), rel=0.02)
    assert f"{edge_deg:.1f}°" in reach.told()
    assert percent(reach.share) in reach.told()
    assert "no ray" in reach.told()


def test_whole_picture_reaches_to_its_farthest_corner():
    camera = PerspectiveCamera(size_px=(640, 480), fx=300.0, fy=300.0, cx=300.0, cy=239.5)
    reach = reach_of(camera)
    assert reach.share == 1.0
    assert reach.covered.all()
    assert reach.angle_rad == pytest.approx(math.atan(math.hypot(339.5, 240.0) / 300.0))
    assert "whole picture (100 %)" in reach.told()


def test_a_corner_that_is_lost_is_never_called_the_whole():
    camera = UnifiedCamera(size_px=(500, 500), fx=500.0, fy=500.0, cx=249.5, cy=249.5, xi=1.2, max_angle_rad=1.38)
    reach = reach_of(camera)
    assert 0.999 < reach.share < 1.0
    assert "100 %" not in reach.told()
    assert reach.angle_rad == pytest.approx(1.38)
    assert percent(0.99999) == "99.9 %"
