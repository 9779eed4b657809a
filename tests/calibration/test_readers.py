"""Calibrations of other tools: rays before are rays after, and what our models cannot say is refused by name."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest

from ptzd.calibration.foreign.described import Asked
from ptzd.calibration.readers import read_foreign
from ptzd.errors import CalibrationError

K = [[310.5, 0.0, 322.25], [0.0, 309.25, 238.5], [0.0, 0.0, 1.0]]
FLAT_K = [value for row in K for value in row]
BENT = [-0.03, 0.012, -0.004, 0.0006]
BROWN = [-0.21, 0.06, 0.0008, -0.0005, -0.007]
SIZE = {"image_width": 640, "image_height": 480}
WIDE = Asked(max_angle_rad=math.radians(100.0))
FLAT = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": BROWN, "k": FLAT_K}
CHAIN = {
    "camera_model": "omni",
    "distortion_model": "radtan",
    "intrinsics": [1.3, 420.0, 421.0, 318.0, 242.0],
    "distortion_coeffs": [-0.12, 0.03, 0.0007, -0.0009],
    "resolution": [640, 480],
}
MEI = {
    "model_type": "MEI",
    "camera_name": "sky",
    **SIZE,
    "mirror_parameters": {"xi": 1.3},
    "distortion_parameters": {"k1": -0.12, "k2": 0.03, "p1": 0.0007, "p2": -0.0009},
    "projection_parameters": {"gamma1": 420.0, "gamma2": 421.0, "u0": 318.0, "v0": 242.0},
}
ESTIMATOR = {
    "imu_topic": "/imu",
    "image_topic": "/front",
    "extrinsicRotation": {"rows": 3, "cols": 3, "dt": "d", "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
    "max_cnt": 120,
    "F_threshold": 1.0,
    "fisheye": 1,
    "focal_length": 460,
    "acc_n": 0.1,
    "td": 0.0,
}
"""Of the settings that VINS keeps beside the lens; `fisheye` is a mask."""


def rays(widest_deg: float) -> np.ndarray:
    away, turn = np.meshgrid(np.radians(np.linspace(0.5, widest_deg, 25)), np.linspace(0.0, 6.2, 20))
    return np.stack([np.sin(away) * np.cos(turn), np.sin(away) * np.sin(turn), np.cos(away)], axis=-1).reshape(-1, 3)


def same_rays(camera, pixels, directions) -> bool:
    got, valid = camera.project(directions)
    back, lifted = camera.lift(pixels)
    return bool(valid.all() and lifted.all()) and np.allclose(got, pixels, atol=1e-6) and np.allclose(back, directions)


def by_opencv(project, directions, bent):
    """Pixels of directions before the camera by OpenCV itself."""
    points = (directions / directions[:, 2:]).reshape(-1, 1, 3)
    return project(points, np.zeros(3), np.zeros(3), np.array(K), np.array(bent))[0].reshape(-1, 2)


def stored(path, **values):
    """A file as OpenCV itself writes it, in the notation of its suffix."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in {**SIZE, "camera_matrix": np.array(K), **values}.items():
        file.write(name, value)
    file.release()
    return path


def dumped(tmp_path, values):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(values))
    return path


def mei(directions, values=MEI):
    """Mei & Rives 2007, equations 1 to 5, one ray after the other."""
    xi, bent, plane = (
        values["mirror_parameters"]["xi"],
        values["distortion_parameters"],
        values["projection_parameters"],
    )
    pixels = []
    for ray in directions:
        x, y = ray[:2] / (ray[2] + xi * np.linalg.norm(ray))
        grown = x * x + y * y
        scale = 1.0 + bent["k1"] * grown + bent["k2"] * grown**2
        u = x * scale + 2.0 * bent["p1"] * x * y + bent["p2"] * (grown + 2.0 * x * x)
        v = y * scale + bent["p1"] * (grown + 2.0 * y * y) + 2.0 * bent["p2"] * x * y
        pixels.append((plane["gamma1"] * u + plane["u0"], plane["gamma2"] * v + plane["v0"]))
    return np.array(pixels)


@pytest.mark.parametrize("suffix", ["yml", "yaml", "json", "xml"])
@pytest.mark.parametrize("shape", [(4,), (1, 4), (4, 1)], ids=str)
def test_fisheye_that_opencv_wrote_has_the_rays_of_cv2_fisheye(tmp_path, suffix, shape):
    path = stored(
        tmp_path / f"lens.{suffix}", fisheye_model=1, distortion_coefficients=np.array(BENT).reshape(shape), rms=0.2
    )
    directions = rays(80.0)
    assert same_rays(read_foreign(path).camera, by_opencv(cv2.fisheye.projectPoints, directions, BENT), directions)


