import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from ptzd.geometry.brown import FOLD_GUARD, MAX_RADIUS, distort, fold_radius, radius_limit, undistort

COEFFICIENTS = st.tuples(
    st.floats(-0.4, 0.4), st.floats(-0.2, 0.2), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.1, 0.1)
)


@given(COEFFICIENTS, st.floats(0.0, 0.99), st.floats(0.0, 2 * math.pi))
def test_undistort_inverts_distort_up_to_the_fold(coefficients, share, angle):
    radius = min(share * radius_limit(coefficients), 5.0)
    point = radius * np.array([math.cos(angle), math.sin(angle)])
    found, valid = undistort(distort(point, coefficients), coefficients)
    assert valid
    assert np.abs(distort(found, coefficients) - distort(point, coefficients)).max() <= 1e-9
    assert found == pytest.approx(point, abs=1e-7)


@given(COEFFICIENTS)
def test_the_jacobian_stays_positive_before_the_fold(coefficients):
    radius = 0.999 * fold_radius(coefficients)
    assume(radius < 10.0)
    angles = np.linspace(0.0, 2 * math.pi, 60)
    points = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    h = 1e-6
    columns = [
        (distort(points + h * e, coefficients) - distort(points - h * e, coefficients)) / (2 * h) for e in np.eye(2)
    ]
    jacobian = np.stack(columns, axis=-1)
    assert np.abs(jacobian[:, 0, 1] - jacobian[:, 1, 0]).max() < 1e-5
    assert (np.linalg.eigvalsh(jacobian) > -1e-6).all()


def test_the_fold_of_pure_barrel_is_where_its_radius_peaks():
    assert fold_radius((-0.3, 0.0, 0.0, 0.0)) == pytest.approx(math.sqrt(1 / 0.9))
    assert fold_radius((0.0, 0.0, 0.0, 0.0)) > 1e100
    assert fold_radius((0.1, 0.0, 0.0, 0.0)) > 1e100
    assert fold_radius((1e-308, 0.0, 0.0, 0.0)) > 1e100
    assert radius_limit((0.1, 0.0, 0.0, 0.0)) == MAX_RADIUS
    assert radius_limit((-0.3, 0.0, 0.0, 0.0)) == pytest.approx(FOLD_GUARD * math.sqrt(1 / 0.9))


def test_what_no_ideal_point_maps_to_is_masked():
    beyond = np.array([[2.0, 0.0], [np.nan, 0.0], [np.inf, 1.0], [0.1, 0.1]])
    found, valid = undistort(beyond, (-0.3, 0.0, 0.0, 0.0))
    assert valid.tolist() == [False, False, False, True]
    assert not found[:3].any()


def test_without_distortion_points_come_back_bit_by_bit():
    points = np.array([[0.3, -0.7], [2e4, 0.0]])
    found, valid = undistort(points, (0.0, 0.0, 0.0, 0.0))
    assert valid.tolist() == [True, False]
    assert (found[0] == points[0]).all()


def test_mixed_signs_converge_too():
    coefficients = (-0.9, 1.2, 0.0, 0.0, -0.05)
    points = np.stack([np.linspace(0.0, 0.99 * radius_limit(coefficients), 200), np.zeros(200)], axis=-1)
    found, valid = undistort(distort(points, coefficients), coefficients)
    assert valid.all()
    assert found == pytest.approx(points, abs=1e-8)
