"""Calibrations of other tools: OpenCV's YAML, Kalibr's camchain, ROS' camera_info."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import CameraModel
from ptzd.geometry.unified import UnifiedCamera

DEFAULT_MAX_ANGLE_DEG = 90.0
"""Those files do not say where the image circle ends."""


def read_foreign(path: Path, max_angle_deg: float = DEFAULT_MAX_ANGLE_DEG) -> CameraModel:
    """Return the camera of a file of OpenCV, Kalibr (the first camera) or ROS.

    Parameters
    ----------
    path : Path
        YAML.
    max_angle_deg : float
        Edge of the image circle off the axis; the model's own limit holds where it is less.

    Raises
    ------
    CalibrationError
        When it is none of these, or of a model that has no counterpart here.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: cannot be read: {error}") from None
    text = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE).replace("!!opencv-matrix", "")
    try:
        document = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise CalibrationError(f"{path}: not YAML: {' '.join(str(error).split())}") from None
    if not isinstance(document, dict):
        raise CalibrationError(f"{path}: no mapping; expected a calibration of OpenCV, Kalibr or ROS")
    limit = math.radians(max_angle_deg)
    try:
        if "cam0" in document:
            return _kalibr(document["cam0"], limit)
        if "distortion_model" in document:
            return _ros(document, limit)
        if "camera_matrix" in document or "K" in document:
            return _opencv(document, limit)
    except (KeyError, TypeError, ValueError, GeometryError) as error:
        raise CalibrationError(f"{path}: {type(error).__name__}: {error}") from error
    except CalibrationError as error:
        raise CalibrationError(f"{path}: {error}") from error
    raise CalibrationError(f"{path}: neither cam0 (Kalibr), distortion_model (ROS) nor camera_matrix (OpenCV) in it")


def _kalibr(camera: Mapping[str, Any], limit: float) -> CameraModel:
    model, bent = camera["camera_model"], camera["distortion_model"]
    numbers = [float(value) for value in camera["intrinsics"]]
    extra = [float(value) for value in camera["distortion_coeffs"]]
    size = (int(camera["resolution"][0]), int(camera["resolution"][1]))
    if model == "omni" and bent in ("radtan", "none"):
        return _unified(size, numbers[1:], numbers[0], extra or [0.0] * 4, limit)
    if model == "pinhole" and bent in ("radtan", "none"):
        return _perspective(size, numbers, extra or [0.0] * 4)
    if model == "pinhole" and bent == "equidistant":
        return _kannala_brandt(size, numbers, extra, limit)
    raise CalibrationError(f"{model} with {bent} has no counterpart; calibrate with omni-radtan or pinhole-equi")


def _ros(document: Mapping[str, Any], limit: float) -> CameraModel:
    matrix, extra = _matrix(document["camera_matrix"]), _matrix(document["distortion_coefficients"])
    size = (int(document["image_width"]), int(document["image_height"]))
    numbers = [matrix[0], matrix[4], matrix[2], matrix[5]]
    model = document["distortion_model"]
    if model in ("equidistant", "fisheye"):
        return _kannala_brandt(size, numbers, extra, limit)
    if model == "plumb_bob" or (model == "rational_polynomial" and not any(extra[5:])):
        return _perspective(size, numbers, extra)
    raise CalibrationError(f"distortion_model {model} has no counterpart; use plumb_bob or equidistant")


def _opencv(document: Mapping[str, Any], limit: float) -> CameraModel:
    matrix = _matrix(document.get("camera_matrix", document.get("K")))
    extra = _matrix(document.get("distortion_coefficients", document.get("D")))
    width, height = document.get("image_width"), document.get("image_height")
    if width is None or height is None:
        raise CalibrationError("image_width and image_height are missing; add them, in px")
    size, numbers = (int(width), int(height)), [matrix[0], matrix[4], matrix[2], matrix[5]]
    if "xi" in document:
        xi = document["xi"]
        return _unified(size, numbers, _matrix(xi)[0] if isinstance(xi, dict) else float(xi), extra, limit)
    if document.get("fisheye") or document.get("model") == "fisheye":
        return _kannala_brandt(size, numbers, extra, limit)
    if any(extra[5:]):
        raise CalibrationError("more than five distortion coefficients; calibrate without the rational model")
    return _perspective(size, numbers, extra)


def _matrix(value: Any) -> list[float]:  # noqa: ANN401 - as YAML gives it
    data = value["data"] if isinstance(value, dict) else value
    rows = [row if isinstance(row, list) else [row] for row in data]
    return [float(number) for row in rows for number in row]


def _four(values: list[float]) -> tuple[float, float, float, float]:
    a, b, c, d = (*values, 0.0, 0.0, 0.0, 0.0)[:4]
    return a, b, c, d


def _unified(size: tuple[int, int], numbers: list[float], xi: float, extra: list[float], limit: float) -> CameraModel:
    fx, fy, cx, cy = numbers[:4]
    camera = UnifiedCamera(
        size_px=size, fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, distortion=_four(extra), max_angle_rad=limit
    )
    return _to_limit(camera, limit)


def _kannala_brandt(size: tuple[int, int], numbers: list[float], extra: list[float], limit: float) -> CameraModel:
    fx, fy, cx, cy = numbers[:4]
    camera = KannalaBrandtCamera(size_px=size, fx=fx, fy=fy, cx=cx, cy=cy, distortion=_four(extra), max_angle_rad=limit)
    return _to_limit(camera, limit)


def _to_limit(camera: UnifiedCamera | KannalaBrandtCamera, limit: float) -> CameraModel:
    """The camera with a largest angle that the model reaches."""
    if camera.limit_rad >= limit:
        return camera
    values = {name: getattr(camera, name) for name in ("size_px", "fx", "fy", "cx", "cy", "distortion")}
    reached = camera.limit_rad - 1e-6
    if isinstance(camera, UnifiedCamera):
        return UnifiedCamera(**values, xi=camera.xi, max_angle_rad=reached)
    return KannalaBrandtCamera(**values, max_angle_rad=reached)


def _perspective(size: tuple[int, int], numbers: list[float], extra: list[float]) -> CameraModel:
    fx, fy, cx, cy = numbers[:4]
    k1, k2, p1, p2, k3 = (*extra, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]
    return PerspectiveCamera(size_px=size, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3))
