"""Laws that hold for every camera model."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.errors import GeometryError
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import in_picture
from ptzd.geometry.unified import UnifiedCamera

SMALL = st.floats(-0.02, 0.02)
CENTRE = {"cx": st.floats(310.0, 330.0), "cy": st.floats(230.0, 250.0)}
UNIFIED = st.builds(
    UnifiedCamera,
    size_px=st.just((640, 480)),
    fx=st.floats(150.0, 500.0),
    fy=st.floats(150.0, 500.0),
    **CENTRE,
    xi=st.floats(0.0, 2.5),
    distortion=st.tuples(st.floats(-0.1, 0.1), SMALL, SMALL.map(lambda v: v / 10), SMALL.map(lambda v: v / 10)),
    max_angle_rad=st.floats(0.5, 1.9),
)
PINHOLE = st.builds(
    PerspectiveCamera,
    size_px=st.just((640, 480)),
    fx=st.floats(300.0, 20000.0),
    fy=st.floats(300.0, 20000.0),
    **CENTRE,
    distortion=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), SMALL, SMALL, SMALL),
)
KANNALA = st.builds(
    KannalaBrandtCamera,
    size_px=st.just((640, 480)),
    fx=st.floats(150.0, 400.0),
    fy=st.floats(150.0, 400.0),
    **CENTRE,
    distortion=st.tuples(st.floats(-0.1, 0.1), SMALL, SMALL, SMALL),
    max_angle_rad=st.floats(0.5, 1.9),
)
CAMERAS = st.one_of(UNIFIED, PINHOLE, KANNALA)
GRID = np.stack(np.meshgrid(np.linspace(-0.5, 639.5, 17), np.linspace(-0.5, 479.5, 13)), axis=-1)


def rays_within(camera, share):
    """Rays over all directions up to a share of the valid set; well short of a pinhole's horizon."""
    angles, turns = np.meshgrid(np.linspace(0.0, share * min(camera.limit_rad, 1.9), 12), np.linspace(0.0, 6.2, 9))
    if isinstance(camera, PerspectiveCamera) or getattr(camera, "xi", 2.0) <= 1.0:
        angles = np.minimum(angles, 1.45)
    return np.stack([np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles)], axis=-1)


@given(CAMERAS)
def test_lift_undoes_project_on_the_valid_set(camera):
    rays = rays_within(camera, 0.97)
    pixels, valid = camera.project(rays)
    assert valid.all()
    back, again = camera.lift(pixels)
    assert again.all()
    assert back == pytest.approx(rays, abs=2e-8)


@given(CAMERAS)
def test_project_undoes_lift_where_the_mask_says_so(camera):
    rays, valid = camera.lift(GRID)
    assert np.linalg.norm(rays[valid], axis=-1) == pytest.approx(1.0, abs=1e-12)
    assert not rays[~valid].any()
    angles = np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])
    assert (angles[valid] <= camera.limit_rad + 1e-12).all()
    inner = valid & (angles < camera.limit_rad * (1 - 1e-9))
    pixels, again = camera.project(rays[inner])
    assert again.all()
    assert pixels == pytest.approx(GRID[inner], abs=1e-6)


@given(CAMERAS, st.floats(0.1, 10.0))
def test_the_length_of_a_ray_does_not_matter(camera, length):
    rays = rays_within(camera, 0.9)
    assert camera.project(length * rays)[0] == pytest.approx(camera.project(rays)[0], abs=1e-6)


@given(CAMERAS)
def test_nothing_comes_out_of_the_invalid_set(camera):
    bad = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0], [0.0, 0.0, -1.0]])
    pixels, valid = camera.project(bad)
    assert not valid.any()
    assert not pixels.any()
    rays, valid = camera.lift([[np.nan, 0.0], [np.inf, 1.0], [1e40, 0.0]])
    assert not valid.any()
    assert not rays.any()


@given(CAMERAS)
def test_the_axis_is_the_principal_point(camera):
    pixel, valid = camera.project([0.0, 0.0, 1.0])
    assert valid
    assert pixel.tolist() == [camera.cx, camera.cy]
    ray, valid = camera.lift([camera.cx, camera.cy])
    assert valid
    assert ray.tolist() == [0.0, 0.0, 1.0]


@given(CAMERAS)
def test_beyond_the_angle_limit_nothing_projects(camera):
    angle = camera.limit_rad + 1e-6
    assert not camera.project([math.sin(angle), 0.0, math.cos(angle)])[1]


@given(PINHOLE)
def test_a_unified_camera_of_xi_0_is_a_pinhole(pinhole):
    pinhole = PerspectiveCamera(
        size_px=(640, 480),
        fx=pinhole.fx,
        fy=pinhole.fy,
        cx=pinhole.cx,
        cy=pinhole.cy,
        distortion=(*pinhole.distortion[:4], 0),
    )
    unified = UnifiedCamera(
        size_px=(640, 480),
        fx=pinhole.fx,
        fy=pinhole.fy,
        cx=pinhole.cx,
        cy=pinhole.cy,
        xi=0.0,
        distortion=pinhole.distortion[:4],
        max_angle_rad=1.57,
    )
    rays = rays_within(pinhole, 0.97)
    assert unified.project(rays)[0] == pytest.approx(pinhole.project(rays)[0], abs=1e-6)
    lifted, valid = unified.lift(GRID)
    expected, valid_pinhole = pinhole.lift(GRID)
    sure = np.arccos(np.clip(expected[..., 2], -1, 1)) < min(pinhole.limit_rad, unified.limit_rad) - 1e-6
    assert (valid == valid_pinhole)[sure].all()
    assert lifted[sure] == pytest.approx(expected[sure], abs=1e-9)


