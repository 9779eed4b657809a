"""Exact, reversible JSON for events and commands, driven by their dataclass definitions.

A body is a JSON object with one member per field. What JSON lacks is stated once, here:

==================  =====================================================================
float, not finite   ``{"$float": "inf" | "-inf" | "nan"}``
typed tuple         array
tuple in ``object``  ``{"$tuple": [...]}``, so that it does not come back as a list
enum                its value
nested dataclass    object with one member per field
==================  =====================================================================

Finite floats are written with the fewest digits that read back to the same bits.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import types
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum

import msgspec

from ptzd.control import commands as _commands
from ptzd.control import events as _events
from ptzd.control.commands import Command
from ptzd.control.events import Event
from ptzd.errors import LogError
from ptzd.log.migrations import SCHEMA_VERSION, Body, steps_from


@dataclass(frozen=True, slots=True)
class _Codec:
    """Both ways of one type; ``path`` names the place in messages."""

    encode: Callable[[object, str], object]
    decode: Callable[[object, str], object]


def _registry(root: type, module: types.ModuleType) -> dict[str, type]:
    found = {kind.__name__: kind for kind in vars(module).values() if isinstance(kind, type) and issubclass(kind, root)}
    del found[root.__name__]
    return found


EVENTS: Mapping[str, type[Event]] = _registry(Event, _events)
COMMANDS: Mapping[str, type[Command]] = _registry(Command, _commands)


def encode(value: Event | Command) -> tuple[str, bytes]:
    """Name of the class and its JSON body.

    Raises
    ------
    LogError
        A field holds what its type does not allow; the message names it.
    """
    name = type(value).__name__
    if name not in EVENTS and name not in COMMANDS:
        raise LogError(f"{name}: not an event or command of ptzd; define it in ptzd.control")
    return name, msgspec.json.encode(_codec(typing.cast("object", type(value))).encode(value, name))


def decode_event(name: str, body: bytes | str, version: int = SCHEMA_VERSION) -> Event:
    """Reverse of :func:`encode` for events.

    Parameters
    ----------
    name : str
        Name of the event's class.
    body : bytes or str
        JSON object.
    version : int
        Schema version that the body was written with; older ones are led to the present one step by step.

    Raises
    ------
    LogError
        Unknown class or field, a missing or impossible value, a version from the future: the message names it.
    """
    return typing.cast("Event", _decode(EVENTS, "event", name, body, version))


def decode_command(name: str, body: bytes | str, version: int = SCHEMA_VERSION) -> Command:
    """Reverse of :func:`encode` for commands; parameters and errors as for :func:`decode_event`."""
    return typing.cast("Command", _decode(COMMANDS, "command", name, body, version))


def _decode(
    known: Mapping[str, type],
    what: str,
    name: str,
    body: bytes | str,
    version: int,
) -> object:
    try:
        document = msgspec.json.decode(body)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise LogError(f"{what} {name}: the body is no JSON: {error}") from None
    if not isinstance(document, dict):
        raise LogError(f"{what} {name}: the body must be a JSON object, got {type(document).__name__}")
    name, document = _migrate(name, document, version)
    kind = known.get(name)
    if kind is None:
        raise LogError(
            f"{what} {name!r} is unknown to this ptzd (schema {SCHEMA_VERSION}); use the one that wrote the log"
        )
    return _codec(kind).decode(document, name)


def _migrate(name: str, body: Body, version: int) -> tuple[str, Body]:
    try:
        for step in steps_from(version):
            name, body = step.decision(name, body)
    except LogError as error:
        raise LogError(f"{name}: {error}") from None
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise LogError(f"{name}: not as schema version {version} has it: {type(error).__name__} {error}") from None
    return name, body


@functools.cache
def _codec(hint: object) -> _Codec:
    """Codec of a type hint as dataclass fields use them."""
    if hint in _PLAIN:
        return _PLAIN[hint]
    origin = typing.get_origin(hint)
    if origin in _COMPOSED:
        return _COMPOSED[origin](hint)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return _enum(hint)
    if isinstance(hint, type) and dataclasses.is_dataclass(hint):
        return _dataclass(hint)
    raise LogError(
        f"a field of type {hint} has no place in the log; use numbers, strings, tuples, enums or dataclasses"
    )


def _wrong(path: str, wanted: str, value: object) -> LogError:
    return LogError(f"{path}: expected {wanted}, got {type(value).__name__} {str(value)[:60]!r}")


def _scalar(kind: type) -> _Codec:
    def check(value: object, path: str) -> object:
        if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
            raise _wrong(path, kind.__name__, value)
        return value

    return _Codec(check, check)


def _float_to_json(value: object, path: str) -> object:
    if not isinstance(value, float | int) or isinstance(value, bool):
        raise _wrong(path, "float", value)
    number = float(value)
    return number if math.isfinite(number) else {"$float": str(number)}


def _float_from_json(value: object, path: str) -> object:
    if isinstance(value, dict) and value.keys() == {"$float"} and value["$float"] in {"inf", "-inf", "nan"}:
        return float(value["$float"])
    if not isinstance(value, float | int) or isinstance(value, bool):
        raise _wrong(path, "float", value)
    try:
        return float(value)
    except OverflowError:
        raise _wrong(path, "float", value) from None


def _free_to_json(value: object, path: str) -> object:
    """Content of a field typed ``object``: what JSON has, and tuples."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return _float_to_json(value, path)
    if isinstance(value, tuple):
        return {"$tuple": [_free_to_json(item, f"{path}[{index}]") for index, item in enumerate(value)]}
    if isinstance(value, list):
        return [_free_to_json(item, f"{path}[{index}]") for index, item in enumerate(value)]
    if isinstance(value, dict):
        if not all(isinstance(key, str) and not key.startswith("$") for key in value):
            raise LogError(f"{path}: keys must be strings that do not start with $, got {list(value)!r}")
        return {key: _free_to_json(item, f"{path}.{key}") for key, item in value.items()}
    raise _wrong(path, "a JSON value", value)


