"""Calibrations of reconstruction, odometry and MATLAB: pixels that count from elsewhere, names instead of matrices."""

from __future__ import annotations

import copy
import json
import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.calibration.foreign.described import Asked
from ptzd.calibration.readers import read_foreign
from ptzd.errors import CalibrationError

FX, FY, CX, CY = 305.0, 304.25, 318.5, 243.75
BROWN = (-0.19, 0.05, -0.0006, 0.0009, -0.004)
BENT = (-0.02, 0.009, -0.003, 0.0004)
PINHOLE = {"fx": FX, "fy": FY, "cx": CX, "cy": CY}
SLAM = {"Camera.width": 640, "Camera.height": 480, "Camera.fps": 30, "ORBextractor.nFeatures": 1000}
TRANSFORMS = {"w": 640, "h": 480, "fl_x": FX, "fl_y": FY, "cx": CX + 0.5, "cy": CY + 0.5, "aabb_scale": 16}
SENSE = {"width": 640, "height": 480, "fx": FX, "fy": FY, "ppx": CX, "ppy": CY}
MATLAB = {
    "ImageSize": [480, 640],
    "RadialDistortion": [BROWN[0], BROWN[1], BROWN[4]],
    "TangentialDistortion": list(BROWN[2:4]),
    "MeanReprojectionError": 0.2,
    "WorldPoints": [[0, 0], [0, 30]],
}

OMNIDIR = {
    "image_width": 640,
    "image_height": 480,
    "K": [[FX, 0, CX], [0, FY, CY], [0, 0, 1]],
    "D": {"sizes": [4], "data": list(BENT)},
    "xi": {"rows": 1, "cols": 1, "data": [1.25]},
    "fisheye_model": 0,
}


def basalt(**camera):
    eye = {"px": 0.0, "qw": 1.0}
    other = {"camera_type": "ds", "intrinsics": {**PINHOLE, "xi": -0.2, "alpha": 0.6}}
    return {"value0": {"T_imu_cam": [eye, eye], "intrinsics": [other, camera], "resolution": [[640, 480]] * 2}}


def named(names, values):
    return dict(zip(names.split(), values, strict=True))


def slam(name, kind, names, values):
    lens = {**PINHOLE, **named(names, values)}
    return {"Camera.type": kind, **SLAM, **{f"{name}.{key}": value for key, value in lens.items()}}


def splined(model, bent):
    """As mrcal writes it."""
    return f"""# 'lensmodel': 'LENSMODEL_CAHVOR', as it was
{{
    'lensmodel':  'LENSMODEL_{model}',
    # fx fy cx cy
    'intrinsics': [ {FX}, {FY}, {CX},
                    {", ".join(map(str, (CY, *bent)))},],
    'extrinsics': [ 0., 0., 0., 1., 2., 3.,],
    'imagersize': [ 640, 480,],
    'icam_intrinsics': 0,
    'optimization_inputs': b'{{X*y:',
}}
"""


FLAT = [
    slam("Camera", "PinHole", "k1 k2 p1 p2 k3", BROWN),
    {**TRANSFORMS, "camera_model": "OPENCV", "frames": [{"file_path": "a.png"}], **named("k1 k2 p1 p2 k3", BROWN)},
    {**SENSE, "model": "distortion.brown_conrady", "coeffs": list(BROWN)},
    {**SENSE, "model": "Brown Conrady", "coeffs": list(BROWN)},
    {**MATLAB, "IntrinsicMatrix": [[FX, 0, 0], [0, FY, 0], [CX + 1, CY + 1, 1]]},
    {**MATLAB, "K": [[FX, 0, CX + 1], [0, FY, CY + 1], [0, 0, 1]]},
    basalt(
        camera_type="pinhole-radtan8",
        intrinsics={**PINHOLE, **named("k1 k2 p1 p2 k3 k4 k5 k6 rpmax", (*BROWN, 0, 0, 0, 2.0))},
    ),
    f"# Camera list\n1 FULL_OPENCV 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5} {' '.join(map(str, BROWN))} 0 0 0\n",
    splined("OPENCV5", BROWN),
    splined("OPENCV12", (*BROWN, *[0.0] * 7)),
    f"""% Focal length:
fc = [ {FX} ; {FY} ];
cc = [ {CX} ; {CY} ];
alpha_c = 0.0000;
kc = [ {BROWN[0]} ; {BROWN[1]} ; {BROWN[2]} ; {BROWN[3]} ; {BROWN[4]} ];
fc_error = [ 0.5 ; 0.6 ];
nx = 640;
ny = 480;
Tc_1 = [ 1.0 ; 2.0 ; 3.0 ];
""",
]
BULGED = [
    slam("Camera1", "KannalaBrandt8", "k1 k2 k3 k4", BENT),
    {**TRANSFORMS, "camera_model": "OPENCV_FISHEYE", **named("k1 k2 k3 k4", BENT)},
    {**TRANSFORMS, "is_fisheye": True, **named("k1 k2 k3 k4", BENT)},
    {**SENSE, "model": "Kannala Brandt4", "coeffs": [*BENT, 0.0]},
    basalt(camera_type="kb4", intrinsics={**PINHOLE, **named("k1 k2 k3 k4", BENT)}),
    f"7 OPENCV_FISHEYE 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5} {' '.join(map(str, BENT))}\n",
]