@given(PINHOLE)
def test_opencv_projects_the_same_pinhole(camera):
    rays = rays_within(camera, 0.9).reshape(-1, 3)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))
    assert camera.project(rays)[0] == pytest.approx(expected[:, 0], rel=1e-9, abs=1e-6)


@given(KANNALA)
def test_opencv_projects_the_same_kannala_brandt(camera):
    rays = rays_within(camera, 0.95).reshape(-1, 3)
    rays = rays[rays[:, 2] > 0.05]
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    zeros = np.zeros((3, 1))
    expected, _ = cv2.fisheye.projectPoints(rays[:, None], zeros, zeros, matrix, np.array(camera.distortion))
    assert camera.project(rays)[0] == pytest.approx(expected[:, 0], abs=1e-6)


@given(UNIFIED)
def test_the_unified_camera_is_the_sphere_seen_by_a_pinhole(camera):
    rays = rays_within(camera, 0.97).reshape(-1, 3)
    shifted = rays + np.array([0.0, 0.0, camera.xi])
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])
    expected, _ = cv2.projectPoints(shifted, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))
    assert camera.project(rays)[0] == pytest.approx(expected[:, 0], rel=1e-9, abs=1e-6)


def test_the_unified_lift_is_the_root_of_the_paper():
    camera = UnifiedCamera(size_px=(640, 480), fx=282.0, fy=280.0, cx=319.5, cy=239.5, xi=1.2)
    x, y = (400.0 - 319.5) / 282.0, (100.0 - 239.5) / 280.0
    omega, mirror = x * x + y * y, 1.2
    root = math.sqrt((2 * mirror * omega) ** 2 - 4 * (omega + 1) * (mirror**2 * omega - 1))
    z = (-2 * mirror * omega + root) / (2 * (omega + 1))
    assert camera.lift([400.0, 100.0])[0] == pytest.approx([x * (z + mirror), y * (z + mirror), z])


@pytest.mark.parametrize(("xi", "rim"), [(2.0, 2 * math.pi / 3), (0.5, 2 * math.pi / 3), (1.0, math.pi)])
def test_the_rim_of_the_unified_model(xi, rim):
    camera = UnifiedCamera(size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=xi, max_angle_rad=3.141)
    assert camera.limit_rad == pytest.approx(min(rim, 3.141), abs=0.02)


def test_the_fold_of_the_distortion_bounds_every_model():
    barrel = {"size_px": (640, 480), "fx": 300.0, "fy": 300.0, "cx": 319.5, "cy": 239.5}
    pinhole = PerspectiveCamera(**barrel, distortion=(-0.3, 0.0, 0.0, 0.0, 0.0))
    assert pinhole.limit_rad == pytest.approx(math.atan(math.sqrt(1 / 0.9)), abs=2e-3)
    assert not pinhole.lift([[0.0, 0.0]])[1].any()
    unified = UnifiedCamera(**barrel, xi=0.0, distortion=(-0.3, 0.0, 0.0, 0.0))
    assert unified.limit_rad == pytest.approx(pinhole.limit_rad)
    kannala = KannalaBrandtCamera(**barrel, distortion=(-0.3, 0.0, 0.0, 0.0))
    assert kannala.limit_rad == pytest.approx(math.sqrt(1 / 0.9), abs=2e-3)


def test_field_of_view_is_edge_to_edge():
    camera = PerspectiveCamera(size_px=(640, 480), fx=554.256, fy=554.256, cx=319.5, cy=239.5)
    assert math.degrees(camera.hfov_rad) == pytest.approx(60.0, abs=1e-3)
    corner = camera.project(camera.lift([-0.5, -0.5])[0])[0]
    assert in_picture(camera, corner + 1e-9)


@pytest.mark.parametrize(
    ("model", "wrong"),
    [
        (UnifiedCamera, {"fx": -1.0, "xi": 1.0}),
        (UnifiedCamera, {"xi": -0.1}),
        (UnifiedCamera, {"xi": 1.0, "max_angle_rad": 4.0}),
        (PerspectiveCamera, {"fy": 0.0}),
        (KannalaBrandtCamera, {"fy": -3.0}),
        (KannalaBrandtCamera, {"max_angle_rad": 0.0}),
    ],
)
def test_what_is_no_camera_is_refused(model, wrong):
    values = {"size_px": (640, 480), "fx": 300.0, "fy": 300.0, "cx": 319.5, "cy": 239.5} | wrong
    with pytest.raises(GeometryError, match="not a"):
        model(**values)


def test_a_wrong_shape_is_refused_with_the_shape():
    camera = PerspectiveCamera(size_px=(640, 480), fx=300.0, fy=300.0, cx=319.5, cy=239.5)
    with pytest.raises(GeometryError, match=r"\(5,\)"):
        camera.project(np.zeros(5))


def test_empty_arrays_pass_through():
    for camera in (
        UnifiedCamera(size_px=(640, 480), fx=300.0, fy=300.0, cx=319.5, cy=239.5, xi=1.0, distortion=(0.1, 0, 0, 0)),
        KannalaBrandtCamera(size_px=(640, 480), fx=300.0, fy=300.0, cx=319.5, cy=239.5),
    ):
        assert camera.lift(np.zeros((0, 2)))[0].shape == (0, 3)
        assert camera.project(np.zeros((0, 3)))[0].shape == (0, 2)
