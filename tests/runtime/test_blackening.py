"""Whatever of a picture shows a privacy zone is black, and what is well outside is as it was."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.geometry.sphere import bearing
from ptzd.geometry.zones import Zone, covers, drawn, of_bearings
from ptzd.jpeg.pixels import decode_bgr, encode_jpeg
from ptzd.model import HeadReading, ZoneKind
from ptzd.runtime.blackening import REST_RAD, SPACING_RAD, Cover, HeadScreen, blackened, fisheye_mask

WIDE_RAD = REST_RAD + SPACING_RAD + math.radians(1.8)
"""Beyond a zone's border by more than that nothing is black, blocks included, at the zooms below."""


def patch(rig, pan_deg: float, tilt_deg: float, half_deg: float) -> Zone:
    pans = (pan_deg - half_deg, pan_deg + half_deg, pan_deg + half_deg, pan_deg - half_deg)
    tilts = (tilt_deg - half_deg, tilt_deg - half_deg, tilt_deg + half_deg, tilt_deg + half_deg)
    corners = [(math.radians(pan), math.radians(tilt)) for pan, tilt in zip(pans, tilts, strict=True)]
    return of_bearings("window", ZoneKind.PRIVACY, corners, (0.0, 1e-6), rig)


@settings(max_examples=20, deadline=None)
@given(
    pan=st.floats(-60, 60),
    tilt=st.floats(-40, 40),
    half=st.floats(0.1, 15.0),
    aside=st.floats(-25, 25),
    above=st.floats(-20, 20),
    zoom=st.sampled_from([1.0, 400.0, 2500.0]),
)
def test_every_pixel_that_shows_a_zone_is_black_and_none_that_is_well_outside(
    rig, pan, tilt, half, aside, above, zoom
) -> None:
    zone = patch(rig, pan, tilt, half)
    screen = HeadScreen(rig, (zone,))
    reading = HeadReading(pan_deg=pan + aside, tilt_deg=min(max(tilt + above, -80.0), 80.0), zoom=zoom)
    mask = screen.mask(reading, REST_RAD)
    width, height = rig.zoom.size_px
    pixels = np.stack(np.meshgrid(np.arange(0, width, 5.0), np.arange(0, height, 5.0)), axis=-1)
    directions = rig.lift_from_view(pixels, reading).reshape(-1, 3)
    sampled = mask[::5, ::5].ravel()
    (outline,) = zone.head_outlines
    assert sampled[covers(zone.head_outlines, directions)].all()
    assert not sampled[outline.distance_rad(directions) > WIDE_RAD].any()


@settings(max_examples=10, deadline=None)
@given(x=st.floats(150, 400), y=st.floats(100, 300), wide=st.floats(6, 80), high=st.floats(6, 80))
def test_what_is_drawn_in_the_fisheyes_picture_is_black_there(rig, x, y, wide, high) -> None:
    corners = ((x, y), (x + wide, y), (x + wide, y + high), (x, y + high))
    mask = fisheye_mask(rig, (drawn("window", ZoneKind.PRIVACY, corners, (0.01, 0.1), rig),))
    inside = mask[math.ceil(y) : math.floor(y + high) + 1, math.ceil(x) : math.floor(x + wide) + 1]
    assert inside.all()
    rows, columns = np.indices(mask.shape)
    around = np.hypot(columns - 319.5, rows - 239.5) < 200  # farther out the lens is not known everywhere
    around[max(int(y) - 22, 0) : int(y + high) + 23, max(int(x) - 22, 0) : int(x + wide) + 23] = False
    assert not mask[around].any()


def test_a_pose_that_is_known_less_well_costs_more_of_the_picture(rig) -> None:
    screen = HeadScreen(rig, (patch(rig, 10.0, 0.0, 2.0),))
    reading = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    shares = [screen.mask(reading, math.radians(margin)).mean() for margin in (0.5, 3.0, 10.0, 180.0)]
    assert shares == sorted(shares)
    assert shares[0] < 0.1
    assert shares[-1] == 1.0


@pytest.mark.parametrize("zoom", [-100.0, 20000.0])
def test_a_zoom_that_is_not_calibrated_leaves_the_picture_black(rig, zoom) -> None:
    screen = HeadScreen(rig, (patch(rig, 2.0, 0.0, 2.0),))
    mask = screen.mask(HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=zoom), REST_RAD)
    assert mask.all()


def test_a_picture_that_shows_nothing_private_keeps_its_bytes() -> None:
    jpeg = encode_jpeg(np.full((48, 64, 3), 90, np.uint8))
    assert blackened(jpeg, np.zeros((48, 64), bool)) is jpeg


def test_what_is_black_holds_nothing_of_the_original() -> None:
    chance = np.random.default_rng(4)
    scene = chance.integers(0, 255, (48, 64, 3), dtype=np.uint8)
    other = scene.copy()
    mask = np.zeros((48, 64), bool)
    mask[8:24, 16:40] = True
    other[mask] = 255 - other[mask]
    # as decoded, for the cameras' own JPEG mixes neighbours before anything can be done
    one, two = (decode_bgr(encode_jpeg(picture)) for picture in (scene, other))
    two[~mask] = one[~mask]
    first, second = (blackened(encode_jpeg(picture), mask) for picture in (one, one))
    assert first == second
    assert decode_bgr(first)[mask].mean() < 12


@pytest.mark.parametrize("jpeg", [b"", b"\xff\xd8broken", b"GIF89a"])
def test_a_damaged_picture_shows_nothing(jpeg, caplog) -> None:
    mask = np.zeros((48, 64), bool)
    mask[0, 0] = True
    shown = decode_bgr(blackened(jpeg, mask))
    assert shown.shape == (48, 64, 3)
    assert shown.max() == 0
    assert "damaged and is left black" in caplog.text


def test_a_picture_of_another_size_shows_nothing_and_keeps_its_size() -> None:
    mask = np.zeros((48, 64), bool)
    mask[0, 0] = True
    shown = decode_bgr(blackened(encode_jpeg(np.full((30, 40, 3), 200, np.uint8)), mask))
    assert shown.shape == (30, 40, 3)
    assert shown.max() == 0


def test_the_lattice_leaves_no_hole(rig) -> None:
    zone = patch(rig, 30.0, 20.0, 12.0)
    cover = Cover([zone.head_outlines])
    pans, tilts = np.meshgrid(np.radians(np.linspace(15, 45, 200)), np.radians(np.linspace(5, 35, 200)))
    directions = bearing(pans, tilts).reshape(-1, 3)
    assert cover.near(directions[covers(zone.head_outlines, directions)], 0.0).all()
