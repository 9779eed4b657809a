"""Calibrations as lines of text: COLMAP's cameras.txt, Bouguet's Calib_Results.m; and those that cannot be read."""

from __future__ import annotations

import re

from ptzd.calibration.foreign.described import Described, chosen
from ptzd.calibration.foreign.fields import number
from ptzd.calibration.foreign.rigs import CORNER_PX
from ptzd.errors import CalibrationError

_COLMAP = re.compile(r"^\s*(\d+)\s+([A-Z_]{3,})\s+(\d+)\s+(\d+)((?:\s+[-+.\deE]+)+)\s*$", re.MULTILINE)
_LENSES = {
    "SIMPLE_PINHOLE": ("perspective", "f cx cy"),
    "PINHOLE": ("perspective", "fx fy cx cy"),
    "SIMPLE_RADIAL": ("perspective", "f cx cy k1"),
    "RADIAL": ("perspective", "f cx cy k1 k2"),
    "OPENCV": ("perspective", "fx fy cx cy k1 k2 p1 p2"),
    "FULL_OPENCV": ("perspective", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    "OPENCV_FISHEYE": ("kannala_brandt", "fx fy cx cy k1 k2 k3 k4"),
    "SIMPLE_RADIAL_FISHEYE": ("kannala_brandt", "f cx cy k1"),
    "RADIAL_FISHEYE": ("kannala_brandt", "f cx cy k1 k2"),
}
_ORDER = {
    "perspective": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "kannala_brandt": ("k1", "k2", "k3", "k4"),
}
_BOUGUET = re.compile(r"^\s*(fc|cc|kc|alpha_c|nx|ny)\s*=\s*\[?([^=\[\]]*?)\]?\s*;\s*(?:%.*)?$", re.MULTILINE)


def table(text: str, camera: str | None) -> tuple[str | None, Described] | None:
    """Name and lens of a file of lines; None when it is none.

    Raises
    ------
    CalibrationError
        When its model has no counterpart here.
    """
    if "polynomial coefficients for the DIRECT mapping" in text or "ocam_model.ss" in text:
        raise CalibrationError(
            "of OCamCalib, whose polynomial has no counterpart here; calibrate the same pictures with "
            "`ptzd calibrate fisheye PICTURES`, or with OpenCV's fisheye or omnidir"
        )
    if re.search(r"^\[image\]\s*$", text, re.MULTILINE) and "camera matrix" in text:
        raise CalibrationError("the ost.txt of ROS; give the ost.yaml beside it, which names the model")
    if re.search(r"^\s*fc\s*=\s*\[", text, re.MULTILINE):
        return None, _bouguet(text)
    lines = _COLMAP.findall(text)
    return _colmap(lines, camera) if lines else None


def _colmap(lines: list[tuple[str, ...]], camera: str | None) -> tuple[str | None, Described]:
    name = chosen([line[0] for line in lines], camera)
    _, model, width, height, numbers = next(line for line in lines if line[0] == name)
    if model not in _LENSES:
        raise CalibrationError(f"{model} of COLMAP has no counterpart here; use OPENCV_FISHEYE, OPENCV or RADIAL")
    kind, names = _LENSES[model]
    given = [_number(word, model) for word in numbers.split()]
    if len(given) != len(names.split()):
        raise CalibrationError(f"{model}: {len(given)} numbers instead of {names}")
    values = dict(zip(names.split(), given, strict=True))
    return name, Described(
        source=f"COLMAP {model}",
        model=kind,
        size_px=(int(width), int(height)),
        fx=values.get("f", values.get("fx", 0.0)),
        fy=values.get("f", values.get("fy", 0.0)),
        cx=values["cx"] - CORNER_PX,
        cy=values["cy"] - CORNER_PX,
        coefficients=tuple(values.get(key, 0.0) for key in _ORDER[kind]),
    )


def _bouguet(text: str) -> Described:
    """Calib_Results.m: pixels count from 0, and the skew is α times fx."""
    values = {
        name: [_number(word, name) for word in re.split(r"[\s;,]+", words.strip()) if word]
        for name, words in _BOUGUET.findall(text)
    }
    for name, count in (("fc", 2), ("cc", 2), ("kc", 5), ("nx", 1), ("ny", 1)):
        if len(values.get(name, [])) != count:
            raise CalibrationError(f"{name}: missing, or not {count} numbers; is it a Calib_Results.m?")
    (fx, fy), (cx, cy) = values["fc"], values["cc"]
    return Described(
        source="Bouguet's toolbox",
        model="perspective",
        size_px=(int(values["nx"][0]), int(values["ny"][0])),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        skew=fx * (values.get("alpha_c") or [0.0])[0],
        coefficients=tuple(values["kc"]),
    )


def _number(word: str, path: str) -> float:
    try:
        return number(float(word), path)
    except ValueError:
        raise CalibrationError(f"{path}: {word!r} is no number") from None
