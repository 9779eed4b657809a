"""Named places: ``presets.yaml``, beside the settings or as their part ``presets``.

A place is a direction in the fisheye's own frame and a field of view, never pan and tilt: where the head must turn to
look there is computed from the calibration in force whenever it goes, so a rig that is mounted anew keeps its places.
"""

from __future__ import annotations

import difflib
import re
import unicodedata
from collections.abc import Iterable
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct, field

from ptzd.errors import ConfigError

_T = TypeVar("_T")

NAME_CHARACTERS = 64
"""Longest name."""
MOST = 1000
"""Places, patrols, and stays of a patrol."""
DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
MINUTES_A_DAY = 1440
MOST_WINDOWS = 100
_CLOCK = re.compile(r"(?:[01]?[0-9]|2[0-3]):[0-5][0-9]|24:00")
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


class Stay(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One stay of a patrol."""

    place: str
    dwell_s: Annotated[float, Meta(gt=0, le=86_400)]
    """How long the head stays there, from its arrival."""


class Window(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """When a patrol is under way by itself, by the clock of the rig's time zone."""

    patrol: str
    begin: str = field(name="from")
    """``HH:MM``."""
    until: str
    """``HH:MM``; at or before ``from``: on the next day."""
    days: tuple[Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"], ...] = ()
    """On which it begins; none: on every day."""


class Presets(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What is known by name."""

    places: dict[str, Place] = field(default_factory=dict)
    patrols: dict[str, tuple[Stay, ...]] = field(default_factory=dict)
    """Where each patrol goes, in order, again and again."""
    hold_s: Annotated[float, Meta(ge=0, le=86_400)] = 30.0
    """How long the head stays at a place that an operator sent it to before what waits goes on; goto may ask
    otherwise."""
    time_zone: str | None = None
    """Of the schedule, e.g. ``Europe/Berlin``."""
    schedule: tuple[Window, ...] = ()
    """Windows do not overlap."""
    quiet_s: Annotated[float, Meta(ge=0, le=86_400)] = 30.0
    """How long a patrol waits after somebody else moved the camera."""


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
    places = {
        key: _converted(value, Place, f"{name}: places.{key}")
        for key, value in _named(document, "places", name).items()
    }
    patrols = {
        key: _patrol(value, places, f"{name}: patrols.{key}")
        for key, value in _named(document, "patrols", name).items()
    }
    rest = {key: value for key, value in document.items() if key not in {"places", "patrols"}}
    presets = msgspec.structs.replace(_converted(rest, Presets, name), places=places, patrols=patrols)
    _check_schedule(presets, name)
    return presets


def _named(document: dict[object, object], part: str, name: str) -> dict[str, object]:
    found = document.get(part, {})
    if not isinstance(found, dict):
        raise ConfigError(f"{name}: {part}: expected a mapping by name, got {type(found).__name__}")
    if len(found) > MOST:
        raise ConfigError(f"{name}: {part}: {len(found)} of them, at most {MOST}")
    check_names(found, f"{name}: {part}")
    return found


def _patrol(document: object, places: dict[str, Place], where: str) -> tuple[Stay, ...]:
    if not isinstance(document, list | tuple) or not document:
        raise ConfigError(f"{where}: expected a list of stays, each a place and a dwell_s")
    if len(document) > MOST:
        raise ConfigError(f"{where}: {len(document)} stays, at most {MOST}")
    stays = tuple(_converted(item, Stay, f"{where}[{index}]") for index, item in enumerate(document))
    for index, stay in enumerate(stays):
        if stay.place not in places:
            raise ConfigError(f"{where}[{index}].place: no place {stay.place!r}; {nearest_names(stay.place, places)}")
    return stays


def minutes(clock: str) -> int:
    """Minutes since midnight of a time ``HH:MM``; ``24:00`` is 1440.

    Raises
    ------
    ValueError
        When it is none.
    """
    if _CLOCK.fullmatch(clock) is None:
        raise ValueError(f"{clock!r} is no time of day; write HH:MM, 00:00 to 24:00")
    hours, _, rest = clock.partition(":")
    return 60 * int(hours) + int(rest)


def _check_schedule(presets: Presets, name: str) -> None:
    """Refuse windows that are none, of patrols that are none, or that overlap."""
    if presets.schedule and presets.time_zone is None:
        raise ConfigError(f"{name}: time_zone: missing; the schedule's times are of which place, e.g. Europe/Berlin?")
    if len(presets.schedule) > MOST_WINDOWS:
        raise ConfigError(f"{name}: schedule: {len(presets.schedule)} windows, at most {MOST_WINDOWS}")
    taken: list[tuple[int, int, int]] = []
    for index, window in enumerate(presets.schedule):
        where = f"{name}: schedule[{index}]"
        if window.patrol not in presets.patrols:
            known = nearest_names(window.patrol, presets.patrols)
            raise ConfigError(f"{where}.patrol: no patrol {window.patrol!r}; {known}")
        for first, last in _of_the_week(window, where):
            for begin, end, other in taken:
                if first < end and begin < last:
                    raise ConfigError(
                        f"{where}: {_in_words(window)} overlaps with {_in_words(presets.schedule[other])} "
                        f"(schedule[{other}]); one patrol at a time"
                    )
            taken.append((first, last, index))


def _of_the_week(window: Window, where: str) -> list[tuple[int, int]]:
    """Minutes of the week that a window takes, cut at its end."""
    try:
        begin, until = minutes(window.begin), minutes(window.until)
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None
    if begin in {MINUTES_A_DAY, until}:
        raise ConfigError(
            f"{where}: from {window.begin} until {window.until} is no window; a whole day is 00:00 to 24:00"
        )
    if len(set(window.days)) < len(window.days):
        raise ConfigError(f"{where}.days: a day is given twice")
    length = until - begin if until > begin else until + MINUTES_A_DAY - begin
    week = 7 * MINUTES_A_DAY
    found = []
    for day in window.days or DAYS:
        first = DAYS.index(day) * MINUTES_A_DAY + begin
        found += [(first, min(first + length, week))]
        if first + length > week:
            found += [(0, first + length - week)]
    return found


def _in_words(window: Window) -> str:
    days = f" on {', '.join(window.days)}" if window.days else ""
    return f"patrol {window.patrol} from {window.begin} until {window.until}{days}"


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
