"""Calibrations as text of their own: COLMAP's cameras.txt, mrcal, Bouguet's; and those that cannot be read."""

from __future__ import annotations

import re

from ptzd.calibration.foreign.described import COPY, Described, chosen
from ptzd.calibration.foreign.fields import number
from ptzd.calibration.foreign.matrices import pair_of
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
_MRCAL = {"PINHOLE": 4, "OPENCV4": 8, "OPENCV5": 9, "OPENCV8": 12, "OPENCV12": 16}
"""Lens models of mrcal that are OpenCV's, and how many numbers each has."""
_REFUSED = (
    (
        re.compile(r"polynomial coefficients for the DIRECT mapping|ocam_model\.ss"),
        "of OCamCalib, whose polynomial has no counterpart here; calibrate the same pictures with "
        "`ptzd calibrate fisheye PICTURES`, or with OpenCV's fisheye or omnidir",
    ),
    (
        re.compile(r"^\[image\]\s*$[\s\S]*^camera matrix", re.MULTILINE),
        "the ost.txt of ROS; give the ost.yaml beside it, which names the model",
    ),
    (
        re.compile(r"^\s*Camera-system parameters:", re.MULTILINE),
        "the report of Kalibr; give the camchain.yaml beside it, which names the model and the size",
    ),
    (
        re.compile(r"\A(?:\s*[#;].*\n)*\s*\[[^\]\n,]+\]\s*\n\s*\w+\s*="),
        f"an .ini or .toml, which is not read here; {COPY}",
    ),
)
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
    for form, words in _REFUSED:
        if form.search(text):
            raise CalibrationError(words)
    if re.search(r"^\s*['\"]lens_?model['\"]\s*:", text, re.MULTILINE):
        return None, _mrcal(text)
    if re.search(r"^\s*fc\s*=\s*\[", text, re.MULTILINE):
        return None, _bouguet(text)
    lines = _COLMAP.findall(text)
    if not lines:
        return None
    for count, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#") and not _COLMAP.fullmatch(line):
            raise CalibrationError(
                f"line {count}: no camera of COLMAP (CAMERA_ID MODEL WIDTH HEIGHT PARAMS), as others are"
            )
    return _colmap(lines, camera)


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


def _mrcal(text: str) -> Described:
    """A .cameramodel; pixels count as in OpenCV."""
    text = re.sub(r"^\s*#.*$", "", text, flags=re.MULTILINE)
    found: dict[str, str] = {}
    for key in ("lens_?model", "intrinsics", "imagersize"):
        values = re.findall(rf"""['"]{key}['"]\s*:\s*(?:['"\[(]+)([^'"\])]*)""", text)
        if len(values) != 1:
            raise CalibrationError(f"{key.replace('_?', '')}: {len(values)} of them; a .cameramodel of mrcal has one")
        found[key] = values[0]
        model = found["lens_?model"].removeprefix("LENSMODEL_")
        if model not in _MRCAL:
            raise CalibrationError(
                f"lensmodel {model} of mrcal has no counterpart here; calibrate with LENSMODEL_OPENCV5"
            )
    given = [_number(word, "intrinsics") for word in re.split(r"[\s,]+", found["intrinsics"].strip(" ,\n")) if word]
    size = [_number(word, "imagersize") for word in re.split(r"[\s,]+", found["imagersize"].strip(" ,\n")) if word]
    if len(given) != _MRCAL[model]:
        raise CalibrationError(f"intrinsics: {len(given)} numbers; {model} of mrcal has {_MRCAL[model]}")
    fx, fy, cx, cy, *extra = given
    return Described(
        source=f"mrcal {model}",
        model="perspective",
        size_px=pair_of(size, "imagersize"),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        coefficients=tuple(extra),
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