@pytest.mark.parametrize("coefficients", [BROWN, [*BROWN, 0.0, 0.0, 0.0], BROWN[:4]], ids=len)
def test_perspective_that_opencv_wrote_has_the_rays_of_cv2(tmp_path, coefficients):
    path = stored(tmp_path / "lens.xml", fisheye_model=0, distortion_coefficients=np.array([coefficients]))
    directions = rays(40.0)
    assert same_rays(read_foreign(path).camera, by_opencv(cv2.projectPoints, directions, coefficients), directions)


@pytest.mark.parametrize(
    "values",
    [
        FLAT,
        {**FLAT, "header": {"stamp": {"sec": 1}}, "r": [1, 0, 0, 0, 1, 0, 0, 0, 1], "p": [0.5] * 12, "binning_x": 0},
        {"image_width": 640, "image_height": 480, "distortion_model": "plumb_bob", "D": BROWN, "K": FLAT_K},
        {**SIZE, "mtx": K, "dist": [BROWN]},
        {
            "camera_model": "pinhole",
            "distortion_model": "radial-tangential",
            "intrinsics": [310.5, 309.25, 322.25, 238.5],
            "distortion_coefficients": BROWN[:4],
            "resolution": [640, 480],
            "rate_hz": 20,
            "T_BS": {"rows": 4, "cols": 4, "data": [0.0] * 16},
        },
        {
            "model_type": "PINHOLE",
            **SIZE,
            "distortion_parameters": dict(zip(("k1", "k2", "p1", "p2"), BROWN, strict=False)),
            "projection_parameters": {"fx": 310.5, "fy": 309.25, "cx": 322.25, "cy": 238.5},
        },
    ],
    ids=["echo", "message", "ros1", "arrays", "euroc", "camodocal"],
)
def test_perspective_of_others_has_the_rays_of_cv2(tmp_path, values):
    four = "resolution" in values or "model_type" in values
    directions = rays(40.0)
    pixels = by_opencv(cv2.projectPoints, directions, BROWN[:4] if four else BROWN)
    assert same_rays(read_foreign(dumped(tmp_path, values)).camera, pixels, directions)


@pytest.mark.parametrize(
    "values",
    [
        {**FLAT, "distortion_model": "equidistant", "d": BENT},
        {**FLAT, "distortion_model": "equidistant", "d": [*BENT, 0.0]},
        {"M": {"rows": 3, "cols": 3, "data": FLAT_K}, "D": BENT, "width": 640, "height": 480, "model": "fisheye"},
        {**SIZE, "K": K, "D": BENT, "fisheye": True},
        {"cam0": {**CHAIN, "camera_model": "pinhole", "distortion_model": "equidistant"}},
        {
            "model_type": "KANNALA_BRANDT",
            **SIZE,
            "projection_parameters": dict(
                zip(
                    ("k2", "k3", "k4", "k5", "mu", "mv", "u0", "v0"), (*BENT, 310.5, 309.25, 322.25, 238.5), strict=True
                )
            ),
        },
    ],
    ids=["ros", "five", "voxl", "flag", "kalibr", "camodocal"],
)
def test_fisheye_of_others_has_the_rays_of_cv2_fisheye(tmp_path, values):
    if "cam0" in values:
        values["cam0"] |= {"intrinsics": [310.5, 309.25, 322.25, 238.5], "distortion_coeffs": BENT}
    directions = rays(80.0)
    pixels = by_opencv(cv2.fisheye.projectPoints, directions, BENT)
    assert same_rays(read_foreign(dumped(tmp_path, values)).camera, pixels, directions)


@pytest.mark.parametrize(
    "values",
    [
        MEI,
        {**MEI, **ESTIMATOR},
        {"cam0": CHAIN},
        CHAIN,
        {
            **SIZE,
            "xi": {"rows": 1, "cols": 1, "data": [1.3]},
            "K": [[420.0, 0, 318.0], [0, 421.0, 242.0], [0, 0, 1]],
            "D": CHAIN["distortion_coeffs"],
        },
    ],
    ids=["camodocal", "vins", "chain", "kalibr", "omnidir"],
)
def test_unified_of_others_has_the_rays_of_mei_and_rives(tmp_path, values):
    directions = rays(95.0)
    assert same_rays(read_foreign(dumped(tmp_path, values), WIDE).camera, mei(directions), directions)