def read(tmp_path, source, asked=None):
    path = tmp_path / "camera.txt"
    path.write_text(source if isinstance(source, str) else json.dumps(source))
    more = Asked(camera="cam1") if isinstance(source, dict) and "value0" in source else Asked()
    return read_foreign(path, asked or more)


def fan(widest_deg):
    away, turn = np.meshgrid(np.radians(np.linspace(0.5, widest_deg, 20)), np.linspace(0.0, 6.2, 15))
    return np.stack([np.sin(away) * np.cos(turn), np.sin(away) * np.sin(turn), np.cos(away)], axis=-1).reshape(-1, 3)


def same(camera, project, bent, widest_deg):
    rays = fan(widest_deg)
    matrix = np.array([[FX, 0.0, CX], [0.0, FY, CY], [0.0, 0.0, 1.0]])
    points = (rays / rays[:, 2:]).reshape(-1, 1, 3)
    pixels = project(points, np.zeros(3), np.zeros(3), matrix, np.array(bent))[0].reshape(-1, 2)
    got, valid = camera.project(rays)
    return bool(valid.all()) and np.allclose(got, pixels, atol=1e-6) and np.allclose(camera.lift(pixels)[0], rays)


@pytest.mark.parametrize("source", FLAT, ids=range(len(FLAT)))
def test_perspective_lenses_have_the_rays_of_cv2(tmp_path, source):
    assert same(read(tmp_path, source).camera, cv2.projectPoints, BROWN, 40.0)


@pytest.mark.parametrize("source", BULGED, ids=range(len(BULGED)))
def test_fisheye_lenses_have_the_rays_of_cv2_fisheye(tmp_path, source):
    assert same(read(tmp_path, source).camera, cv2.fisheye.projectPoints, BENT, 80.0)


@pytest.mark.parametrize(
    ("line", "project", "bent"),
    [
        (f"SIMPLE_RADIAL 640 480 {FX} {CX + 0.5} {CY + 0.5} -0.1", cv2.projectPoints, (-0.1, 0, 0, 0)),
        (f"RADIAL 640 480 {FX} {CX + 0.5} {CY + 0.5} -0.1 0.02", cv2.projectPoints, (-0.1, 0.02, 0, 0)),
        (
            f"SIMPLE_RADIAL_FISHEYE 640 480 {FX} {CX + 0.5} {CY + 0.5} -0.03",
            cv2.fisheye.projectPoints,
            (-0.03, 0, 0, 0),
        ),
        (
            f"RADIAL_FISHEYE 640 480 {FX} {CX + 0.5} {CY + 0.5} -0.03 0.01",
            cv2.fisheye.projectPoints,
            (-0.03, 0.01, 0, 0),
        ),
    ],
    ids=["simple", "radial", "simple fisheye", "fisheye"],
)
def test_short_models_of_colmap(tmp_path, monkeypatch, line, project, bent):
    monkeypatch.setattr(f"{__name__}.FY", FX)
    assert same(read(tmp_path, f"1 {line}\n").camera, project, bent, 40.0)


def test_ucm_of_basalt_is_the_unified_model(tmp_path):
    alpha, rays = 0.55, fan(95.0)
    lens = {"camera_type": "ucm", "intrinsics": {**PINHOLE, "alpha": alpha}}
    camera = read(tmp_path, basalt(**lens), Asked(camera="cam1", max_angle_rad=math.radians(100.0))).camera
    pixels = rays[:, :2] / (alpha + (1.0 - alpha) * rays[:, 2:]) * (FX, FY) + (CX, CY)
    got, valid = camera.project(rays)
    assert valid.all()
    assert np.allclose(got, pixels)


