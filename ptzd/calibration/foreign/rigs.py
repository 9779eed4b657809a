"""Files of reconstruction and odometry: Basalt, nerfstudio, ORB-SLAM; and those of RealSense and MATLAB."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ptzd.calibration.foreign.chains import from_alpha
from ptzd.calibration.foreign.described import Described, chosen
from ptzd.calibration.foreign.fields import Fields
from ptzd.calibration.foreign.matrices import image_size, named_model, pair_of, pinhole
from ptzd.errors import CalibrationError

CORNER_PX = 0.5
"""Where (0, 0) is the corner of the picture, the centre of its first pixel is at (0.5, 0.5): COLMAP and nerfstudio."""
_ORB = re.compile(r"(Camera\d?)\.fx")
_PINHOLE = ("fx", "fy", "cx", "cy")
_BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
_FISHEYE = ("k1", "k2", "k3", "k4")


_BASALT = ("kb4", "pinhole_radtan8", "ucm", "eucm", "pinhole")


def basalt(values: Mapping[str, Any], camera: str | None) -> tuple[str | None, Described]:
    """Name and lens of a calibration.json of Basalt, whose cameras are cam0, cam1 and so on.

    Raises
    ------
    CalibrationError
        When the camera's model has no counterpart here.
    """
    top = Fields({str(key): value for key, value in values["value0"].items()}, "value0")
    (path, listed), (_, sizes) = top.take("intrinsics"), top.take("resolution")
    if not (isinstance(listed, list) and isinstance(sizes, list) and len(listed) == len(sizes)):
        raise CalibrationError(f"{path}: not as many cameras as there are in value0.resolution")
    name = chosen([f"cam{index}" for index in range(len(listed))], camera)
    index = int(name[3:])
    if not isinstance(listed[index], dict):
        raise CalibrationError(f"{path}[{index}]: no camera")
    entry = Fields(listed[index], f"{path}[{index}]")
    kind = entry.text("camera_type")
    if kind not in _BASALT:
        raise CalibrationError(f"{path}[{index}]: camera_type {kind} has no counterpart here; calibrate with kb4")
    numbers = entry.section("intrinsics")
    fx, fy, cx, cy = (numbers.number(key) for key in _PINHOLE)
    model, xi = "perspective", 0.0
    extra: tuple[float, ...] = (0.0,) * 4
    if kind == "kb4":
        model, extra = "kannala_brandt", tuple(numbers.number(key) for key in _FISHEYE)
    elif kind == "pinhole_radtan8":
        extra = tuple(numbers.number(key) for key in _BROWN)
        numbers.find("rpmax")  # where the polynomial folds, which is found here from the polynomial
    elif kind == "ucm" or (kind == "eucm" and numbers.number("beta") == 1.0):
        model, (xi, fx, fy) = "unified", from_alpha(numbers.number("alpha"), fx, fy)
    elif kind != "pinhole":
        raise CalibrationError(f"{path}[{index}]: camera_type {kind} has no counterpart here; calibrate with kb4")
    entry.finish()
    return name, Described(
        source="Basalt",
        model=model,
        size_px=pair_of(sizes[index], "value0.resolution"),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        xi=xi,
        coefficients=extra,
    )


def nerfstudio(fields: Fields) -> Described:
    """Return the lens of a transforms.json; CalibrationError when every picture has its own."""
    _, frames = fields.find("frames") or ("", None)
    for frame in frames if isinstance(frames, list) else []:
        own = [key for key in ("fl_x", "camera_model", "k1") if isinstance(frame, dict) and key in frame]
        if own:
            raise CalibrationError(
                f"frames: every picture has its own {own[0]}; keep one camera, at the top of the file"
            )
    size_px, fx = image_size(fields), fields.number("fl_x")
    fy, cx, cy = fields.number("fl_y", default=fx), fields.number("cx"), fields.number("cy")
    if fields.find("camera_model") is not None:
        model = named_model(fields.text("camera_model"), "camera_model")
    elif fields.values.get("is_fisheye") is True:
        model = "kannala_brandt"
    else:
        raise CalibrationError("camera_model: missing; write OPENCV or OPENCV_FISHEYE, whichever the numbers are of")
    extra = coefficients(fields, _FISHEYE if model == "kannala_brandt" else _BROWN[:5], model)
    # the angle once more, and how the scene is placed
    for key in ("camera_angle_x", "camera_angle_y", "fps", "aabb_scale", "scale", "offset", "is_fisheye"):
        fields.find(key)
    return Described(
        source="nerfstudio",
        model=model,
        size_px=size_px,
        fx=fx,
        fy=fy,
        cx=cx - CORNER_PX,
        cy=cy - CORNER_PX,
        coefficients=extra,
    )


def coefficients(fields: Fields, order: tuple[str, ...], model: str) -> tuple[float, ...]:
    """Coefficients by name, 0 where not given; CalibrationError for one that is given and not of the model."""
    for key in (*_BROWN, "k7", "k8"):
        if key not in order and fields.number(key, default=0.0) != 0.0:
            raise CalibrationError(f"{fields.name(key)}: {fields.values[key]}, which {model} has not")
    return tuple(fields.number(key, default=0.0) for key in order)


def realsense(fields: Fields) -> Described:
    """Return the lens of intrinsics as librealsense names them; its inverse models have no counterpart."""
    kind = re.sub(r"^(rs2_)?distortion[._]", "", fields.text("model", "distortion_model"))
    if "coeffs" not in fields and kind not in ("none", "brown_conrady", "kannala_brandt4"):
        raise CalibrationError(f"model: {kind} has no counterpart here; calibrate with OpenCV instead")
    extra = fields.numbers("coeffs")
    if kind == "none" or not any(extra):
        model = "perspective"
    elif kind in ("brown_conrady", "kannala_brandt4"):
        model = named_model(kind, "model")
    else:
        raise CalibrationError(f"model: {kind} has no counterpart here; calibrate with OpenCV instead")
    fx, fy, cx, cy = (fields.number(key) for key in ("fx", "fy", "ppx", "ppy"))
    size_px = image_size(fields)
    return Described(source="RealSense", model=model, size_px=size_px, fx=fx, fy=fy, cx=cx, cy=cy, coefficients=extra)


def matlab(fields: Fields) -> Described:
    """Return the lens of ``jsonencode(toStruct(params))``: pixels count from 1, IntrinsicMatrix is transposed."""
    path, value = fields.take("ImageSize")
    height, width = pair_of(value, path)
    found = fields.find("K")
    if found is not None:
        fx, fy, cx, cy, skew = pinhole(found[1], found[0])
    else:
        columns = fields.numbers("IntrinsicMatrix")
        rows = [list(columns[start::3]) for start in range(3)]
        fx, fy, cx, cy, skew = pinhole(rows, "IntrinsicMatrix, transposed as MATLAB writes it")
    radial, tangential = fields.numbers("RadialDistortion"), fields.numbers("TangentialDistortion")
    if len(radial) not in (2, 3) or len(tangential) != 2:
        raise CalibrationError("RadialDistortion has 2 or 3 numbers, TangentialDistortion 2")
    for key in list(fields.values):
        if key not in ("RadialDistortion", "TangentialDistortion"):
            fields.find(key)  # the same numbers once more, the board, and how well it fits
    return Described(
        source="MATLAB",
        model="perspective",
        size_px=(width, height),
        fx=fx,
        fy=fy,
        cx=cx - 1.0,
        cy=cy - 1.0,
        skew=skew,
        coefficients=(*radial[:2], *tangential, *radial[2:]),
    )


def orb(values: Mapping[str, Any], camera: str | None) -> tuple[str | None, Described] | None:
    """Name and lens of a settings file of ORB-SLAM; None when it is none."""
    names = [found[1] for found in map(_ORB.fullmatch, values) if found]
    if not names:
        return None
    name = chosen(names, camera)
    fields, every = _prefixed(values, f"{name}."), _prefixed(values, "Camera.")
    kind = every.find("type")
    if kind is None and "p1" not in fields:
        raise CalibrationError("Camera.type: missing; write PinHole or KannalaBrandt8")
    word = "PinHole" if kind is None else str(kind[1])
    if word not in ("PinHole", "KannalaBrandt8"):
        raise CalibrationError(f"Camera.type: {word} has no counterpart here; calibrate with KannalaBrandt8")
    fisheye = word == "KannalaBrandt8"
    fx, fy, cx, cy = (fields.number(key) for key in _PINHOLE)
    return (name if len(names) > 1 else None), Described(
        source="ORB-SLAM",
        model="kannala_brandt" if fisheye else "perspective",
        size_px=image_size(every),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        coefficients=coefficients(fields, _FISHEYE if fisheye else _BROWN[:5], word),
    )


def _prefixed(values: Mapping[str, Any], prefix: str) -> Fields:
    """The values whose names start so."""
    inside = {key.removeprefix(prefix): value for key, value in values.items() if key.startswith(prefix)}
    return Fields(inside, prefix.rstrip("."))
