"""Polygons on the sphere: inside, distance, and what is no polygon."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.outline import Outline
from ptzd.geometry.sphere import angle_between, bearing, normalise, rotation_from_rotvec

turns = st.tuples(*[st.floats(-3.0, 3.0)] * 3).map(rotation_from_rotvec)


def star(corners: int, radius_rad: float, turn: np.ndarray) -> Outline:
    """A star with every other corner half as far out, somewhere on the sphere."""
    around = np.arange(corners) * (2 * math.pi / corners)
    out = radius_rad * np.where(np.arange(corners) % 2, 0.5, 1.0)
    local = np.stack([np.sin(out) * np.cos(around), np.sin(out) * np.sin(around), np.cos(out)], axis=-1)
    return Outline(local @ turn.T)


def directions(count: int) -> np.ndarray:
    return normalise(np.random.default_rng(3).normal(size=(count, 3)))


@given(st.integers(3, 9), st.floats(0.02, 1.2), turns)
def test_turning_polygon_and_directions_together_changes_nothing(corners, radius, turn):
    rays = directions(200)
    straight, turned = star(corners, radius, np.eye(3)), star(corners, radius, turn)
    assert (turned.contains(rays @ turn.T) == straight.contains(rays)).mean() > 0.99
    np.testing.assert_allclose(turned.distance_rad(rays @ turn.T), straight.distance_rad(rays), atol=1e-9)


@given(st.integers(3, 9), st.floats(0.02, 1.2), turns)
def test_the_sense_of_turning_does_not_matter(corners, radius, turn):
    forward = star(corners, radius, turn)
    rays = directions(200)
    assert (Outline(forward.corners[::-1]).contains(rays) == forward.contains(rays)).all()


@given(st.integers(3, 9), st.floats(0.05, 1.2), turns)
def test_the_distance_is_that_to_the_nearest_point_of_the_border(corners, radius, turn):
    outline, rays = star(corners, radius, turn), directions(60)
    share = np.linspace(0.0, 1.0, 200)[:, None]
    following = np.roll(outline.corners, -1, axis=0)
    border = np.concatenate([a + share * (b - a) for a, b in zip(outline.corners, following, strict=True)])
    nearest = angle_between(rays[:, None], border[None]).min(axis=1)
    outside = ~outline.contains(rays)
    np.testing.assert_allclose(outline.distance_rad(rays)[outside], nearest[outside], atol=0.01)


def test_what_is_behind_is_never_inside():
    outline = star(6, 1.0, np.eye(3))
    assert outline.contains([0.0, 0.0, 1.0])
    assert not outline.contains([0.0, 0.0, -1.0])


def test_a_polygon_over_a_pole_holds_the_pole():
    outline = Outline(bearing(np.radians([-150.0, -30.0, 90.0]), np.radians([70.0, 70.0, 70.0])))
    assert outline.contains(bearing(0.7, math.pi / 2))


@pytest.mark.parametrize(
    ("pans", "tilts", "says"),
    [
        ([0, 10], [0, 0], "three corners or more, got 2"),
        ([0, 10, 10, 0], [0, 10, 0, 10], "crosses that from corner"),
        ([0, 5, 10], [0, 0, 0], "on one line"),
        ([0, 10, 10, 10], [0, 0, 0.01, 10], "corners 2 and 3 are the same"),
        ([-100, 0, 100], [0, 80, 0], "split it into smaller ones"),
        ([0, 120, 240], [0, 0, 0], "split it into smaller ones"),
    ],
)
def test_what_is_no_polygon_is_refused_by_name(pans, tilts, says):
    with pytest.raises(GeometryError, match=says):
        Outline(bearing(np.radians(pans), np.radians(tilts)))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_corners_that_are_no_numbers_are_refused(value):
    with pytest.raises(GeometryError, match="finite"):
        Outline(np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [value, 0.1, 1.0]]))
