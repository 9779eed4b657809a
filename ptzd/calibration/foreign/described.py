"""A lens as another tool describes it, and the camera that has the same rays; or the reason why there is none here."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import msgspec

from ptzd.calibration.document import FisheyePart, check_fisheye
from ptzd.calibration.file import fisheye_section
from ptzd.errors import CalibrationError
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import CameraModel
from ptzd.geometry.unified import UnifiedCamera

MODELS = ("unified", "kannala_brandt", "perspective")
COPY = (
    "if the lens is of OpenCV's models, write image_width, image_height, camera_matrix, distortion_coefficients and, "
    "for its fisheye, fisheye_model: 1 into a .yaml; else calibrate with `ptzd calibrate fisheye PICTURES`"
)
"""What to do with a file whose form is not read here."""
_ORDER = {
    "unified": ("k1", "k2", "p1", "p2"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
    "perspective": ("k1", "k2", "p1", "p2", "k3"),
}
_SKEW_PX = 1e-6
"""Rounding of an optimiser; a pixel moves by no more than this times its distance from the centre in focal lengths."""
_OFF_CENTRE = 0.15
"""Share of the picture's side; lenses sit within a few percent, another resolution or a crop is farther off."""
_FOCAL = (0.02, 100.0)
"""Focal length at the centre by the longer side: from beyond a half sphere in a tenth of the picture to a telescope."""
_LARGEST_XI = 20.0
"""As for rig.yaml."""
_LEAST_REACH_RAD = math.radians(5.0)
_GUARD_RAD = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Described:
    """What a file says of a lens; pixel (0, 0) is the centre of the top-left pixel."""

    source: str
    """Whose file it is, for people."""
    model: str | None
    """As in rig.yaml; None when the file does not say."""
    size_px: tuple[int, int] | None
    fx: float
    fy: float
    cx: float
    cy: float
    coefficients: tuple[float, ...]
    """In OpenCV's order: k1 k2 p1 p2 k3 …, or k1 k2 k3 k4 of its fisheye."""
    skew: float = 0.0
    """Pixels by which u grows with y; OpenCV's K[0][1]."""
    xi: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Asked:
    """What the person who imports says beyond the file."""

    model: str | None = None
    """One of `MODELS`."""
    size_px: tuple[int, int] | None = None
    max_angle_rad: float = math.pi / 2
    camera: str | None = None
    """Name of one camera in a file of several."""


def camera_of(lens: Described, asked: Asked) -> CameraModel:
    """Return the camera with the rays of the description.

    Its largest angle is the one asked for, or less where the model itself ends earlier.

    Raises
    ------
    CalibrationError
        When the file leaves something open that nobody said, when no model here has these rays, or when the values
        cannot be true.
    """
    model, size_px = _model(lens, asked.model), _size(lens.size_px, asked.size_px)
    if abs(lens.skew) > _SKEW_PX:
        raise CalibrationError(
            f"skew of {lens.skew:g} px (K[0][1]); the models here have axes at right angles, its rays would be wrong: "
            "calibrate again with the skew fixed at 0"
        )
    distortion = _coefficients(lens.coefficients, model)
    _check_focal(lens, size_px)
    if asked.size_px is None:
        _check_centre(lens, size_px)
    pinhole = {"size_px": size_px, "fx": lens.fx, "fy": lens.fy, "cx": lens.cx, "cy": lens.cy}
    camera: CameraModel
    if model == "perspective":
        k1, k2, p1, p2, k3 = distortion
        camera = PerspectiveCamera(**pinhole, distortion=(k1, k2, p1, p2, k3))  # type: ignore[arg-type]
    else:
        camera = _fisheye(model, lens.xi, pinhole, distortion, asked.max_angle_rad)
    check_fisheye(msgspec.convert(fisheye_section(camera), FisheyePart))
    if camera.limit_rad < _LEAST_REACH_RAD:
        raise CalibrationError(
            f"distortion {list(lens.coefficients)}: folds back {math.degrees(camera.limit_rad):.2f}° off the axis; "
            f"these are not coefficients of {model}"
        )
    return camera


