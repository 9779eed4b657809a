"""Everything the core remembers: plain values, so that a snapshot at the head of a log file carries it all."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from ptzd.control.commands import PublishStatus
from ptzd.control.events import ZoomWish
from ptzd.control.states import State
from ptzd.model import Box, Candidate, FrameRef, HeadLimits, HeadReading, MatchResult, Motion, ViewRef


class Phase(StrEnum):
    """Steps inside a request."""

    NONE = ""
    SCANNING = "scanning"
    MATCHING = "matching"
    CENTRING = "centring"
    ZOOMING = "zooming"
    HOLDING = "holding"
    REACQUIRING = "reacquiring"


class Awaited(StrEnum):
    """What the head was asked last."""

    MOVE = "move"
    GRAB = "grab"


@dataclass(slots=True, kw_only=True)
class Request:
    """An accepted request."""

    id: str
    label: str
    priority: int
    box: Box
    frame: FrameRef
    inverse_range: tuple[float, float]
    """1/m or 1/baseline, far end first."""
    zoom: ZoomWish
    hfov_deg: float | None
    fill: float
    hold_ns: int
    accepted_ns: int
    expires_ns: int
    """To be locked by then."""
    newer_box: Box | None = None
    """The newest update; waits for the look under way, or for the lock to begin."""
    newer_frame: FrameRef | None = None
    pinned: list[FrameRef] = field(default_factory=list)
    """Frames whose bytes are kept for the request."""

    def adopt_newest(self) -> bool:
        """Take over the newest update, if one waits."""
        if self.newer_box is None or self.newer_frame is None:
            return False
        self.box, self.frame = self.newer_box, self.newer_frame
        self.newer_box = self.newer_frame = None
        return True


@dataclass(slots=True, kw_only=True)
class HeadWork:
    """The one thing the head is asked to do."""

    kind: Awaited
    id: int
    until_ns: int


@dataclass(slots=True, kw_only=True)
class MatchWork:
    """A match under way."""

    id: int
    view: int
    """Index into :attr:`ScanMemory.taken`; 0 in a lock."""
    until_ns: int


@dataclass(slots=True, kw_only=True)
class ViewMatch:
    """A match that came in."""

    view: int
    result: MatchResult


@dataclass(slots=True, kw_only=True)
class ScanMemory:
    """Where the scan stands."""

    round: int
    views: list[HeadReading]
    next_view: int = 0
    taken: list[ViewRef] = field(default_factory=list)
    matches: list[ViewMatch] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What went wrong with single views."""


@dataclass(slots=True, kw_only=True)
class LockMemory:
    """Where the lock stands."""

    phase: Phase
    place: Candidate
    probability: float
    sigma_deg: float
    wide_zoom: float
    """Zoom at which the region was found; re-acquisition goes back to it."""
    zoom: float
    """Zoom of the present step."""
    corrections: int = 0
    may_zoom: bool = True
    """False after a verification at the asked zoom failed, and for a target that cannot be centred."""
    off_centre: bool = False
    """The head's limits keep the target off the picture's centre."""
    confirmed: bool = False
    confirmed_ns: int = 0
    """When a picture confirmed the place last; 0 before the first one."""
    misses: int = 0
    """Looks without a confirmation since the last one."""
    moved: bool = False
    """The box has moved since the place was confirmed."""
    locked_ns: int | None = None
    overdue: bool = False
    """The hold is over, but the last confirmation is too old to say so: the next look decides."""
    verify_ns: int | None = None
    view: ViewRef | None = None
    """The picture matched last."""
    box_ptz: tuple[tuple[float, float], ...] = ()
    note: str = ""


@dataclass(slots=True, kw_only=True)
class Active:
    """The request being served."""

    request: Request
    rescans: int = 0
    views: int = 0
    scan: ScanMemory | None = None
    lock: LockMemory | None = None


@dataclass(slots=True, kw_only=True)
class Ended:
    """A result that was given, kept so that the same id again is answered the same."""

    id: str
    ended_ns: int
    outcome: str


@dataclass(slots=True, kw_only=True)
class Memory:
    """The whole state of the core."""

    state: State = State.STARTING
    fisheye: str = "not seen yet"
    """``well``, or why not."""
    ptz: str = "not seen yet"
    limits: HeadLimits | None = None
    reading: HeadReading | None = None
    motion: Motion = Motion.UNKNOWN
    frames: list[FrameRef] = field(default_factory=list)
    queue: list[Request] = field(default_factory=list)
    active: Active | None = None
    ended: list[Ended] = field(default_factory=list)
    head: HeadWork | None = None
    matches: list[MatchWork] = field(default_factory=list)
    moved_ns: int = 0
    """When the last move was asked for: a picture at rest after it shows where it led."""
    next_id: int = 1
    held: bool = False
    home_at_ns: int | None = None
    stop_tokens: list[int] = field(default_factory=list)
    stop_until_ns: int | None = None
    """A stop is under way; nothing starts before it is confirmed."""
    finished: bool = False
    published: PublishStatus | None = None
    """The status that was told last."""
