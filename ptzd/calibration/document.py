"""The shape of rig.yaml and what must hold in it, field by field; `ptzd.calibration.file` reads and writes it."""

from __future__ import annotations

import math
from typing import Any

import msgspec

from ptzd.errors import CalibrationError

VERSION = 1
Three = tuple[float, float, float]
Four = tuple[float, float, float, float]
Five = tuple[float, float, float, float, float]


class Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A mapping of the file."""


class UnifiedPart(Part, frozen=True, tag_field="model", tag="unified"):
    """A fisheye of the unified spherical model; distortion k1 k2 p1 p2."""

    size_px: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    xi: float
    distortion: Four
    max_angle_deg: float


class KannalaBrandtPart(Part, frozen=True, tag_field="model", tag="kannala_brandt"):
    """A fisheye of the Kannala-Brandt model; distortion k1 k2 k3 k4."""

    size_px: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Four
    max_angle_deg: float


class PerspectivePart(Part, frozen=True, tag_field="model", tag="perspective"):
    """A wide-angle camera without a fisheye; distortion k1 k2 p1 p2 k3."""

    size_px: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Five


FisheyePart = UnifiedPart | KannalaBrandtPart | PerspectivePart


class ZoomPart(Part, frozen=True):
    """Intrinsics of the PTZ at one zoom; distortion k1 k2 p1 p2 k3."""

    zoom: float
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: Five


class PtzPart(Part, frozen=True):
    """The PTZ's picture and its zoom table."""

    size_px: tuple[int, int]
    zoom: tuple[ZoomPart, ...]


class AxisPart(Part, frozen=True):
    """``angle = sign · scale · reported + offset``."""

    sign: int
    scale: float
    offset_deg: float


class HeadPart(Part, frozen=True):
    """Both axes and the camera's misalignment on them."""

    pan: AxisPart
    tilt: AxisPart
    camera_rotvec_deg: Three = (0.0, 0.0, 0.0)


class RigPart(Part, frozen=True):
    """``X_head = R X_fisheye + T``; T has length 1 when the rig is not metric."""

    rotvec_deg: Three
    translation_m: Three
    metric: bool


class UncertaintyPart(Part, frozen=True):
    """One sigma."""

    rotation_deg: float
    translation_m: float
    head_deg: float


class Document(Part, frozen=True):
    """The whole file."""

    ptzd_calibration: int
    fisheye: FisheyePart
    ptz: PtzPart
    head: HeadPart
    rig: RigPart
    uncertainty: UncertaintyPart | None = None
    provenance: dict[str, Any] = {}


def require(holds: bool, path: str, message: str) -> None:
    """Raise a CalibrationError that names the culprit unless the condition holds."""
    if not holds:
        raise CalibrationError(f"{path}: {message}")


def check_document(document: Document) -> None:
    """Raise CalibrationError, path first, for the first value that cannot be true of a real rig."""
    sections = {name: getattr(document, name) for name in ("fisheye", "ptz", "head", "rig", "uncertainty")}
    _check_finite(msgspec.to_builtins(sections), "")
    check_fisheye(document.fisheye)
    _check_zoom(document.ptz)
    for axis in ("pan", "tilt"):
        _check_axis(getattr(document.head, axis), f"head.{axis}")
    length = math.hypot(*document.head.camera_rotvec_deg)
    require(length <= 180.0, "head.camera_rotvec_deg", f"its length {length:g}° is over 180°")
    _check_rig(document.rig)
    if document.uncertainty is not None:
        _check_uncertainty(document.uncertainty, math.hypot(*document.rig.translation_m))


def _check_finite(value: object, path: str) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _check_finite(item, f"{path}.{key}" if path else key)
    elif isinstance(value, list | tuple):
        for index, item in enumerate(value):
            _check_finite(item, f"{path}[{index}]")
    elif isinstance(value, float):
        require(math.isfinite(value), path, f"{value} is not a finite number")


def _check_size(size_px: tuple[int, int], path: str) -> None:
    require(all(16 <= side <= 16384 for side in size_px), path, f"{list(size_px)}: each side must be 16 to 16384 px")


