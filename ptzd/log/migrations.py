"""Logs of older versions are read in small steps, each from one schema version to the next.

When a change makes an older event, command or setting unreadable: raise :data:`SCHEMA_VERSION` by one, and write the
step from the version before it into :data:`STEPS`. Snapshots are events, so a step turns the state inside them as well.
New classes and new fields with a default need neither. ``rig.yaml`` has a version of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from ptzd.errors import LogError
from ptzd.log import claims, regions

SCHEMA_VERSION = 6
"""Of events, commands and settings as they are written; in the metadata ``ptzd.run`` of every file."""

Body = dict[str, object]


def _same_decision(name: str, body: Body) -> tuple[str, Body]:
    return name, body


def _same_settings(settings: Body) -> Body:
    return settings


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """From one version to the next."""

    decision: Callable[[str, Body], tuple[str, Body]] = _same_decision
    """Name and JSON body of an event or command."""
    settings: Callable[[Body], Body] = _same_settings
    """The parsed ``config.yaml``."""


def _claims(name: str, body: Body) -> tuple[str, Body]:
    """1 to 2: what the core remembers of states, queue, request and homing is who holds the head and who waits."""
    return name, {**body, "state": claims.of_states(body)} if name == "Snapshot" else body


def _stamped_once(name: str, body: Body) -> tuple[str, Body]:
    """2 to 3: when an event was told stands beside its body alone, as that of its commands does."""
    return name, {field: value for field, value in body.items() if field != "t_ns"}


def _regions(name: str, body: Body) -> tuple[str, Body]:
    """3 to 4: in a snapshot, a request's box and frame are one region, and so are those of its newest update."""
    return name, {**body, "state": regions.of_requests(body["state"])} if name == "Snapshot" else body


def _without_ranges(settings: Body) -> Body:
    """4 to 5: locks taught nothing of the scene's ranges."""
    return {**settings, "ranges": {"learn": False}}


def _unspared(settings: Body) -> Body:
    """5 to 6: every move was driven, however small."""
    return {**settings, "motor": {"dead_zone_deg": 0.0}}


STEPS: Mapping[int, Step] = {
    1: Step(decision=_claims),
    2: Step(decision=_stamped_once),
    3: Step(decision=_regions),
    4: Step(settings=_without_ranges),
    5: Step(settings=_unspared),
}
"""By the version they start from."""


def steps_from(version: int) -> Iterator[Step]:
    """Steps that lead from a version to the present one.

    Raises
    ------
    LogError
        The version is from the future, or a step is missing.
    """
    if not 1 <= version <= SCHEMA_VERSION:
        raise LogError(f"schema version {version} is not one of 1 to {SCHEMA_VERSION}; use a newer ptzd")
    for number in range(version, SCHEMA_VERSION):
        if number not in STEPS:
            raise LogError(
                f"no step leads from schema version {number} to {number + 1}; use the ptzd that wrote the log"
            )
        yield STEPS[number]


def settings_now(settings: object, version: int) -> object:
    """Settings of a log as the present version names them; errors as for :func:`steps_from`."""
    for step in steps_from(version):
        if isinstance(settings, dict):
            settings = step.settings(settings)
    return settings