def _free_from_json(value: object, path: str) -> object:
    if isinstance(value, list):
        return [_free_from_json(item, f"{path}[{index}]") for index, item in enumerate(value)]
    if not isinstance(value, dict):
        return value
    if "$float" in value:
        return _float_from_json(value, path)
    if "$tuple" in value:
        items = value["$tuple"]
        if len(value) > 1 or not isinstance(items, list):
            raise _wrong(path, '{"$tuple": [...]}', value)
        return tuple(_free_from_json(item, f"{path}[{index}]") for index, item in enumerate(items))
    return {key: _free_from_json(item, f"{path}.{key}") for key, item in value.items()}


def _enum(kind: type[Enum]) -> _Codec:
    def to_json(value: object, path: str) -> object:
        if not isinstance(value, kind):
            raise _wrong(path, kind.__name__, value)
        return value.value

    def from_json(value: object, path: str) -> object:
        try:
            return kind(value)
        except ValueError:
            raise _wrong(path, "one of " + ", ".join(str(member.value) for member in kind), value) from None

    return _Codec(to_json, from_json)


def _optional(hint: object) -> _Codec:
    inner = [argument for argument in typing.get_args(hint) if argument is not type(None)]
    if len(inner) != 1:
        raise LogError(f"a field of type {hint} has no place in the log; of unions only `X | None` is written")
    codec = _codec(inner[0])
    return _Codec(
        lambda value, path: None if value is None else codec.encode(value, path),
        lambda value, path: None if value is None else codec.decode(value, path),
    )


def _tuple(hint: object) -> _Codec:
    arguments = typing.get_args(hint)
    endless = arguments[-1] is Ellipsis
    codecs = [_codec(argument) for argument in arguments if argument is not Ellipsis]

    def items(value: object, kind: type, path: str) -> list[tuple[_Codec, object, str]]:
        if not isinstance(value, kind) or not (endless or len(value) == len(codecs)):  # type: ignore[arg-type]
            raise _wrong(path, "a series" if endless else f"{len(codecs)} values", value)
        series = list(typing.cast("typing.Iterable[object]", value))
        return [(codecs[0 if endless else i], item, f"{path}[{i}]") for i, item in enumerate(series)]

    return _Codec(
        lambda value, path: [codec.encode(item, where) for codec, item, where in items(value, tuple, path)],
        lambda value, path: tuple(codec.decode(item, where) for codec, item, where in items(value, list, path)),
    )


def _mapping(hint: object) -> _Codec:
    if typing.get_args(hint) != (str, object):
        raise LogError(f"a field of type {hint} has no place in the log; use dict[str, object]")

    def checked(convert: Callable[[object, str], object]) -> Callable[[object, str], object]:
        def run(value: object, path: str) -> object:
            done = convert(value, path)
            if not isinstance(value, dict) or not isinstance(done, dict):
                raise _wrong(path, "a mapping", value)
            return done

        return run

    return _Codec(checked(_free_to_json), checked(_free_from_json))


def _dataclass(kind: type) -> _Codec:
    hints = typing.get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    codecs = {name: _codec(hints[name]) for name in fields}
    needed = {
        name
        for name, field in fields.items()
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    }

    def to_json(value: object, path: str) -> object:
        if type(value) is not kind:
            raise _wrong(path, kind.__name__, value)
        return {name: codec.encode(getattr(value, name), f"{path}.{name}") for name, codec in codecs.items()}

    def from_json(value: object, path: str) -> object:
        if not isinstance(value, dict):
            raise _wrong(path, f"an object ({kind.__name__})", value)
        if unknown := sorted(value.keys() - codecs.keys()):
            raise LogError(f"{path}: unknown field {unknown[0]!r}; the log was written by another version")
        if missing := sorted(needed - value.keys()):
            raise LogError(f"{path}: field {missing[0]!r} is missing; the log was written by another version")
        arguments = {name: codecs[name].decode(item, f"{path}.{name}") for name, item in value.items()}
        try:
            return kind(**arguments)
        except ValueError as error:
            raise LogError(f"{path}: {error}") from None

    return _Codec(to_json, from_json)


_PLAIN: Mapping[object, _Codec] = {
    object: _Codec(_free_to_json, _free_from_json),
    float: _Codec(_float_to_json, _float_from_json),
    int: _scalar(int),
    str: _scalar(str),
    bool: _scalar(bool),
}
_COMPOSED: Mapping[object, Callable[[object], _Codec]] = {
    typing.Union: _optional,
    types.UnionType: _optional,
    tuple: _tuple,
    dict: _mapping,
}