def _check_pinhole(part: FisheyePart | ZoomPart, size_px: tuple[int, int], path: str) -> None:
    require(part.fx > 0.0, f"{path}.fx", f"{part.fx:g} px: the focal length must be positive, mirrored or not")
    require(part.fy > 0.0, f"{path}.fy", f"{part.fy:g} px: the focal length must be positive, mirrored or not")
    require(0.5 <= part.fy / part.fx <= 2.0, f"{path}.fy", f"{part.fy:g} px does not go with fx = {part.fx:g} px")
    for name, value, side in (("cx", part.cx, size_px[0]), ("cy", part.cy, size_px[1])):
        inside = -0.5 <= value <= side - 0.5
        require(inside, f"{path}.{name}", f"{value:g} px is outside the picture, -0.5 to {side - 0.5:g} px")


def check_fisheye(part: FisheyePart) -> None:
    """Raise CalibrationError, path first, for the first value that cannot be true of a fisheye."""
    _check_finite(msgspec.to_builtins(part), "fisheye")
    _check_size(part.size_px, "fisheye.size_px")
    _check_pinhole(part, part.size_px, "fisheye")
    if isinstance(part, UnifiedPart):
        require(0.0 <= part.xi <= 20.0, "fisheye.xi", f"{part.xi:g}: the mirror parameter must be 0 to 20")
    if not isinstance(part, PerspectivePart):
        angle = part.max_angle_deg
        require(0.0 < angle < 180.0, "fisheye.max_angle_deg", f"{angle:g}° must be over 0° and under 180°")


def _check_zoom(part: PtzPart) -> None:
    _check_size(part.size_px, "ptz.size_px")
    require(len(part.zoom) > 0, "ptz.zoom", "empty; at least one entry is needed")
    for index, entry in enumerate(part.zoom):
        path = f"ptz.zoom[{index}]"
        require(entry.zoom > 0.0, f"{path}.zoom", f"{entry.zoom:g}: VAPIX zoom starts at 1")
        _check_pinhole(entry, part.size_px, path)
        if index > 0:
            before = part.zoom[index - 1]
            message = f"{entry.zoom:g} does not come after {before.zoom:g}; order the entries by zoom, each once"
            require(entry.zoom > before.zoom, f"{path}.zoom", message)
            message = f"{entry.fx:g} px at a longer zoom than {before.fx:g} px; the field of view must shrink"
            require(entry.fx > before.fx, f"{path}.fx", message)


def _check_axis(part: AxisPart, path: str) -> None:
    require(part.sign in (-1, 1), f"{path}.sign", f"{part.sign} must be 1 or -1")
    require(
        0.5 <= part.scale <= 2.0, f"{path}.scale", f"{part.scale:g} must be 0.5 to 2; the sign is a field of its own"
    )
    require(abs(part.offset_deg) <= 360.0, f"{path}.offset_deg", f"{part.offset_deg:g}° is over a whole turn")


def _check_rig(part: RigPart) -> None:
    length = math.hypot(*part.rotvec_deg)
    require(
        length <= 180.0 + 1e-9, "rig.rotvec_deg", f"its length {length:g}° is over 180°; write the shorter way round"
    )
    baseline = math.hypot(*part.translation_m)
    require(baseline > 0.0, "rig.translation_m", "zero: both cameras at one place have no parallax to scan")
    if part.metric:
        plausible = 1e-3 <= baseline <= 100.0
        require(plausible, "rig.translation_m", f"{baseline:g} m between the cameras; 0.001 to 100 metres are expected")
    else:
        message = f"its length {baseline:.9g} must be 1 when metric is false"
        require(abs(baseline - 1.0) <= 1e-6, "rig.translation_m", message)


def _check_uncertainty(part: UncertaintyPart, baseline: float) -> None:
    for name, value in (("rotation_deg", part.rotation_deg), ("head_deg", part.head_deg)):
        require(0.0 <= value <= 45.0, f"uncertainty.{name}", f"{value:g}° must be 0° to 45°, one sigma")
    value = part.translation_m
    require(0.0 <= value <= baseline, "uncertainty.translation_m", f"{value:g} must be 0 to the baseline, {baseline:g}")
