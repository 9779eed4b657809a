"""Named values of a file, each taken or accounted for: what nobody took is refused by its name."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from ptzd.errors import CalibrationError

LARGEST = 1e6
"""Of any number of a lens: px, or a coefficient."""
_ASIDE = re.compile(
    r"""(?ix) header | seq | stamp | frame_id | secs | nsecs | .*time.* | .*date.* | rate_hz | t_.* | r | p
    | (?-i:R[12]|[TEQ])
    | rvecs? | tvecs? | .*rectif.* | projection_matrix | new_?camera_?(matrix|mtx) | optimal_?camera_?matrix
    | board.* | square.* | marker.* | pattern.* | grid.* | nr_of_.* | n_?frames | num_.* | n_?(views|images|pictures)
    | flags | aspect_?ratio | fix_.*
    | .*err(or)?s?(_.*)? | ret | rms.* | reproj.* | per_?view.* | extrinsics?(_.*)? | .*_points
    | cam_overlaps | frames(count)? | .*vignette.* | .*std_?dev.* | .*covariance.* | sensor_type | comment | version"""
)
"""What calibrations say besides the lens: when and how it was made, how well it fits, where the camera stood, and the
rectified picture (R, P), which is not the one that is streamed."""
_TELLING = re.compile(r"(?i).*(model|distort|fisheye|lens|projection).*")


class Fields:
    """A mapping of a file.

    Parameters
    ----------
    values : mapping
        As parsed.
    path : str
        Of the mapping in the file, for messages.
    """

    def __init__(self, values: Mapping[str, Any], path: str = "") -> None:
        self.values = values
        self.path = path
        self._taken: set[str] = set()
        self._sections: list[Fields] = []

    def name(self, key: str) -> str:
        """The path of a key."""
        return f"{self.path}.{key}" if self.path else key

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def find(self, *keys: str) -> tuple[str, Any] | None:
        """The path and the value of the one of these keys that is there; CalibrationError when several are."""
        there = [key for key in keys if self.values.get(key) is not None]
        self._taken.update(key for key in keys if key in self.values)
        if len(there) > 1:
            names = " and ".join(self.name(key) for key in there)
            raise CalibrationError(f"{names} are both given; keep the one that is meant")
        return (self.name(there[0]), self.values[there[0]]) if there else None

    def take(self, *keys: str) -> tuple[str, Any]:
        """As `find`; CalibrationError when none is there."""
        found = self.find(*keys)
        if found is None:
            raise CalibrationError(f"{' or '.join(self.name(key) for key in keys)}: missing")
        return found

    def number(self, *keys: str, default: float | None = None) -> float:
        """One number; the default, if any, where none is given."""
        found = self.find(*keys) if default is not None else self.take(*keys)
        if found is None:
            return float(default or 0.0)
        path, value = found
        if isinstance(value, list | dict):
            only = matrix(value, path)[2]
            if len(only) != 1:
                raise CalibrationError(f"{path}: {len(only)} numbers instead of one")
            return only[0]
        return number(value, path)

    def numbers(self, *keys: str) -> tuple[float, ...]:
        """A list or matrix of numbers, row by row."""
        path, value = self.take(*keys)
        return matrix(value, path)[2]

    def text(self, *keys: str) -> str:
        """A word, in lower case with underscores."""
        path, value = self.take(*keys)
        if not isinstance(value, str):
            raise CalibrationError(f"{path}: {value!r} is no name")
        return re.sub(r"[\s-]+", "_", value.strip().lower())

    def section(self, key: str) -> Fields:
        """A mapping inside."""
        path, value = self.take(key)
        if not isinstance(value, dict):
            raise CalibrationError(f"{path}: {_short(value)} instead of named values")
        inside = Fields({str(name): item for name, item in value.items()}, path)
        self._sections.append(inside)
        return inside

    def finish(self) -> None:
        """Refuse what may describe the lens and was not taken."""
        for inside in self._sections:
            inside.finish()
        for key, value in self.values.items():
            if key in self._taken or _ASIDE.fullmatch(key):
                continue
            if _numeric(value) or (_TELLING.fullmatch(key) and value not in (None, "")):
                raise CalibrationError(
                    f"{self.name(key)}: {_short(value)} is not understood, so the lens may be another than it seems; "
                    "take it out of the file if it says nothing about the lens"
                )


def number(value: object, path: str) -> float:
    """A finite number of a plausible size."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{path}: {_short(value)} is no number")
    if not abs(value) <= LARGEST:  # neither is NaN
        raise CalibrationError(f"{path}: {_short(value)} cannot be of a lens")
    return float(value)


def matrix(value: object, path: str) -> tuple[int, int, tuple[float, ...]]:
    """Rows, columns and the numbers row by row of a list, a list of lists, or a matrix of OpenCV or ROS."""
    if isinstance(value, dict):
        if "data" not in value:
            raise CalibrationError(f"{path}: no data in it")
        data = _flat(value["data"], f"{path}.data")
        sides = value["sizes"] if "sizes" in value else [value.get("rows", 1), value.get("cols", len(data))]
        sides = [int(number(side, f"{path}.sizes")) for side in (sides if isinstance(sides, list) else [sides])]
        if min(sides, default=0) < 0 or math.prod(sides) != len(data):
            raise CalibrationError(f"{path}: {len(data)} numbers do not make {'×'.join(map(str, sides))}")
        rows, columns = (1, sides[0]) if len(sides) == 1 else (sides[0], math.prod(sides[1:]))
        return rows, columns, data
    if not isinstance(value, list):
        raise CalibrationError(f"{path}: {_short(value)} instead of a list of numbers")
    data = _flat(value, path)
    rows = [row if isinstance(row, list) else [row] for row in value]
    if sum(map(len, rows)) != len(data) or len({len(row) for row in rows}) > 1:
        raise CalibrationError(f"{path}: rows of different lengths")
    if value and isinstance(value[0], list):
        return len(rows), len(rows[0]), data
    return 1, len(data), data


def _flat(value: object, path: str) -> tuple[float, ...]:
    items = value if isinstance(value, list) else [value]
    numbers: list[float] = []
    for index, item in enumerate(items):
        where = f"{path}[{index}]"
        numbers += _flat(item, where) if isinstance(item, list) else [number(item, where)]
    return tuple(numbers)


def _numeric(value: object) -> bool:
    if isinstance(value, dict):
        return any(_numeric(item) for item in value.values())
    if isinstance(value, list):
        return any(_numeric(item) for item in value)
    return isinstance(value, int | float)


def _short(value: object) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
