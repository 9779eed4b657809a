"""Files around a camera matrix: OpenCV's own, camera_info of ROS (file and echo), VOXL."""

from __future__ import annotations

from typing import Any

from ptzd.calibration.foreign.described import Described
from ptzd.calibration.foreign.fields import Fields, matrix, number
from ptzd.errors import CalibrationError

MATRIX = ("camera_matrix", "K", "k", "M", "cameraMatrix", "camera_mtx", "intrinsic_matrix", "mtx", "Camera_Matrix")
COEFFICIENTS = (
    *("distortion_coefficients", "D", "d", "distCoeffs", "dist_coeffs", "dist_coeff", "dist", "distortion"),
    *("distortion_coeffs", "Distortion_Coefficients"),
)
_MODELS = {
    **dict.fromkeys(("plumb_bob", "rational_polynomial", "radtan", "radial_tangential", "pinhole"), "perspective"),
    **dict.fromkeys(("perspective", "brown_conrady", "opencv"), "perspective"),
    **dict.fromkeys(("equidistant", "fisheye", "equi", "kannala_brandt", "kannala_brandt4"), "kannala_brandt"),
    **dict.fromkeys(("kb4", "opencv_fisheye"), "kannala_brandt"),
    **dict.fromkeys(("omni", "omnidir", "mei", "unified"), "unified"),
}


def described(fields: Fields) -> Described:
    """Return the lens of a file with a camera matrix and its coefficients.

    Raises
    ------
    CalibrationError
        When values are missing or contradict each other.
    """
    path, value = fields.take(*MATRIX)
    fx, fy, cx, cy, skew = pinhole(value, path)
    found = fields.find(*COEFFICIENTS)
    if found is None:
        raise CalibrationError(f"distortion coefficients: missing; expected one of {', '.join(COEFFICIENTS[:4])}")
    coefficients = matrix(found[1], found[0])[2]
    ros = "distortion_model" in fields and "M" not in fields
    xi = fields.number("xi") if "xi" in fields else None
    model = _stated(fields, xi)
    if model is None and len(coefficients) > 4:
        model = "perspective"  # the other models have four
    _check_region(fields)
    return Described(
        source="camera_info of ROS" if ros else "OpenCV",
        model=model,
        size_px=image_size(fields),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        skew=skew,
        xi=xi or 0.0,
        coefficients=coefficients,
    )


def pinhole(value: object, path: str) -> tuple[float, float, float, float, float]:
    """fx, fy, cx, cy and skew of a camera matrix, which must be one."""
    rows, columns, data = matrix(value, path)
    if (rows, columns) not in ((3, 3), (1, 9)):
        raise CalibrationError(f"{path}: {rows}×{columns} numbers instead of the 3×3 of a camera matrix")
    if not any(data):
        raise CalibrationError(f"{path}: all zero; the driver that wrote it has no calibration")
    fx, skew, cx, low, fy, cy, left, below, one = data
    if (cx, cy) == (0.0, 0.0) and one == 1.0 and left > 0.0 and below > 0.0:
        raise CalibrationError(f"{path}: transposed, with the principal point in the last row; write it row by row")
    if low != 0.0 or (left, below, one) != (0.0, 0.0, 1.0):
        raise CalibrationError(f"{path}: {list(data)} is no camera matrix [fx, s, cx, 0, fy, cy, 0, 0, 1]")
    return fx, fy, cx, cy, skew


def image_size(fields: Fields) -> tuple[int, int] | None:
    """Width and height, however they are called; None when they are not given."""
    pair = fields.find("image_size", "imageSize", "img_size", "resolution", "cameraResolution")
    width = fields.find("image_width", "width", "img_width", "imageWidth", "w")
    height = fields.find("image_height", "height", "img_height", "imageHeight", "h")
    if (width is None) != (height is None):
        raise CalibrationError("only one of image_width and image_height is given")
    if width is None or height is None:
        return None if pair is None else pair_of(pair[1], pair[0])
    if pair is not None:
        raise CalibrationError(f"{pair[0]} and {width[0]} are both given; keep the one that is meant")
    return side(width[1], width[0]), side(height[1], height[0])


def pair_of(value: object, path: str) -> tuple[int, int]:
    """Width and height of a list of two."""
    if isinstance(value, dict):
        value = list(matrix(value, path)[2])
    if not isinstance(value, list) or len(value) != 2:
        raise CalibrationError(f"{path}: {value!r} instead of width and height")
    return side(value[0], path), side(value[1], path)


def side(value: object, path: str) -> int:
    """A number of pixels."""
    count = number(value, path)
    if count != int(count) or count <= 0:
        raise CalibrationError(f"{path}: {count:g} is no number of pixels")
    return int(count)


def named_model(word: str, path: str) -> str:
    """The model here of another tool's name for it."""
    if word not in _MODELS:
        known = "plumb_bob, equidistant, fisheye or omni"
        raise CalibrationError(f"{path}: {word!r} has no counterpart here; calibrate with {known}")
    return _MODELS[word]


def _stated(fields: Fields, xi: float | None) -> str | None:
    """The model that the file states, in whichever way; statements must agree."""
    stated: dict[str, str] = {}
    for key in ("distortion_model", "model", "camera_model", "lens_model", "distortion_type"):
        if fields.values.get(key):
            stated[key] = named_model(fields.text(key), fields.name(key))
    for key in ("fisheye_model", "fisheye", "use_fisheye", "is_fisheye"):
        found = fields.find(key)
        if found is not None:
            stated[key] = "kannala_brandt" if _flag(found[1], found[0]) else "perspective"
    if xi is not None:
        # whose distortion is called radtan or plumb_bob
        stated = {key: "unified" if model == "perspective" else model for key, model in stated.items()}
        stated["xi"] = "unified"
    if len(set(stated.values())) > 1:
        told = ", ".join(f"{key} says {model}" for key, model in stated.items())
        raise CalibrationError(f"contradicts itself: {told}")
    model = next(iter(stated.values()), None)
    if model == "unified" and xi is None:
        raise CalibrationError("xi: missing; a unified lens has one")
    return model


def _flag(value: Any, path: str) -> bool:  # noqa: ANN401  # as parsed
    if value in (0, 1):
        return bool(value)
    if isinstance(value, str) and value.lower() in ("true", "false"):
        return value.lower() == "true"
    raise CalibrationError(f"{path}: {value!r} must be 0 or 1")


def _check_region(fields: Fields) -> None:
    """Refuse a camera_info whose picture is a part of the calibrated one, or binned."""
    for key in ("binning_x", "binning_y"):
        if fields.number(key, default=0.0) > 1.0:
            raise CalibrationError(f"{key}: the pictures are smaller than the calibration; calibrate them as they are")
    if isinstance(fields.values.get("roi"), dict):
        region = fields.section("roi")
        for key in ("x_offset", "y_offset", "width", "height"):
            full = {"width": ("image_width", "width"), "height": ("image_height", "height")}.get(key, ())
            sides = [fields.values[name] for name in full if name in fields]
            if region.number(key, default=0.0) not in (0.0, *sides):
                raise CalibrationError(f"roi.{key}: the pictures are a part of the calibration's; calibrate the part")
        region.find("do_rectify")
