import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from ptzd.errors import GeometryError
from ptzd.geometry.zoom import ZoomEntry, ZoomTable, hermite, pchip_slopes

STEPS = st.floats(0.05, 3.0)
VALUES = st.integers(-5_000_000_000, 5_000_000_000).map(lambda billionths: billionths / 1e9)
"""Equal or further apart than 1e-9: the reciprocal of a slope between two of them is a number, as scipy needs it."""


def table(*focals, zooms=None, **common):
    zooms = zooms or [1 + 1000 * index for index in range(len(focals))]
    entries = [
        ZoomEntry(zoom=z, fx=f, fy=f, **{"cx": 319.5, "cy": 239.5} | common) for z, f in zip(zooms, focals, strict=True)
    ]
    return ZoomTable(size_px=(640, 480), entries=tuple(entries))


@given(st.lists(st.tuples(STEPS, VALUES), min_size=2, max_size=8))
def test_the_interpolant_is_scipys_pchip(nodes):
    x = np.cumsum([step for step, _ in nodes])
    y = np.array([value for _, value in nodes])
    at = np.linspace(x[0], x[-1], 50)
    ours = hermite(x, y[:, None], pchip_slopes(x, y[:, None]), at)[:, 0]
    assert ours == pytest.approx(PchipInterpolator(x, y)(at), abs=1e-9)
    assert hermite(x, y[:, None], pchip_slopes(x, y[:, None]), x)[:, 0] == pytest.approx(y, abs=1e-12)


@given(st.lists(st.floats(1.02, 3.0), min_size=1, max_size=6))
def test_focal_length_grows_with_zoom_and_hits_the_entries(ratios):
    focals = (500.0 * np.cumprod([1.0, *ratios])).tolist()
    zoom = table(*focals)
    cameras = [zoom.camera_at(z).fx for z in np.linspace(*zoom.zoom_range, 60)]
    assert (np.diff(cameras) > 0).all()
    for entry in zoom.entries:
        assert zoom.camera_at(entry.zoom).fx == pytest.approx(entry.fx, rel=1e-12)


@given(st.lists(st.floats(1.02, 3.0), min_size=1, max_size=6), st.floats(0.0, 1.0))
def test_the_zoom_of_a_field_of_view_has_it(ratios, share):
    zoom = table(*(500.0 * np.cumprod([1.0, *ratios])).tolist(), cx=310.0)
    narrow, wide = zoom.hfov_range_rad
    wanted = narrow + share * (wide - narrow)
    assert zoom.camera_at(zoom.zoom_for_hfov(wanted)).hfov_rad == pytest.approx(wanted, abs=1e-9)
    focal = 500.0 ** (1 - share) * zoom.entries[-1].fx ** share
    focal = min(max(focal, 500.0), zoom.entries[-1].fx)
    assert zoom.camera_at(zoom.zoom_for_focal(focal)).fx == pytest.approx(focal, rel=1e-9)


def test_the_ends_of_the_field_of_view_are_the_ends_of_the_zoom():
    zoom = table(500.0, 900.0, 5000.0)
    narrow, wide = zoom.hfov_range_rad
    assert zoom.zoom_for_hfov(wide) == pytest.approx(1.0, abs=1e-6)
    assert zoom.zoom_for_hfov(narrow) == pytest.approx(2001.0, abs=1e-6)


def test_a_single_entry_serves_its_zoom_only():
    zoom = table(554.3)
    assert zoom.camera_at(1.0).fx == pytest.approx(554.3)
    assert zoom.zoom_for_hfov(zoom.camera_at(1).hfov_rad) == 1.0
    assert zoom.zoom_for_focal(554.3) == 1.0
    with pytest.raises(GeometryError, match="zoom 2 is outside the calibrated range 1 to 1"):
        zoom.camera_at(2.0)


def test_everything_else_is_interpolated_too():
    entries = (
        ZoomEntry(zoom=1, fx=500.0, fy=510.0, cx=320.0, cy=240.0, distortion=(-0.2, 0.1, 0.0, 0.0, 0.0)),
        ZoomEntry(zoom=101, fx=1000.0, fy=1010.0, cx=310.0, cy=244.0, distortion=(0.0, 0.0, 0.0, 0.0, 0.0)),
    )
    camera = ZoomTable(size_px=(640, 480), entries=entries).camera_at(51)
    assert camera.fx == pytest.approx(math.sqrt(500 * 1000))
    assert camera.cx == pytest.approx(315.0)
    assert camera.distortion == pytest.approx((-0.1, 0.05, 0.0, 0.0, 0.0))


def test_nothing_is_extrapolated_past_half_a_unit():
    zoom = table(500.0, 900.0)
    assert zoom.camera_at(0.6).fx == pytest.approx(500.0)
    assert zoom.camera_at(1001.4).fx == pytest.approx(900.0)
    with pytest.raises(GeometryError, match="zoom 1002 is outside"):
        zoom.camera_at(1002)
    with pytest.raises(GeometryError, match=r"field of view 90\.00° is outside"):
        zoom.zoom_for_hfov(math.radians(90.0))
    with pytest.raises(GeometryError, match=r"fx 400\.00 px is outside"):
        zoom.zoom_for_focal(400.0)


def test_a_table_must_grow():
    with pytest.raises(GeometryError, match="no entries"):
        ZoomTable(size_px=(640, 480), entries=())
    with pytest.raises(GeometryError, match="increase strictly"):
        table(500.0, 400.0)
    with pytest.raises(GeometryError, match="increase strictly"):
        table(500.0, 600.0, zooms=[5, 5])
