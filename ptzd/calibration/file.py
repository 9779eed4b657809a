"""The calibration file rig.yaml: read strictly, and written so that it reads back the same."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import yaml

from ptzd.calibration.document import (
    VERSION,
    Document,
    FisheyePart,
    HeadPart,
    KannalaBrandtPart,
    PtzPart,
    UncertaintyPart,
    UnifiedPart,
    check_document,
    check_fisheye,
    require,
)
from ptzd.documents import DocumentError, parse_yaml, read_text
from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.types import Array, CameraModel
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable

_DECIMALS = 10
"""Of an angle in deg where no shorter number reads back the same: 2e-12 rad, below a millionth of a pixel."""


def load_rig(path: Path | str) -> Rig:
    """Return the rig of a file; `read_rig` tells what is refused.

    Raises
    ------
    CalibrationError
        Also when the file cannot be read.
    """
    return read_rig(_text(Path(path)), str(path))


def read_rig(text: str, name: str) -> Rig:
    """Return the rig of the text of a rig.yaml.

    Parameters
    ----------
    text : str
        YAML as in the example ``config/rig.example.yaml``.
    name : str
        What messages call the file.

    Raises
    ------
    CalibrationError
        ``<name>: <path of the culprit>: <what is wrong>`` for anything missing, unknown, of another type, not finite,
        or that cannot be true of a real rig.
    """
    with _prefixed(name):
        return _rig(_document(text))


def load_provenance(path: Path | str) -> dict[str, Any]:
    """Return the provenance of a file: whatever the calibration wrote about dates, methods and residuals."""
    with _prefixed(str(path)):
        return _document(_text(Path(path))).provenance


def dump_rig(rig: Rig, provenance: Mapping[str, object]) -> str:
    """Return the text of a rig.yaml.

    Angles are written as the shortest number of degrees that reads back to the same bits, with at most 10 decimals:
    a rig that was read from such a file is written and read again without change.

    Raises
    ------
    CalibrationError
        When the fisheye is of a model that the file has no name for, or the provenance holds more than plain values.
    """
    document: dict[str, object] = {
        "ptzd_calibration": VERSION,
        "fisheye": _fisheye_part(rig.fisheye),
        "ptz": {
            "size_px": list(rig.zoom.size_px),
            "zoom": [{"zoom": float(entry.zoom), **_pinhole(entry)} for entry in rig.zoom.entries],
        },
        "head": {
            "pan": _axis_part(rig.head.pan),
            "tilt": _axis_part(rig.head.tilt),
            "camera_rotvec_deg": [_degrees(angle) for angle in rig.head.camera_rotvec_rad],
        },
        "rig": {
            "rotvec_deg": _rotvec_degrees(rig.head_from_fisheye_rotation),
            "translation_m": rig.head_from_fisheye_translation.tolist(),
            "metric": rig.metric,
        },
    }
    if rig.uncertainty is not None:
        document["uncertainty"] = {
            "rotation_deg": _degrees(rig.uncertainty.rotation_rad),
            "translation_m": float(rig.uncertainty.translation),
            "head_deg": _degrees(rig.uncertainty.head_rad),
        }
    document["provenance"] = dict(provenance)
    try:
        return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)
    except yaml.representer.RepresenterError as error:
        raise CalibrationError(f"provenance: only plain values can be written; {error}") from error


def fisheye_section(camera: CameraModel) -> dict[str, object]:
    """Return the section ``fisheye`` of a file for a camera."""
    return _fisheye_part(camera)


def read_fisheye_section(section: object, name: str) -> CameraModel:
    """Return the camera of a section ``fisheye``.

    Raises
    ------
    CalibrationError
        As `read_rig`.
    """
    with _prefixed(name):
        try:
            part = msgspec.convert(section, FisheyePart)
        except msgspec.ValidationError as error:
            raise CalibrationError(_explain(str(error))) from error
        check_fisheye(part)
        return _fisheye(part)


@contextmanager
def _prefixed(path: str) -> Iterator[None]:
    """Put a path before the message of any refusal inside."""
    try:
        yield
    except (CalibrationError, GeometryError) as error:
        raise CalibrationError(f"{path}: {error}") from error


def _text(path: Path) -> str:
    try:
        return read_text(path)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be read: {error.strerror}") from error
    except DocumentError as error:
        raise CalibrationError(f"{path}: {error}") from None


def _document(text: str) -> Document:
    """Return the checked document; messages start with the path inside the file."""
    try:
        data = parse_yaml(text)
    except DocumentError as error:
        raise CalibrationError(str(error)) from None
    version = data.get("ptzd_calibration") if isinstance(data, dict) else None
    message = f"{version!r} instead of {VERSION}: not a calibration of this program's version"
    require(type(version) is int and version == VERSION, "ptzd_calibration", message)
    try:
        document = msgspec.convert(data, Document)
    except msgspec.ValidationError as error:
        raise CalibrationError(_explain(str(error))) from error
    check_document(document)
    return document


def _explain(message: str) -> str:
    """Return a message of msgspec with the path of the culprit first."""
    what, _, where = message.partition(" - at ")
    path = where.strip("`").removeprefix("$").removeprefix(".")
    culprit = re.fullmatch(r"Object (missing required|contains unknown) field `(.*)`", what)
    if culprit is None:
        return f"{path or 'file'}: {what[0].lower()}{what[1:]}"
    path = f"{path}.{culprit[2]}" if path else culprit[2]
    return f"{path}: {'missing' if culprit[1].startswith('missing') else 'unknown key'}"


def _rig(document: Document) -> Rig:
    return Rig(
        fisheye=_fisheye(document.fisheye),
        zoom=_zoom(document.ptz),
        head=_head(document.head),
        head_from_fisheye_rotation=_rotation(document.rig.rotvec_deg),
        head_from_fisheye_translation=np.array(document.rig.translation_m),
        metric=document.rig.metric,
        uncertainty=None if document.uncertainty is None else _uncertainty(document.uncertainty),
    )


def _uncertainty(part: UncertaintyPart) -> Uncertainty:
    return Uncertainty(
        rotation_rad=math.radians(part.rotation_deg),
        translation=part.translation_m,
        head_rad=math.radians(part.head_deg),
    )


def _fisheye(part: FisheyePart) -> CameraModel:
    if not isinstance(part, UnifiedPart | KannalaBrandtPart):
        return PerspectiveCamera(**msgspec.structs.asdict(part))
    values = msgspec.structs.asdict(part)
    asked = math.radians(values.pop("max_angle_deg"))
    make = UnifiedCamera if isinstance(part, UnifiedPart) else KannalaBrandtCamera
    camera: UnifiedCamera | KannalaBrandtCamera = make(**values, max_angle_rad=asked)
    limit = math.degrees(camera.limit_rad)
    message = f"{part.max_angle_deg:g}° is beyond {limit:.3f}°, where the model folds back"
    require(camera.limit_rad >= asked, "fisheye.max_angle_deg", message)
    return camera


def _zoom(part: PtzPart) -> ZoomTable:
    with _prefixed("ptz.zoom"):
        entries = tuple(ZoomEntry(**msgspec.structs.asdict(entry)) for entry in part.zoom)
        table = ZoomTable(size_px=part.size_px, entries=entries)
    width, height = part.size_px
    across, down = np.linspace(-0.5, width - 0.5, 17), np.linspace(-0.5, height - 0.5, 17)
    for index, entry in enumerate(part.zoom):
        grid = np.stack(np.meshgrid(across, down), axis=-1)
        valid = table.camera_at(entry.zoom).lift(grid)[1]
        require(bool(valid.all()), f"ptz.zoom[{index}].distortion", "folds back inside the picture")
    before = math.inf
    for index, entry in enumerate(part.zoom):
        hfov = table.camera_at(entry.zoom).hfov_rad
        require(hfov < before, f"ptz.zoom[{index}].fx", "the field of view does not shrink from the entry before")
        before = hfov
    return table


def _head(part: HeadPart) -> HeadModel:
    axes = {
        name: Axis(sign=axis.sign, scale=axis.scale, offset_rad=math.radians(axis.offset_deg))
        for name, axis in (("pan", part.pan), ("tilt", part.tilt))
    }
    x, y, z = (math.radians(angle) for angle in part.camera_rotvec_deg)
    with _prefixed("head.camera_rotvec_deg"):
        return HeadModel(pan=axes["pan"], tilt=axes["tilt"], camera_rotvec_rad=(x, y, z))


def _rotation(rotvec_deg: tuple[float, ...]) -> Array:
    return rotation_from_rotvec([math.radians(angle) for angle in rotvec_deg])


def _fisheye_part(camera: CameraModel) -> dict[str, object]:
    size: dict[str, object] = {"size_px": list(camera.size_px)}
    if isinstance(camera, UnifiedCamera):
        shape = {"xi": float(camera.xi), "max_angle_deg": _degrees(camera.max_angle_rad)}
        return {"model": "unified", **size, **_pinhole(camera), **shape}
    if isinstance(camera, KannalaBrandtCamera):
        return {"model": "kannala_brandt", **size, **_pinhole(camera), "max_angle_deg": _degrees(camera.max_angle_rad)}
    if isinstance(camera, PerspectiveCamera):
        return {"model": "perspective", **size, **_pinhole(camera)}
    raise CalibrationError(f"fisheye.model: a {type(camera).__name__} has no name in the file")


def _pinhole(camera: UnifiedCamera | KannalaBrandtCamera | PerspectiveCamera | ZoomEntry) -> dict[str, object]:
    values: dict[str, object] = {name: float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy")}
    return {**values, "distortion": [float(coefficient) for coefficient in camera.distortion]}


def _axis_part(axis: Axis) -> dict[str, object]:
    return {"sign": int(axis.sign), "scale": float(axis.scale), "offset_deg": _degrees(axis.offset_rad)}


def _degrees(angle_rad: float) -> float:
    """Return the shortest number of degrees that reads back to the same angle, or 10 decimals."""
    exact = math.degrees(angle_rad)
    for decimals in range(_DECIMALS):
        if math.radians(_rounded(exact, decimals)) == angle_rad:
            return _rounded(exact, decimals)
    return _rounded(exact, _DECIMALS)


def _rotvec_degrees(rotation: Array) -> list[float]:
    """Return the shortest rotation vector in deg that reads back to the same matrix, or 10 decimals."""
    exact = [math.degrees(angle) for angle in rotvec_from_rotation(rotation)]
    for decimals in range(_DECIMALS):
        rounded = [_rounded(angle, decimals) for angle in exact]
        if np.array_equal(_rotation(tuple(rounded)), rotation):
            return rounded
    return [_rounded(angle, _DECIMALS) for angle in exact]


def _rounded(value: float, decimals: int) -> float:
    return round(value, decimals) + 0.0  # no negative zero
