"""What a value of the settings may be: ranges by type, and the checks that a type cannot say."""

from __future__ import annotations

import math
import re
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, Struct

from ptzd.errors import ConfigError

DAY_S = 86_400.0
Seconds = Annotated[float, Meta(ge=0, le=DAY_S)]
PositiveSeconds = Annotated[float, Meta(gt=0, le=DAY_S)]
Rate = Annotated[float, Meta(gt=0, le=1000)]
"""Per second."""
PositiveSpeed = Annotated[float, Meta(gt=0, le=1000)]
Degrees = Annotated[float, Meta(gt=0, le=360)]
Pixels = Annotated[int, Meta(ge=16, le=65_535)]
Size = tuple[Pixels, Pixels]
Bytes = Annotated[int, Meta(ge=1_000_000, le=1 << 50)]
Word = Annotated[int, Meta(ge=-(1 << 31), le=(1 << 31) - 1)]
"""What one driver control takes."""
Share = Annotated[float, Meta(ge=0.05, le=0.95)]
Probability = Annotated[float, Meta(ge=0, le=1)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9._-]{1,64}$(?!\n)")]
Interval = tuple[float, float]
Angle = Annotated[float, Meta(ge=-720, le=720)]
ZoomUnit = Annotated[float, Meta(ge=0, le=100_000)]
FARTHEST_M = 1e6


class Part(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What all parts share: frozen, keyword-only, unknown keys refused."""


_T = TypeVar("_T")


def converted(document: object, kind: type[_T], name: str) -> _T:
    """Build a settings class from parsed YAML; ConfigError with the path of the culprit."""
    try:
        return msgspec.convert(document, kind, strict=True)
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at `")
        raise ConfigError(f"{name}: {path.rstrip('`').removeprefix('$.') or '(top level)'}: {text}") from None


ENDLESS = re.compile(r"(search|zones\[\d+\])\.range_m\[1\]")
"""The only numbers that may be infinite: the far ends of ranges."""


def refuse_not_finite(value: object, name: str, path: str) -> None:
    """Raise ConfigError for a number that is none, or is infinite where it must not be."""
    if isinstance(value, float) and (
        math.isnan(value) or (math.isinf(value) and (value < 0 or not ENDLESS.fullmatch(path)))
    ):
        raise ConfigError(f"{name}: {path}: {value} is no number that can be used here; give a finite one")
    if isinstance(value, dict):
        for key, item in value.items():
            refuse_not_finite(item, name, f"{path}.{key}".removeprefix("."))
    if isinstance(value, list):
        for index, item in enumerate(value):
            refuse_not_finite(item, name, f"{path}[{index}]")


def check_order(interval: Interval, where: str) -> None:
    """Raise ConfigError unless the first value is below the second."""
    low, high = interval
    if low >= high:
        raise ConfigError(f"{where}: the first value must be below the second, got {low}, {high}")


def check_range(range_m: Interval, where: str) -> None:
    """Raise ConfigError unless it is an interval of ranges that can be looked at."""
    check_order(range_m, where)
    near, far = range_m
    if near <= 0:
        raise ConfigError(f"{where}: the nearest range must be above 0, got {near}")
    if near < 1 / FARTHEST_M or (far > FARTHEST_M and not math.isinf(far)):
        raise ConfigError(f"{where}: {near:g} to {far:g} is beyond {1 / FARTHEST_M:g} to {FARTHEST_M:g}")
