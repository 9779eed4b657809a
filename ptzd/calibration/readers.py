"""Calibrations of other tools: every number is used, or the file is refused by the name of what is not."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ptzd.calibration.foreign import chains, matrices, rigs, tables
from ptzd.calibration.foreign.described import COPY, Asked, Described, camera_of, chosen
from ptzd.calibration.foreign.fields import Fields
from ptzd.calibration.foreign.text import plain_values, read_source
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.types import CameraModel

_CAMERA = re.compile(r"cam(era)?_?\d+")
_REFUSED = (
    (("ptzd_calibration", "ptzd_part"), "is a calibration of ptzd already; use it as it is"),
    (
        ("MappingCoefficients", "mapping_coefficients"),
        "a fisheye of MATLAB, whose polynomial has no counterpart here; calibrate the same pictures with "
        "`ptzd calibrate fisheye PICTURES`, or with estimateCameraParametersKB or OpenCV",
    ),
    (
        ("cameras", "Calibration", "sensors", "CalibrationInformation", "cameraData", "sfm_data_version", "views"),
        f"a list of cameras in a form that is not read here (maplab, OpenMVG, Meshroom, calib.io, DepthAI …); {COPY}",
    ),
    (("cam0_calib",), "the settings of VINS-Fusion; give the file that cam0_calib or cam1_calib in it names"),
    (("fisheye_params",), f"a lens profile of Gyroflow, which is not read here; {COPY}"),
)
_READERS: tuple[tuple[str, Callable[[Fields], Described]], ...] = (
    ("model_type", chains.camodocal),
    ("RadialDistortion", rigs.matlab),
    ("ppx", rigs.realsense),
    ("fl_x", rigs.nerfstudio),
    ("intrinsics", chains.intrinsics),
)
_PAIR = re.compile(r"(?i)(camera_?matrix|k|m|mtx|camera_matrix|intrinsics?)_?(\d+|l|r|left|right)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Foreign:
    """A camera of another tool's file."""

    camera: CameraModel
    source: str
    """Whose file it is, for people."""
    name: str | None
    """Of the camera in a file of several."""


def read_foreign(path: Path, asked: Asked = Asked()) -> Foreign:  # noqa: B008  # frozen
    """Return the camera of another tool's file.

    Parameters
    ----------
    path : Path
        YAML, JSON or XML of OpenCV (also with xi), a camera_info of ROS (file, `ros2 topic echo`), Kalibr's camchain,
        EuRoC's sensor.yaml, camodocal's (VINS, KITTI-360), VOXL's, Basalt's, ORB-SLAM's, nerfstudio's, RealSense's,
        MATLAB's toStruct; COLMAP's cameras.txt, mrcal's .cameramodel and Bouguet's Calib_Results.m.
    asked : Asked
        The model, the size and the camera where the file leaves them open, and the edge of the image circle.

    Raises
    ------
    CalibrationError
        ``<file>: <what is wrong>``: it is none of these, it holds what no model here has, it leaves something open, or
        it cannot be true.
    """
    try:
        name, lens = _lens(path, asked.camera)
        return Foreign(camera=camera_of(lens, asked), source=lens.source, name=name)
    except (CalibrationError, GeometryError) as error:
        raise CalibrationError(f"{path}: {error}") from error


def _lens(path: Path, camera: str | None) -> tuple[str | None, Described]:
    """Name and lens of the camera that is meant."""
    text = read_source(path)
    found = tables.table(text, camera)
    if found is not None:
        return found
    values = plain_values(text)
    if isinstance(values.get("value0"), dict):
        return rigs.basalt(values, camera)
    found = rigs.orb(values, camera)
    if found is not None:
        return found
    for names, words in _REFUSED:
        if any(key in values for key in names):
            raise CalibrationError(words)
    several = _sections(values)
    if several:
        name = chosen(list(several), camera)
        shared = {key: value for key, value in values.items() if key not in several}
        fields = Fields({**shared, **several[name]}, name)
        described = (matrices.described if _has_matrix(several[name]) else chains.intrinsics)(fields)
        fields.finish()
        return name, described
    fields = Fields(values)
    own = fields.find("camera_name", "name")
    if camera is not None and (own is None or own[1] != camera):
        raise CalibrationError(
            f"--camera {camera}: holds one camera{'' if own is None else f', {own[1]}'}; leave it away"
        )
    described = _reader(values)(fields)
    fields.finish()
    return None, described


def _sections(values: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The cameras of a file that has a section for each."""
    if _has_matrix(values):
        return {}
    sections = {key: value for key, value in values.items() if isinstance(value, dict)}
    return {key: value for key, value in sections.items() if _CAMERA.fullmatch(key) or _has_matrix(value)}


def _has_matrix(values: Mapping[str, Any]) -> bool:
    return any(key in values for key in matrices.MATRIX)


def _reader(values: Mapping[str, Any]) -> Callable[[Fields], Described]:
    """Whose file it is, by the names in it."""
    for name, reader in _READERS:
        if name in values:
            return reader
    if _has_matrix(values):
        return matrices.described
    pair = next(
        (key for key, value in values.items() if _PAIR.fullmatch(key) and isinstance(value, list | dict | str)), None
    )
    if pair is not None:
        raise CalibrationError(
            f"{pair}: of a pair of cameras; copy the fisheye's matrix, coefficients and size into a file of their own, "
            "as camera_matrix, distortion_coefficients, image_width and image_height"
        )
    raise CalibrationError(
        "not a calibration that is known here: none of camera_matrix, K (OpenCV, ROS), cam0, intrinsics (Kalibr, "
        f"EuRoC), model_type (camodocal) is in it; {COPY}"
    )
