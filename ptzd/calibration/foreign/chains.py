"""Cameras with intrinsics in a list: Kalibr's camchain and the sensor.yaml of EuRoC; and camodocal's sections."""

from __future__ import annotations

import re

from ptzd.calibration.foreign.described import Described
from ptzd.calibration.foreign.fields import Fields
from ptzd.calibration.foreign.matrices import image_size
from ptzd.errors import CalibrationError

_COUNTS = {"pinhole": 4, "omni": 5, "eucm": 6}
_STRAIGHT = ("radtan", "radial_tangential", "plumb_bob", "none")
_KNOWN = frozenset(
    [("pinhole", bent) for bent in (*_STRAIGHT, "equidistant", "equi")]
    + [("omni", bent) for bent in _STRAIGHT]
    + [("eucm", "none")]
)
"""Models that are read, judged before their numbers: another model's have other names and another count."""
_CAMODOCAL = ("kannala_brandt", "mei", "pinhole", "pinhole_full")
_OF_LENS = re.compile(r"(?i).*(_parameters|distort|lens|model|skew|scale|resize|binning|crop).*|alpha|beta|xi|[kp]\d")
"""What a file of camodocal may say of the lens outside its sections; VINS's `fisheye: 1` is a mask."""
_UCM = "calibrate with omni-radtan or pinhole-equi"


def intrinsics(fields: Fields) -> Described:
    """Return the lens of one camera of Kalibr or EuRoC.

    Raises
    ------
    CalibrationError
        When its model has no counterpart here, or its numbers are not those of its model.
    """
    model, bent = fields.text("camera_model"), fields.text("distortion_model")
    if (model, bent) not in _KNOWN:
        raise CalibrationError(f"camera_model {model}-{bent} has no counterpart here; {_UCM}")
    values = fields.numbers("intrinsics")
    extra = fields.numbers("distortion_coeffs", "distortion_coefficients")
    size_px = image_size(fields)
    source = "EuRoC" if "distortion_coefficients" in fields else "Kalibr"
    if len(values) != _COUNTS[model]:
        raise CalibrationError(f"{fields.name('intrinsics')}: {len(values)} numbers; {model} has {_COUNTS[model]}")
    if bent == "none":
        if any(extra):
            raise CalibrationError(f"{fields.name('distortion_coeffs')}: {list(extra)} with distortion_model none")
        extra = (0.0,) * 4
    fx, fy, cx, cy = values[-4:]
    straight = bent in _STRAIGHT
    if model == "pinhole":
        model, xi = "perspective" if straight else "kannala_brandt", 0.0
    elif model == "omni":
        model, xi = "unified", values[0]
    else:
        alpha, beta = values[:2]
        if beta != 1.0:
            raise CalibrationError(f"camera_model eucm with beta {beta:g} has no counterpart here; {_UCM}")
        xi, fx, fy = from_alpha(alpha, fx, fy)
        model = "unified"
    return Described(source=source, model=model, size_px=size_px, fx=fx, fy=fy, cx=cx, cy=cy, xi=xi, coefficients=extra)


def from_alpha(alpha: float, fx: float, fy: float) -> tuple[float, float, float]:
    """ξ, fx and fy of a unified camera written as ``x / (α d + (1 - α) z)`` (Usenko et al. 2018, eq. 4)."""
    if not 0.0 <= alpha < 1.0:
        raise CalibrationError(f"alpha {alpha:g} must be 0 to 1")
    return alpha / (1.0 - alpha), fx / (1.0 - alpha), fy / (1.0 - alpha)


def camodocal(fields: Fields) -> Described:
    """Return the lens of a file with ``model_type``: camodocal, VINS-Mono and -Fusion, KITTI-360.

    MEI is Mei & Rives' model with γ as focal lengths; KANNALA_BRANDT counts its coefficients k2 to k5 for θ³ to θ⁹.

    Raises
    ------
    CalibrationError
        When its model has no counterpart here.
    """
    kind = fields.text("model_type")
    if kind not in _CAMODOCAL:
        raise CalibrationError(
            f"model_type {kind.upper()} has no counterpart here; calibrate with MEI or KANNALA_BRANDT"
        )
    size_px = image_size(fields)
    project = fields.section("projection_parameters")
    if kind == "kannala_brandt":
        fx, fy, cx, cy = (project.number(key) for key in ("mu", "mv", "u0", "v0"))
        extra = tuple(project.number(key) for key in ("k2", "k3", "k4", "k5"))
        model, xi = "kannala_brandt", 0.0
    else:
        bent = fields.section("distortion_parameters")
        names = ("k1", "k2", "p1", "p2", *(("k3", "k4", "k5", "k6") if kind == "pinhole_full" else ()))
        extra = tuple(bent.number(key) for key in names)
        model, xi = "perspective", 0.0
        keys = ("fx", "fy", "cx", "cy")
        if kind == "mei":
            model, xi = "unified", fields.section("mirror_parameters").number("xi")
            keys = ("gamma1", "gamma2", "u0", "v0")
        fx, fy, cx, cy = (project.number(key) for key in keys)
    for key in fields.values:
        if not _OF_LENS.fullmatch(key):
            fields.find(key)  # of the estimator, whose settings VINS keeps in the same file
    return Described(
        source=f"camodocal, {kind.upper()}",
        model=model,
        size_px=size_px,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        xi=xi,
        coefficients=extra,
    )
