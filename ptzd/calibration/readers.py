"""Calibrations of other tools: every number is used, or the file is refused by the name of what is not."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ptzd.calibration.foreign import chains, matrices
from ptzd.calibration.foreign.described import Asked, Described, camera_of
from ptzd.calibration.foreign.fields import Fields
from ptzd.calibration.foreign.text import plain_values, read_source
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.types import CameraModel

_CAMERA = re.compile(r"cam(era)?_?\d+")
_PAIR = re.compile(r"(?i)(camera_?matrix|k|m|mtx|camera_matrix|intrinsics?)_?(0|1|2|l|r|left|right)")


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
        EuRoC's sensor.yaml, camodocal's (VINS, KITTI-360), VOXL's.
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
    values = plain_values(read_source(path))
    several = {key: value for key, value in values.items() if _CAMERA.fullmatch(key) and isinstance(value, dict)}
    if several:
        name = _chosen(list(several), camera)
        one = Fields(several[name], name)
        described = chains.intrinsics(one)
        one.finish()
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


def _reader(values: Mapping[str, Any]) -> Callable[[Fields], Described]:
    """Whose file it is, by the names in it."""
    if "ptzd_calibration" in values or "ptzd_part" in values:
        raise CalibrationError("is a calibration of ptzd already; use it as it is")
    if "model_type" in values:
        return chains.camodocal
    if "intrinsics" in values and "camera_model" in values:
        return chains.intrinsics
    if any(key in values for key in matrices.MATRIX):
        return matrices.described
    pair = next((key for key in values if _PAIR.fullmatch(key)), None)
    if pair is not None:
        raise CalibrationError(
            f"{pair}: of a pair of cameras; copy the fisheye's matrix, coefficients and size into a file of their own, "
            "as camera_matrix, distortion_coefficients, image_width and image_height"
        )
    raise CalibrationError(
        "not a calibration that is known here: none of camera_matrix, K (OpenCV, ROS), cam0, intrinsics (Kalibr, "
        "EuRoC), model_type (camodocal) is in it"
    )


def _chosen(names: list[str], camera: str | None) -> str:
    listed = ", ".join(names)
    if camera is None:
        if len(names) > 1:
            raise CalibrationError(f"holds {len(names)} cameras ({listed}); name the fisheye's with --camera")
        return names[0]
    if camera not in names:
        raise CalibrationError(f"--camera {camera}: not in the file, which holds {listed}")
    return camera
