"""What is known of the head, and what it, its lens and the matchers were asked for: plain values for the snapshot."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from ptzd.control.doubts import Doubts
from ptzd.control.motor import Travel
from ptzd.control.planning.span import Span
from ptzd.model import HeadLimits, HeadReading, HeadSpeed, HomeAfter, Lens, Motion


class Awaited(StrEnum):
    """What was asked for."""

    MOVE = "move"
    GRAB = "grab"
    MATCH = "match"


@dataclass(slots=True, kw_only=True)
class HeadWork:
    """The one thing the head is asked to do."""

    kind: Awaited
    id: int
    until_ns: int
    way: list[HeadReading] = field(default_factory=list)
    """Set points of a move that come after the one it is on its way to, around a zone."""


@dataclass(slots=True, kw_only=True)
class MatchWork:
    """A match under way."""

    id: int
    view: int
    """Index of the view among those of the activity."""
    until_ns: int


@dataclass(slots=True, kw_only=True)
class LensWork:
    """A focus or iris under way."""

    id: int
    token: int | None
    lens: Lens
    until_ns: int


@dataclass(slots=True, kw_only=True)
class HeadState:
    """What is known of the head, and what it and the matcher were asked for."""

    limits: HeadLimits | None = None
    reading: HeadReading | None = None
    motion: Motion = Motion.UNKNOWN
    held: bool = False
    """An operator keeps it where it is: no claim begins, and no hold ends."""
    home_after: HomeAfter | None = None
    """How long it is left where it is, where somebody said so; None: as the settings say."""
    asked: HeadWork | None = None
    matches: list[MatchWork] = field(default_factory=list)
    going: int | None = None
    """The move that was sent last, while nobody has said where it led."""
    travel: Travel = field(default_factory=Travel)
    lenses: list[LensWork] = field(default_factory=list)
    by_hand: Lens = field(default_factory=Lens)
    """What the camera does not set for itself."""
    left: HeadReading | None = None
    """Where it rested when the move under way was sent; None where it did not."""
    headed: HeadReading | None = None
    """Set point of that move."""
    doubts: Doubts = field(default_factory=Doubts)
    moved_ns: int = 0
    """When the last move was asked for: a picture at rest after it shows where it led."""
    next_id: int = 1
    span: Span | None = None
    """Where it may be by what it was told, kept while there are no-go zones; None: where it was reported last."""
    bound_for: HeadReading | None = None
    """Set point of the last move."""
    steered: HeadSpeed | None = None
    """The speed it was told last, as long as it is not known to rest."""
    unsure_ns: int = 0
    """Reports of rest from then on are of the rest after the last order."""