@pytest.mark.parametrize(
    ("source", "words"),
    [
        (
            basalt(camera_type="ds", intrinsics={**PINHOLE, "xi": 0.1, "alpha": 0.5}),
            "camera_type ds has no counterpart",
        ),
        (basalt(camera_type="eucm", intrinsics={**PINHOLE, "alpha": 0.5, "beta": 1.2}), "eucm has no counterpart"),
        (basalt(camera_type="kb4", intrinsics={**PINHOLE, "k1": 0.1}), r"intrinsics\.k2: missing"),
        (
            basalt(
                camera_type="pinhole-radtan8",
                intrinsics={**PINHOLE, **named("k1 k2 p1 p2 k3 k4 k5 k6", (*BROWN, 0.2, 0, 0))},
            ),
            "coefficient 6 is 0.2",
        ),
        ({**TRANSFORMS, "k1": 0.1}, "camera_model: missing"),
        ({**TRANSFORMS, "camera_model": "OPENCV", "k4": 0.1}, "k4: 0.1, which perspective has not"),
        ({**TRANSFORMS, "camera_model": "OPENCV_FISHEYE", "p1": 0.1}, "p1: 0.1, which kannala_brandt has not"),
        ({**TRANSFORMS, "camera_model": "EQUIRECTANGULAR"}, "equirectangular"),
        ({**TRANSFORMS, "camera_model": "OPENCV", "frames": [{"fl_x": 3}]}, "own fl_x"),
        (
            {**SENSE, "model": "inverse_brown_conrady", "coeffs": list(BROWN)},
            "inverse_brown_conrady has no counterpart",
        ),
        ({**SENSE, "model": "distortion.ftheta", "coeffs": list(BENT)}, "ftheta"),
        ({**MATLAB, "K": [[FX, 0.4, CX], [0, FY, CY], [0, 0, 1]]}, "skew of 0.4 px"),
        ({**MATLAB, "IntrinsicMatrix": [[FX, 0, CX], [0, FY, CY], [0, 0, 1]]}, "transposed"),
        ({"MappingCoefficients": [300, 0, 0, 0]}, "polynomial has no counterpart"),
        (slam("Camera", "Fisheye62", "k1 k2", (0.1, 0.1)), "Fisheye62"),
        (slam("Camera", "KannalaBrandt8", "k1 k2 k3 k4 p1", (*BENT, 0.1)), r"Camera\.p1"),
        ({**SLAM, **{f"Camera.{key}": value for key, value in PINHOLE.items()}}, r"Camera\.type: missing"),
        (slam("Camera1", "PinHole", "k1", (0.1,)) | slam("Camera2", "PinHole", "k1", (0.1,)), "Camera1, Camera2"),
        ("1 FOV 640 480 300 300 320 240 0.9\n", "FOV of COLMAP has no counterpart"),
        (splined("SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=170", BROWN), "SPLINED.* has no counterpart"),
        (splined("OPENCV8", BROWN), "intrinsics: 9 numbers; OPENCV8 of mrcal has 12"),
        (splined("OPENCV8", (*BROWN, 0.2, 0, 0)), "coefficient 6 is 0.2"),
        (splined("OPENCV5", ("x", *BROWN[1:])), "'x' is no number"),
        (splined("OPENCV5", BROWN).replace("640, 480", "640"), "instead of width and height"),
        (splined("OPENCV5", BROWN) * 2, "lensmodel: 2 of them"),
        ("1 PINHOLE 640 480 300 300 320 240\n2 PINHOLE 640 480 nan 300 320 240\n", "line 2: no camera of COLMAP"),
        ("1 PINHOLE 640 480 300 320 240\n", "3 numbers instead of fx fy cx cy"),
        ("1 PINHOLE 640 480 300 300 320 240\n2 PINHOLE 640 480 300 300 320 240\n", "holds 2 cameras"),
        ("#polynomial coefficients for the DIRECT mapping function (ocam_model.ss)\n\n5 -1 0 0 0 0\n", "OCamCalib"),
        ("# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n\ncamera matrix\n1 0 0\n", "ost.yaml"),
        ("fc = [ 300 ; 300 ];\ncc = [ 320 ; 240 ];\nkc = [ 0 ; 0 ];\n", "kc: missing, or not 5"),
        (FLAT[-1].replace("alpha_c = 0.0000", "alpha_c = 0.001"), "skew of 0.305 px"),
        ({**OMNIDIR, "xi": -1}, "xi: -1: the mirror parameter must be 0 to 20"),
        ({**OMNIDIR, "K": [[FX, 0, CX], [0, FY, CY], [0, [[1], 2], 1]]}, "K: rows of different lengths"),
        ({**OMNIDIR, "D": {"sizes": [5], "data": list(BENT)}}, "D: 4 numbers do not make 5"),
        ({"cameras": {"v2 unknown": {"projection_type": "brown"}}}, "a list of cameras"),
        ('{"a": ' + "[" * 60 + "]" * 60 + "}", "nested deeper"),
        ('{"a": 1' + "0" * 5000 + "}", "not JSON that can be read"),
    ],
)
def test_what_has_no_counterpart_is_refused_by_name(tmp_path, source, words):
    with pytest.raises(CalibrationError, match=words) as told:
        read(tmp_path, source)
    assert "\n" not in str(told.value)
    assert "Error" not in str(told.value)


def places(value, path=()):
    yield path
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in items:
        yield from places(item, (*path, key))


WHOLE = [OMNIDIR, *(source for source in (*FLAT, *BULGED) if isinstance(source, dict))]
ODD = st.sampled_from(
    [None, "", "x", True, -1, 0, 1e300, 10**400, [], [[]], [[1], 2], {}, {"data": None}, {"rows": "a"}]
)


@given(st.sampled_from(WHOLE), st.integers(0, 200), ODD)
def test_any_value_in_any_place_gives_a_camera_or_one_sentence(tmp_path_factory, source, place, odd):
    document = copy.deepcopy(source)
    every = [path for path in places(document) if path]
    *before, last = every[place % len(every)]
    inside = document
    for key in before:
        inside = inside[key]
    inside[last] = odd
    told, camera = "", None
    try:
        camera = read(tmp_path_factory.getbasetemp(), document).camera
    except CalibrationError as error:
        told = str(error)
    assert "\n" not in told
    assert camera is None or camera.lift([320.0, 240.0])[1]
