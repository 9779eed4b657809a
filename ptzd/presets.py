"""Named places: ``presets.yaml``, beside the settings or as their part ``presets``.

A place is a direction in the fisheye's own frame and a field of view, never pan and tilt: where the head must turn to
look there is computed from the calibration in force whenever it goes, so a rig that is mounted anew keeps its places.
"""

from __future__ import annotations

import difflib
import unicodedata
from collections.abc import Iterable
from typing import Annotated, TypeVar

import msgspec
from msgspec import Meta, Struct, field

from ptzd.errors import ConfigError

_T = TypeVar("_T")

NAME_CHARACTERS = 64
"""Longest name."""
MOST = 1000
"""Places of one rig."""
NEAREST = 3
"""Names that a refusal offers."""


class Place(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where to look, seen from the head, and how wide."""

    azimuth_deg: Annotated[float, Meta(ge=-180, le=180)]
    """From the fisheye's optical axis to the right in its picture, deg."""
    elevation_deg: Annotated[float, Meta(ge=-90, le=90)]
    """Upwards in its picture, deg: ``bearing(azimuth, elevation)`` of `geometry.sphere` in the fisheye's frame."""
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)]
    """Horizontal field of view, deg."""


class Presets(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is known by name."""

    places: dict[str, Place] = field(default_factory=dict)
    hold_s: Annotated[float, Meta(ge=0, le=86_400)] = 30.0
    """How long the head stays at a place that an operator sent it to before what waits goes on; goto may ask
    otherwise."""


def parse_presets(document: object, name: str) -> Presets:
    """Turn a parsed document into places.

    Parameters
    ----------
    document : object
        What the YAML parser returned; None and ``{}`` are no places.
    name : str
        File name, and the path inside it, for messages.

    Raises
    ------
    ConfigError
        With the path of the culprit, e.g. ``presets.yaml: places.gate.hfov_deg: Expected `float` > 0.0``.
    """
    if document is None:
        document = {}
    if not isinstance(document, dict):
        raise ConfigError(f"{name}: expected places by name, got {type(document).__name__}")
    places = document.get("places", {})
    if not isinstance(places, dict):
        raise ConfigError(f"{name}: places: expected a mapping of names to places, got {type(places).__name__}")
    if len(places) > MOST:
        raise ConfigError(f"{name}: places: {len(places)} of them, at most {MOST}")
    check_names(places, f"{name}: places")
    found = {key: _converted(value, Place, f"{name}: places.{key}") for key, value in places.items()}
    rest = {key: value for key, value in document.items() if key != "places"}
    return msgspec.structs.replace(_converted(rest, Presets, name), places=found)


def check_names(names: Iterable[object], where: str) -> None:
    """Refuse names that cannot be said, and two that a person takes for one.

    Raises
    ------
    ConfigError
        With the name.
    """
    alike: dict[str, str] = {}
    for name in names:
        if not isinstance(name, str):
            raise ConfigError(f"{where}: {name!r} is no text; put the name into quotes")
        if not is_name(name):
            message = (
                f"{where}: {name[:80]!r}: a name is 1 to {NAME_CHARACTERS} printable characters, begins with a letter "
                "or a digit and does not end in a space"
            )
            raise ConfigError(message)
        other = alike.setdefault(folded(name), name)
        if other != name:
            raise ConfigError(f"{where}: {name!r} and {other!r} are too alike to tell apart; rename one")


def is_name(name: str) -> bool:
    """Whether a place may be called so."""
    return 0 < len(name) <= NAME_CHARACTERS and name.isprintable() and name[0].isalnum() and not name[-1].isspace()


def folded(name: str) -> str:
    """What is left of a name when neither case nor the way its letters are composed counts."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def nearest_names(name: str, known: Iterable[str]) -> str:
    """The known names that resemble one that is not, as the end of a sentence."""
    by_folded = {folded(other): other for other in known}
    if not by_folded:
        return "there are none; write them into presets.yaml"
    close = difflib.get_close_matches(folded(name), by_folded, n=NEAREST, cutoff=0.5)
    if close:
        return f"nearest: {', '.join(by_folded[other] for other in close)}"
    shown = list(by_folded.values())
    more = f" and {len(shown) - NEAREST} more" if len(shown) > NEAREST else ""
    return f"there are {', '.join(shown[:NEAREST])}{more}"


def _converted(value: object, kind: type[_T], where: str) -> _T:
    try:
        return msgspec.convert(value, kind, strict=True)
    except msgspec.ValidationError as error:
        text, _, path = str(error).partition(" - at `")
        path = path.rstrip("`").removeprefix("$")
        raise ConfigError(f"{where}{path}: {text}") from None
