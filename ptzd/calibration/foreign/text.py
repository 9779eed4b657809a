"""Files of other tools as plain values: YAML as OpenCV, ROS and Kalibr write it, JSON, and OpenCV's XML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn
from xml.etree import ElementTree

from ptzd.calibration.foreign.described import COPY
from ptzd.documents import DEEPEST, DocumentError, parse_yaml, read_regular, read_text
from ptzd.errors import CalibrationError

_BINARY = (
    (b"MATLAB", "a .mat file of MATLAB; write jsonencode(toStruct(params)) into a .json and give that"),
    (b"\x89HDF", "an HDF5 or .mat file; write the matrix, the coefficients and the size as text (YAML or JSON)"),
    (b"PK\x03\x04", "an archive (.npz or .zip); write its matrix, coefficients and image size as YAML or JSON"),
    (b"\x1f\x8b", "an archive (.gz); unpack it and give the .yaml inside"),
    (b"\x93NUMPY", "an array of NumPy; write matrix, coefficients and image size as YAML or JSON"),
    (b"\x80", "a pickle of Python; write matrix, coefficients and image size as YAML or JSON"),
    (b"\xff\xd8", "a picture; give the folder of pictures without --from, or the file of the calibration"),
    (b"\x89PNG", "a picture; give the folder of pictures without --from, or the file of the calibration"),
)


def read_source(path: Path) -> str:
    """Return the text of a file.

    Raises
    ------
    CalibrationError
        When it cannot be read or is none, with what it is instead where that can be told.
    """
    try:
        head = read_regular(path, 16)
    except OSError as error:
        raise CalibrationError(f"cannot be read: {error.strerror}") from None
    for start, words in _BINARY:
        if head.startswith(start):
            raise CalibrationError(words)
    if path.suffix == ".bin":
        raise CalibrationError("binary; of COLMAP? write it with `colmap model_converter --output_type TXT`")
    try:
        return read_text(path)
    except (OSError, DocumentError) as error:
        raise CalibrationError(f"cannot be read: {error}") from None


def plain_values(text: str) -> Mapping[str, Any]:
    """Return what a text holds, whichever of the three notations it is in.

    Raises
    ------
    CalibrationError
        When it is in none, or holds several different calibrations one after the other.
    """
    start = text.lstrip()[:1]
    if start == "<":
        return _xml(text)
    values = _json(text) if start == "{" else _yaml(text)
    if not isinstance(values, dict):
        raise CalibrationError(f"holds {_kind(values)}, not the named values of a calibration; {COPY}")
    return {str(key): value for key, value in values.items()}


def _kind(value: object) -> str:
    return {list: "a list", str: "text", type(None): "nothing"}.get(type(value), "a single value")


def _json(text: str) -> object:
    def constant(name: str) -> NoReturn:
        raise CalibrationError(f"{name} is not a finite number")

    def mapping(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        keys = [key for key, _ in pairs]
        twice = [key for key in keys if keys.count(key) > 1]
        if twice:
            raise CalibrationError(f"key {twice[0]!r} is given twice")
        return dict(pairs)

    try:
        values: object = json.loads(text, parse_constant=constant, object_pairs_hook=mapping)
    except json.JSONDecodeError as error:
        raise CalibrationError(f"line {error.lineno}, column {error.colno}: not JSON: {error.msg}") from None
    except (ValueError, RecursionError):
        raise CalibrationError("not JSON that can be read: nested too deep, or a number of too many digits") from None
    level, depth = [values], 0
    while level:
        inside = [list(item.values()) if isinstance(item, dict) else item for item in level]
        level, depth = [item for items in inside if isinstance(items, list) for item in items], depth + 1
        if depth > DEEPEST:
            raise CalibrationError(f"nested deeper than {DEEPEST} levels")
    return values


def _yaml(text: str) -> object:
    if "!!python/" in text:
        raise CalibrationError("holds objects of Python; write arrays with .tolist() and the file with yaml.safe_dump")
    text = re.sub(r"^%YAML.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"!!opencv-(?:nd-)?matrix\b", "", text)
    try:
        # `ros2 topic echo` ends every message with a line of its own
        parts = [parse_yaml(part) for part in re.split(r"^---[ \t]*\r?$", text, flags=re.MULTILINE)]
    except DocumentError as error:
        raise CalibrationError(str(error)) from None
    found = [part for part in parts if part is not None]
    distinct = [_without_header(part) for part in found]
    if any(part != distinct[0] for part in distinct[1:]):
        raise CalibrationError(
            f"holds {len(found)} different documents, one after the other; keep the one that is meant"
        )
    return found[0] if found else None


def _without_header(part: object) -> object:
    return {key: value for key, value in part.items() if key != "header"} if isinstance(part, dict) else part


def _xml(text: str) -> Mapping[str, Any]:
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise CalibrationError("XML with declarations of its own (<!DOCTYPE>, <!ENTITY>), which OpenCV does not write")
    try:
        root = ElementTree.fromstring(text)  # noqa: S314  # no entities: refused above
    except ElementTree.ParseError as error:
        raise CalibrationError(f"not XML: {error}") from None
    if root.tag != "opencv_storage":
        raise CalibrationError(f"XML, but not of OpenCV: <{root.tag}> instead of <opencv_storage>; {COPY}")
    return {str(key): value for key, value in _children(root, 0).items()}


def _children(element: ElementTree.Element, depth: int) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for child in element:
        if child.tag in values:
            raise CalibrationError(f"<{child.tag}> is given twice")
        values[child.tag] = _value(child, depth + 1)
    return values


def _value(element: ElementTree.Element, depth: int) -> object:
    if depth > DEEPEST:
        raise CalibrationError(f"XML nested deeper than {DEEPEST} levels")
    if len(element) and all(child.tag == "_" for child in element):
        return [_value(child, depth + 1) for child in element]
    if len(element):
        return _children(element, depth)
    text = (element.text or "").strip()
    if text.startswith('"'):
        return text.strip('"')
    words = [_word(word) for word in text.split()]
    if element.tag in ("data", "sizes"):
        return words
    return words[0] if len(words) == 1 else words if all(isinstance(word, int | float) for word in words) else text


def _word(word: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word