def test_eucm_with_beta_1_is_the_unified_model(tmp_path):
    alpha, focal = 0.6, 250.0
    lens = {**CHAIN, "camera_model": "eucm", "distortion_model": "none", "distortion_coeffs": []}
    directions = rays(90.0)
    path = dumped(tmp_path, {"cam0": {**lens, "intrinsics": [alpha, 1.0, focal, focal, 320.0, 240.0]}})
    pixels = focal * directions[:, :2] / (alpha + (1.0 - alpha) * directions[:, 2:]) + (320.0, 240.0)
    assert same_rays(read_foreign(path, WIDE).camera, pixels, directions)
    path = dumped(tmp_path, {"cam0": {**lens, "intrinsics": [alpha, 1.1, focal, focal, 320.0, 240.0]}})
    with pytest.raises(CalibrationError, match=r"beta 1\.1"):
        read_foreign(path)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({**SIZE, "K": K, "D": BENT}, "--model"),
        ({**SIZE, "K": K, "D": []}, "--model"),
        ({**FLAT, "distortion_model": "", "d": BENT}, "--model"),
        ({"K": K, "D": BROWN}, "--size"),
        ({**FLAT, "k": [310.5, 0.3, 322.25, 0, 309.25, 238.5, 0, 0, 1]}, "skew of 0.3 px"),
        ({**SIZE, "fisheye_model": 1, "K": [[310.5, -2, 322.25], *K[1:]], "D": BENT}, "skew of -2 px"),
        ({**FLAT, "d": [*BROWN, 0.0, 0.02, 0.0]}, "coefficient 7 is 0.02"),
        ({**FLAT, "d": [*BROWN, 0, 0, 0, 0, 0, 0, 0, 0, 0.01]}, "coefficient 14 is 0.01"),
        ({**FLAT, "distortion_model": "equidistant", "d": [*BENT, 0.5]}, "coefficient 5 is 0.5"),
        ({**FLAT, "distortion_model": "equidistant", "d": BENT[:2]}, "2 distortion coefficients"),
        ({**FLAT, "k": np.array(K).T.ravel().tolist()}, "transposed"),
        ({**FLAT, "k": [*FLAT_K[:8], 2.0]}, "no camera matrix"),
        ({**FLAT, "k": FLAT_K[:6]}, "no camera matrix|of a camera matrix"),
        ({**FLAT, "width": 1280, "height": 960}, "another resolution"),
        ({**FLAT, "width": 480, "height": 640}, "swapped"),
        ({**FLAT, "height": 360}, "of a crop"),
        ({**FLAT, "k": [0.9, 0, 0.5, 0, 0.9, 0.5, 0, 0, 1]}, "no focal length"),
        ({**FLAT, "k": [310.0, 0, 320.0, 0, 31.0, 240.0, 0, 0, 1]}, "fy"),
        ({**FLAT, "k": [-310.0, 0, 320.0, 0, 310.0, 240.0, 0, 0, 1]}, "fx"),
        ({**FLAT, "d": [-50.0, 0, 0, 0, 0]}, "folds back"),
        ({**FLAT, "d": [float("inf"), 0, 0, 0]}, "Infinity"),
        ({**FLAT, "d": ["a", 0, 0, 0]}, r"d\[0\]: 'a' is no number"),
        ({**FLAT, "binning_x": 2}, "binning_x"),
        ({**FLAT, "roi": {"x_offset": 8, "y_offset": 0, "height": 0, "width": 0}}, "roi.x_offset"),
        ({**FLAT, "distortion_model": "ftheta"}, "ftheta"),
        ({**FLAT, "fisheye": True}, "contradicts itself"),
        ({**FLAT, "k6": 0.3}, "k6: 0.3 is not understood"),
        ({**FLAT, "lens": {"thin_prism": [0.1, 0.2]}}, "lens: .* is not understood"),
        ({**FLAT, "camera_matrix": K}, "both given"),
        ({**FLAT, "width": 640.5}, "no number of pixels"),
        ({"cam0": CHAIN, "cam1": CHAIN}, r"holds 2 cameras \(cam0, cam1\).*--camera"),
        ({"cam0": {**CHAIN, "camera_model": "ds"}}, "ds-radtan has no counterpart"),
        ({"cam0": {**CHAIN, "distortion_model": "fov"}}, "omni-fov has no counterpart"),
        ({"cam0": {**CHAIN, "distortion_model": "none"}}, "with distortion_model none"),
        ({"cam0": {**CHAIN, "intrinsics": [400, 400, 320, 240]}}, "omni has 5"),
        ({"cam0": {**CHAIN, "gamma": 2.0}}, "cam0.gamma"),
        ({**MEI, "model_type": "SCARAMUZZA"}, "SCARAMUZZA"),
        ({**MEI, "distortion_parameters": {"k1": 0.1, "k2": 0, "p1": 0}}, "distortion_parameters.p2: missing"),
        ({**MEI, "projection_parameters": {**MEI["projection_parameters"], "s": 0.2}}, "projection_parameters.s"),
        ({**MEI, **ESTIMATOR, "skew": 0.2}, "skew: 0.2 is not understood"),
        ({**MEI, **ESTIMATOR, "affine_parameters": {"ac": 1.0}}, "affine_parameters: .* is not understood"),
        ({**MEI, **ESTIMATOR, "image_scale": 0.5}, "image_scale: 0.5 is not understood"),
        ({**FLAT, "k": [0.0] * 9}, "no calibration"),
        ({"cam0": CHAIN, "distortion_scale": 2.0}, "distortion_scale: 2.0 is not understood"),
        ({**SIZE, "cam": {"camera_matrix": K, "D": BROWN, "skew": 1.0}}, r"cam\.skew: 1.0 is not understood"),
        ({**SIZE, "cameraMatrix1": K, "distCoeffs1": BROWN}, "of a pair"),
        ({"K_02": FLAT_K, "D_02": BROWN}, "K_02: of a pair"),
        ({"cam0_calib": "left.yaml", **SIZE}, "give the file that cam0_calib"),
        ({"fisheye_params": {"camera_matrix": K, "distortion_coeffs": BENT}}, "Gyroflow"),
        ({"views": [], "intrinsics": [{"type": "fisheye4"}]}, "Meshroom"),
        ({"ptzd_calibration": 1}, "already"),
        ({"a": 1}, "none of camera_matrix"),
        ({**SIZE, "fx": 310.0, "fy": 310.0, "cx": 320.0, "cy": 240.0, "k1": 0.1, "k2": 0.0}, "none of camera_matrix"),
    ],
)
def test_what_is_left_open_or_has_no_counterpart_is_refused_by_name(tmp_path, values, words):
    path = dumped(tmp_path, values)
    with pytest.raises(CalibrationError, match=words) as told:
        read_foreign(path)
    assert str(told.value).startswith(f"{path}: ")
    assert "\n" not in str(told.value)
    assert "Error" not in str(told.value)


