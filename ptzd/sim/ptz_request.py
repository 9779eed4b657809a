"""The arguments of ptz.cgi: names, values and ranges, checked before anything moves. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

MOVES = ("home", "up", "down", "left", "right", "upleft", "upright", "downleft", "downright", "stop")
QUERIES = (
    "speed", "position", "limits", "mode", "presetposall", "presetposcam", "presetposcamdata", "auxiliary",
    "attributes",
)  # fmt: skip
DIGITAL_ZOOM_MAX = 19999


class PtzSyntax(Exception):
    """An argument that the camera does not take.

    Parameters
    ----------
    argument : str
    text : str
        What is wrong, in the camera's words.
    """

    def __init__(self, argument: str, text: str) -> None:
        super().__init__(f"{argument}: {text}")


Value = float | int | str | bool | tuple[float, ...] | tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class PtzRequest:
    """Checked arguments by name; absent ones are absent."""

    values: dict[str, Value] = field(default_factory=dict)

    @property
    def only_asks(self) -> bool:
        """Whether nothing is to be moved or set."""
        return self.values.keys() <= {"camera", "query", "whoami", "info", "format", "group"}

    def number(self, name: str) -> float | None:
        """A number, or None when absent."""
        value = self.values.get(name)
        return value if isinstance(value, int | float) and not isinstance(value, bool) else None

    def numbers(self, name: str) -> tuple[float, ...] | None:
        """A list of numbers, or None when absent."""
        value = self.values.get(name)
        return tuple(float(item) for item in value) if isinstance(value, tuple) else None

    def text(self, name: str) -> str | None:
        """A word, or None when absent."""
        value = self.values.get(name)
        return value if isinstance(value, str) else None

    def words(self, name: str) -> tuple[str, ...]:
        """A list of words, empty when absent."""
        value = self.values.get(name)
        return tuple(str(item) for item in value) if isinstance(value, tuple) else ()


Check = Callable[[str], Value]


def _number(low: float, high: float) -> Check:
    def check(text: str) -> float:
        value = float(text)
        if not low <= value <= high:
            raise ValueError(text)
        return value

    return check


def _whole(low: int, high: int) -> Check:
    def check(text: str) -> int:
        value = float(text)
        if not math.isfinite(value) or not low <= math.trunc(value) <= high:
            raise ValueError(text)
        return math.trunc(value)

    return check


def _word(*allowed: str) -> Check:
    def check(text: str) -> str:
        if text not in allowed:
            raise ValueError(text)
        return text

    return check


def _list(*checks: Check) -> Check:
    def check(text: str) -> tuple[float, ...]:
        parts = text.split(",")
        if len(parts) != len(checks):
            raise ValueError(text)
        return tuple(float(str(check(part))) for check, part in zip(checks, parts, strict=True))

    return check


def _text(text: str) -> str:
    if not text:
        raise ValueError(text)
    return text


def _queries(text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    for name in names:
        if name not in QUERIES:
            raise PtzSyntax("query", f"unknown value: {name}")
    return names


_YES = _word("1", "yes", "true")
_ON_OFF = _word("on", "off")
_PERCENT = _number(-100, 100)
_PIXEL = _number(-1e5, 1e5)
_STEP = _whole(1, 9999)
_STEPS = _whole(-9999, 9999)
_ZOOM = _whole(1, DIGITAL_ZOOM_MAX)
_ZOOM_STEPS = _whole(-DIGITAL_ZOOM_MAX, DIGITAL_ZOOM_MAX)

ARGUMENTS: dict[str, Check] = {
    "camera": _text,
    "whoami": _YES,
    "info": _YES,
    "center": _list(_PIXEL, _PIXEL),
    "areazoom": _list(_PIXEL, _PIXEL, _number(1, 1e6)),
    "imagewidth": _whole(1, 100_000),
    "imageheight": _whole(1, 100_000),
    "imagerotation": _word("0", "90", "180", "270"),
    "move": _word(*MOVES),
    "pan": _number(-180, 180),
    "tilt": _number(-180, 180),
    "zoom": _ZOOM,
    "focus": _STEP,
    "iris": _STEP,
    "brightness": _STEP,
    "rpan": _number(-360, 360),
    "rtilt": _number(-360, 360),
    "rzoom": _ZOOM_STEPS,
    "rfocus": _STEPS,
    "riris": _STEPS,
    "rbrightness": _STEPS,
    "autofocus": _ON_OFF,
    "autoiris": _ON_OFF,
    "continuouspantiltmove": _list(_PERCENT, _PERCENT),
    "continuouszoommove": _PERCENT,
    "continuousfocusmove": _PERCENT,
    "continuousirismove": _PERCENT,
    "continuousbrightnessmove": _PERCENT,
    "proportionalspeed": _word("enabled", "disabled"),
    "auxiliary": _text,
    "setserverpresetname": _text,
    "setserverpresetno": _whole(1, 256),
    "removeserverpresetname": _text,
    "removeserverpresetno": _whole(1, 256),
    "gotoserverpresetname": _text,
    "gotoserverpresetno": _whole(1, 256),
    "gotodevicepreset": _whole(1, 256),
    "speed": _whole(1, 100),
    "ircutfilter": _word("auto", "on", "off"),
    "backlight": _ON_OFF,
    "query": _queries,
    "format": _word("json"),
    "group": _word("zoom", "focus", "speed", "speeddry"),
}
IGNORED = frozenset({"html", "timestamp"})
"""Undocumented arguments that Axis' own page sends."""


def parse(pairs: Iterable[tuple[str, str]], *, cameras: int = 1, zoom_max: int = 9999) -> PtzRequest:
    """Check name-value pairs in their order; the last of equal names counts.

    Raises
    ------
    PtzSyntax
        For the first argument that is unknown or has a value out of its range.
    """
    values: dict[str, Value] = {}
    for name, text in pairs:
        if name in IGNORED:
            continue
        if name not in ARGUMENTS:
            raise PtzSyntax(name, "unknown argument")
        try:
            values[name] = ARGUMENTS[name](text)
        except ValueError:
            raise PtzSyntax(name, "invalid value") from None
    _check_camera(values, cameras)
    for name in ("zoom", "rzoom"):
        value = values.get(name)
        if isinstance(value, int) and abs(value) > zoom_max:
            raise PtzSyntax(name, "invalid value")
    return PtzRequest(values=values)


def _check_camera(values: dict[str, Value], cameras: int) -> None:
    camera = str(values.get("camera", "1"))
    lists_all = camera == "all" and "query" in values
    if not lists_all and not (camera.isdecimal() and 1 <= int(camera) <= cameras):
        raise PtzSyntax("camera", "invalid value")
