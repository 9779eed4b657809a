"""Field by field comparison of commands and results, exact or within a written tolerance."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Tolerance:
    """What may differ between machines whose arithmetic differs in the last bits.

    Measured with OpenCV's and numpy's dispatch to other CPU features: homographies move by up to 0.7 px, which at the
    scale of a fisheye is below 0.2°; probabilities and scores follow.
    """

    relative: float
    absolute: float


EXACT = Tolerance(relative=0.0, absolute=0.0)
ACROSS_MACHINES = Tolerance(relative=1e-3, absolute=0.2)
IGNORED = frozenset({"elapsed_ms"})
"""Time that a matcher took; no decision looks at it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Difference:
    """One field that differs."""

    sequence: int
    path: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        return f"event {self.sequence}: {self.path}: recorded {self.recorded}, replayed {self.replayed}"


def differences(path: str, recorded: object, replayed: object, tolerance: Tolerance) -> list[tuple[str, str, str]]:
    """Compare two values of dataclasses, tuples, dicts and plain values.

    Returns
    -------
    list of (path, recorded, replayed)
        Empty when equal within the tolerance.
    """
    if dataclasses.is_dataclass(recorded) and not isinstance(recorded, type) and type(recorded) is type(replayed):
        return [
            found
            for field in dataclasses.fields(recorded)
            if field.name not in IGNORED
            for found in differences(
                f"{path}.{field.name}", getattr(recorded, field.name), getattr(replayed, field.name), tolerance
            )
        ]
    if isinstance(recorded, dict) and isinstance(replayed, dict) and recorded.keys() == replayed.keys():
        return [
            found
            for key, value in recorded.items()
            if key not in IGNORED
            for found in differences(f"{path}.{key}", value, replayed[key], tolerance)
        ]
    if isinstance(recorded, tuple | list) and isinstance(replayed, tuple | list) and len(recorded) == len(replayed):
        return [
            found
            for index, (one, other) in enumerate(zip(recorded, replayed, strict=True))
            for found in differences(f"{path}[{index}]", one, other, tolerance)
        ]
    if _same(recorded, replayed, tolerance):
        return []
    return [(path, _shown(recorded), _shown(replayed))]


def _same(one: object, other: object, tolerance: Tolerance) -> bool:
    if isinstance(one, float) and isinstance(other, float | int):
        return one == other or math.isclose(one, other, rel_tol=tolerance.relative, abs_tol=tolerance.absolute)
    return bool(one == other)


def _shown(value: object) -> str:
    text = type(value).__name__ if dataclasses.is_dataclass(value) else repr(value)
    return text if len(text) <= 80 else f"{text[:77]}…"