def test_model_that_is_asked_for_is_the_one_that_is_read_or_the_file_is_refused(tmp_path):
    silent, directions = dumped(tmp_path, {**SIZE, "K": K, "D": BENT}), rays(40.0)
    for model, project in (("kannala_brandt", cv2.fisheye.projectPoints), ("perspective", cv2.projectPoints)):
        camera = read_foreign(silent, Asked(model=model)).camera
        assert same_rays(camera, by_opencv(project, directions, BENT), directions)
    with pytest.raises(CalibrationError, match="no xi"):
        read_foreign(silent, Asked(model="unified"))
    with pytest.raises(CalibrationError, match="numbers are of perspective"):
        read_foreign(dumped(tmp_path, FLAT), Asked(model="kannala_brandt"))


def test_size_that_is_asked_for_fills_a_gap_confirms_a_decentred_lens_and_contradicts_nothing(tmp_path):
    assert read_foreign(dumped(tmp_path, {"K": K, "D": BROWN}), Asked(size_px=(640, 480))).camera.size_px == (640, 480)
    cut = dumped(tmp_path, {**FLAT, "height": 360})
    assert read_foreign(cut, Asked(size_px=(640, 360))).camera.size_px == (640, 360)
    with pytest.raises(CalibrationError, match="640×360 px, --size asks for 640×480"):
        read_foreign(cut, Asked(size_px=(640, 480)))


def test_camera_of_a_chain_is_chosen_by_name(tmp_path):
    other = {**CHAIN, "intrinsics": [1.1, 400.0, 400.0, 330.0, 250.0], "T_cn_cnm1": [[1, 0, 0, 0.1]]}
    path = dumped(tmp_path, {"cam0": CHAIN, "cam1": other})
    read = read_foreign(path, Asked(camera="cam1"))
    assert (read.camera.cx, read.name) == (330.0, "cam1")
    with pytest.raises(CalibrationError, match="cam7: not in the file, which holds cam0, cam1"):
        read_foreign(path, Asked(camera="cam7"))
    with pytest.raises(CalibrationError, match="holds one camera, sky"):
        read_foreign(dumped(tmp_path, MEI), Asked(camera="cam1"))


