"""What the core wants done. Slow parts answer later with events.

A command about a value of the model has that value's fields as its own: flat, as the log writes it.
"""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control.planning.ranges import KnownRange
from ptzd.model import (
    MATCH_BUDGET_S,
    FrameRef,
    GotoShown,
    HeadPose,
    HeadReading,
    HeadSpeed,
    HomeAfter,
    LeaseHeld,
    Lens,
    Matcher,
    PatrolShown,
    Region,
    Result,
    ViewRef,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """Root of all commands."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveHead(Command):
    """Absolute move of pan, tilt and zoom at once; answered by HeadArrived or HeadStalled with the same id."""

    move_id: int
    target: HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class SteerHead(Command):
    """Turn and zoom at this speed until then, unless a newer command comes; at rest answered as a move is."""

    move_id: int
    speed: HeadSpeed
    until_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SpareMove(Command):
    """The head rests near enough: the motor is spared, and the move counts as done. For the log."""

    move_id: int
    target: HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class RefuseMove(Command):
    """A move that is not made, for the log and the journal; whoever wanted it is told on his own way."""

    target: HeadReading
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLens(Command):
    """Focus and iris; answered by LensAnswered with the same id."""

    lens_id: int
    lens: Lens


@dataclass(frozen=True, slots=True, kw_only=True)
class StopHead(Command):
    """Stop every axis; a move under way gives no further answer. Answered by HeadStopped."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrabView(Command):
    """Take one picture exposed at rest at or after ``not_before_ns``; answered by ViewTaken, or its time runs out."""

    grab_id: int
    not_before_ns: int


@dataclass(frozen=True, slots=True, kw_only=True)
class RunMatch(Command, Region):
    """Look for a region in a view; answered by MatchFinished or MatchFailed."""

    match_id: int
    request_id: str
    view: ViewRef
    inverse_range: tuple[float, float]
    """Interval searched along the arc, in 1/m (1/baseline when not metric)."""
    band_rad: float
    """Half width searched across the arc."""
    matcher: Matcher
    seed: int
    budget_s: float = MATCH_BUDGET_S
    """Most work, as the settings had it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AbandonMatches(Command):
    """Answers to the matches under way are no longer wanted; none comes after this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PinFrame(Command):
    """Keep the bytes of this fisheye frame for the request until ReleaseFrames names it."""

    request_id: str
    frame: FrameRef
    instead_of: tuple[FrameRef, ...] = ()
    """Frames of the request that newer boxes have replaced: their bytes may go."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReleaseFrames(Command):
    """The request is over; its pinned frames and views may go."""

    request_id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyAccepted(Command):
    """Answer a request's query: taken on."""

    token: int
    id: str
    frame: FrameRef
    position: int
    """0 = active now, 1… = place in the queue."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyRefused(Command):
    """Answer any query with an error."""

    token: int | None
    """None: it came by a put, and only the journal can be told."""
    code: str
    message: str
    field: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyOutcome(Command):
    """Answer a cancel or a control verb."""

    token: int
    outcome: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyLease(Command):
    """Answer a question on the lease."""

    token: int
    lease: LeaseHeld | None
    """As it is now; None: nobody has it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyMove(Command):
    """Answer whoever moves the head by hand: what it does now, in the calibrated head frame."""

    token: int
    pose: HeadPose | None = None
    """Where it goes; None: it is steered."""
    hfov_deg: float | None = None
    pan_deg_s: float = 0.0
    """How it is steered: slower than asked for near a limit."""
    tilt_deg_s: float = 0.0
    zoom_rate: float = 0.0
    slowed_by: str = ""
    """Which limit, where one slows it."""
    lens: Lens | None = None
    """What the camera took."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyGoto(Command):
    """Answer whoever sent the head to a place: it is there."""

    token: int
    place: str
    pose: HeadPose
    hfov_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyRanges(Command):
    """Answer a question on what locks have taught of the ranges."""

    token: int
    learning: bool
    forgotten: int
    known: tuple[KnownRange, ...]
    """Oldest first, after what was forgotten."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyPatrol(Command):
    """Answer a word on the patrol."""

    token: int
    patrol: PatrolShown | None
    """As it stands now; None: none is under way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplyHomeAfter(Command):
    """Answer whoever said how long the head is left where it is."""

    token: int
    after_s: float | None
    """What holds now; None: it does not go home by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishFeedback(Command):
    """One step of a request, for ``roi/<id>/feedback`` and the log."""

    id: str
    step: str
    """state, plan, view, shadow, match, found, correction, verify, locked, update, note."""
    detail: dict[str, object]
    """Flat: numbers, strings, booleans."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishResult(Command, Result):
    """The one end of a request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishStatus(Command):
    """The state as the bus key ``status`` and the log topic ``/state`` show it."""

    state: str
    active: str | None
    phase: str
    queue: tuple[str, ...]
    fisheye: str
    ptz: str
    """``well`` or the reason why not."""
    held: bool
    """An operator's ``hold`` is in force: no request is started."""
    lease: LeaseHeld | None = None
    """Who has the head for himself."""
    shadow: bool = False
    """What is decided moves nothing."""
    doubt: str = ""
    """What speaks against the head: it is stuck, or has lost its zero."""
    goto: GotoShown | None = None
    """Where an operator sent it."""
    patrol: PatrolShown | None = None
    """The one under way."""
    home_after: HomeAfter | None = None
    """As somebody said while the daemon ran; None: as the settings say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finished(Command):
    """After ShutdownRequested: nothing is under way any more, the shell may close."""