def _fisheye(
    model: str, xi: float, pinhole: dict[str, object], distortion: tuple[float, ...], limit_rad: float
) -> CameraModel:
    k1, k2, third, fourth = distortion
    values = {**pinhole, "distortion": (k1, k2, third, fourth), "max_angle_rad": limit_rad}
    unified = model == "unified"
    camera = UnifiedCamera(**values, xi=xi) if unified else KannalaBrandtCamera(**values)  # type: ignore[arg-type]
    if camera.limit_rad >= limit_rad or camera.limit_rad <= _GUARD_RAD:
        return camera
    return replace(camera, max_angle_rad=camera.limit_rad - _GUARD_RAD)


def _model(lens: Described, asked: str | None) -> str:
    if lens.model is None:
        if asked is None:
            raise CalibrationError(
                f"does not say which model its {len(lens.coefficients)} coefficients are of; "
                "give --model perspective (k1 k2 p1 p2 …) or --model kannala_brandt (fisheye, k1 k2 k3 k4)"
            )
        if asked == "unified":
            raise CalibrationError("--model unified: the file has no xi")
        return asked
    if asked not in (None, lens.model):
        raise CalibrationError(
            f"--model {asked}: the file's numbers are of {lens.model}; leave --model away, or calibrate with {asked}"
        )
    return lens.model


def _size(given: tuple[int, int] | None, asked: tuple[int, int] | None) -> tuple[int, int]:
    size_px = given or asked
    if size_px is None:
        raise CalibrationError("does not say the picture's size; give it with --size WIDTHxHEIGHT, in px")
    if given is not None and asked is not None and given != asked:
        raise CalibrationError(
            f"is for pictures of {given[0]}×{given[1]} px, --size asks for {asked[0]}×{asked[1]} px; "
            "calibrate in the resolution that is streamed"
        )
    return size_px


def _coefficients(values: tuple[float, ...], model: str) -> tuple[float, ...]:
    names = _ORDER[model]
    counts = (0, 4, 5, 8, 12, 14) if model == "perspective" else (4, 5)
    if len(values) not in counts:
        raise CalibrationError(
            f"{len(values)} distortion coefficients; {model} has {' '.join(names)}, so {_listed(counts)} are expected"
        )
    for index, value in enumerate(values[len(names) :], start=len(names)):
        if value != 0.0:
            raise CalibrationError(
                f"distortion coefficient {index + 1} is {value:g}; {model} has {' '.join(names)} only here: calibrate "
                "again without the rational, thin-prism and tilted terms, or with the fisheye model"
            )
    return (*values, *[0.0] * len(names))[: len(names)]


def _listed(counts: tuple[int, ...]) -> str:
    return f"{', '.join(map(str, counts[:-1]))} or {counts[-1]}"


def _check_focal(lens: Described, size_px: tuple[int, int]) -> None:
    if not 0.0 <= lens.xi <= _LARGEST_XI:
        raise CalibrationError(f"xi: {lens.xi:g}: the mirror parameter must be 0 to {_LARGEST_XI:g}")
    for name, value in (("fx", lens.fx), ("fy", lens.fy)):
        low, high = (share * max(size_px) for share in _FOCAL)
        central = value / (1.0 + lens.xi)
        if not low <= central <= high:
            raise CalibrationError(
                f"{name}: {value:g} px is no focal length for a picture of {size_px[0]}×{size_px[1]} px, {low:g} to "
                f"{high:g} px at the centre are expected; is it in mm, or a share of the width?"
            )


def _check_centre(lens: Described, size_px: tuple[int, int]) -> None:
    """Refuse a principal point that belongs to another picture; who gives --size has been asked."""
    width, height = size_px
    off = max(abs((lens.cx + 0.5) / width - 0.5), abs((lens.cy + 0.5) / height - 0.5))
    if off <= _OFF_CENTRE:
        return
    raise CalibrationError(
        f"the principal point ({lens.cx:g}, {lens.cy:g}) px is far from the middle of {width}×{height} px: is the "
        f"matrix of another resolution (about {2 * lens.cx:.0f}×{2 * lens.cy:.0f} px), of a crop, or are the sides "
        f"swapped? If the file is right, say so with --size {width}x{height}"
    )


def chosen(names: list[str], camera: str | None) -> str:
    """The name of the camera that is meant in a file of several; CalibrationError when nobody says which."""
    listed = ", ".join(names)
    if camera is None:
        if len(names) > 1:
            raise CalibrationError(f"holds {len(names)} cameras ({listed}); name the fisheye's with --camera")
        return names[0]
    if camera not in names:
        raise CalibrationError(f"--camera {camera}: not in the file, which holds {listed}")
    return camera