def test_cameras_in_sections_are_chosen_by_name_and_share_what_stands_above_them(tmp_path):
    one = {"camera_matrix": K, "D": BENT, "distortion_model": "fisheye"}
    other = {"camera_matrix": {"rows": 3, "cols": 3, "data": FLAT_K}, "D": {"rows": 1, "cols": 5, "data": BROWN}}
    path = dumped(tmp_path, {**SIZE, "sky": one, "door": other, "R": np.eye(3).tolist(), "T": [0.1, 0.0, 0.0]})
    with pytest.raises(CalibrationError, match=r"holds 2 cameras \(sky, door\)"):
        read_foreign(path)
    directions = rays(60.0)
    pixels = by_opencv(cv2.fisheye.projectPoints, directions, BENT)
    assert same_rays(read_foreign(path, Asked(camera="sky")).camera, pixels, directions)
    directions = rays(35.0)
    pixels = by_opencv(cv2.projectPoints, directions, BROWN)
    assert same_rays(read_foreign(path, Asked(camera="door")).camera, pixels, directions)


def test_what_opencv_s_interactive_calibration_writes_is_read(tmp_path):
    path = tmp_path / "cameraParameters.xml"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (
        ("calibrationDate", "Tue Mar  3 10:11:12 2026"),
        ("framesCount", 31),
        ("cameraMatrix", np.array(K)),
        ("cameraMatrix_std_dev", np.full((4, 1), 0.3)),
        ("dist_coeffs", np.array([BROWN])),
        ("dist_coeffs_std_dev", np.full((5, 1), 0.01)),
        ("avg_reprojection_error", 0.21),
    ):
        file.write(name, value)
    file.startWriteStruct("cameraResolution", cv2.FileNode_SEQ)  # a cv::Size
    for side in (640, 480):
        file.write("", side)
    file.endWriteStruct()
    file.release()
    directions = rays(35.0)
    assert same_rays(read_foreign(path).camera, by_opencv(cv2.projectPoints, directions, BROWN), directions)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"MATLAB 5.0 MAT-file", "MATLAB"),
        (b"PK\x03\x04abc", "archive"),
        (b"\x80\x04\x95", "pickle"),
        (b"\xff\xd8\xff\xe0", "a picture"),
        (b"a: [1", "line 1"),
        (b"; of a camera\n[LEFT_CAM_HD]\nfx=500\nfy=500\n", "an .ini"),
        (b"Camera-system parameters:\ncam0 (/front):\n    projection: [1 2 3 4] +- [1 1 1 1]\n", "report of Kalibr"),
        (b"- 1\n- 2\n", "a list"),
        (b"", "nothing"),
        (b"k: 1\nk: 2\n", "given twice"),
        (b'{"k": 1, "k": 2}', "given twice"),
        (b"k: !!python/tuple [1]", "objects of Python"),
        (b"<calibration><f>1</f></calibration>", "<calibration> instead of <opencv_storage>"),
        (b"<!DOCTYPE a [<!ENTITY b 'c'>]><opencv_storage>&b;</opencv_storage>", "declarations"),
        (b"<opencv_storage><k>1</k>", "not XML"),
        (b"\xfe\xff\x00", "cannot be read"),
    ],
)
def test_what_is_no_calibration_is_told_what_it_is(tmp_path, data, words):
    path = tmp_path / "camera.yaml"
    path.write_bytes(data)
    with pytest.raises(CalibrationError, match=words) as told:
        read_foreign(path)
    assert "Error" not in str(told.value)
    assert "\n" not in str(told.value)


def test_messages_of_an_echo_are_one_calibration_and_two_cameras_are_two(tmp_path):
    path, one = tmp_path / "echo.yaml", json.dumps(FLAT)
    path.write_text(f"{one}\n---\n".replace("{", "", 1).replace("}\n", "\n").replace(', "', '\n"'))
    assert read_foreign(path).camera.cx == 322.25
    path.write_text(path.read_text() * 2)
    assert read_foreign(path).camera.cx == 322.25
    path.write_text(path.read_text() + path.read_text().replace("322.25", "300.0"))
    with pytest.raises(CalibrationError, match="different documents"):
        read_foreign(path)
