"""What the core is told. Frozen values that carry everything needed to decide again.

When it was told is no part of an event: the pump stamps it once, on the daemon's steady clock (ns since the epoch at
start plus monotonic time since), and the stamp goes beside it into log and core.
Head readings are in the camera's own units; the core converts with the calibration it was given.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from ptzd.model import (
    Box,
    FrameRef,
    HeadLimits,
    HeadPose,
    HeadReading,
    HomeAfter,
    Lens,
    MatchResult,
    Motion,
    RegionAsked,
    Turned,
    ViewRef,
)


class Device(StrEnum):
    """The two devices whose health decides over FAULT."""

    FISHEYE = "fisheye"
    PTZ = "ptz"


class Verb(StrEnum):
    """Operator verbs of the bus key ``control/…``."""

    HOME = "home"
    STOP = "stop"
    HOLD = "hold"
    RELEASE = "release"


class LeaseWish(StrEnum):
    """What somebody wants of the lease on the head."""

    TAKE = "take"
    RENEW = "renew"
    GIVE = "give"
    ASK = "ask"


class MoveWish(StrEnum):
    """What a person who has the head does with it by hand."""

    TO = "to"
    BY = "by"
    POINT = "point"
    BOX = "box"
    SPEED = "speed"
    LENS = "lens"


class PatrolWish(StrEnum):
    """What a person wants of the patrol."""

    START = "start"
    PAUSE = "pause"
    RESUME = "resume"
    STOP = "stop"


class ZoomWish(StrEnum):
    """How far to zoom: by the share of the frame, not at all, or to a given field of view."""

    FIT = "fit"
    KEEP = "keep"
    HFOV = "hfov"


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Root of all events."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RequestReceived(Event, RegionAsked):
    """Another app asks to look at a box; structurally valid, not yet checked against frame and queue."""

    token: int | None
    """Names the query to answer; None for a fire-and-forget put."""
    id: str
    range_m: tuple[float, float] | None = None
    zoom: ZoomWish = ZoomWish.FIT
    hfov_deg: float | None = None
    """With ``ZoomWish.HFOV`` only."""
    fill: float | None = None
    hold_s: float | None = None
    timeout_s: float | None = None
    priority: int = 0
    label: str = ""
    by: str = ""
    """Who asks: whoever has the lease is served under it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PayloadRefused(Event):
    """Something came in that is no valid message; kept so that the log has it and the sender hears of it."""

    token: int | None
    code: str
    message: str
    field: str
    id: str | None = None
    """The request's id where it could be read: a put with an id gets a result, a query an error reply."""
    about: str | None = None
    """The request that a put wanted to change: it goes on, and whoever follows it hears of the refusal."""


@dataclass(frozen=True, slots=True, kw_only=True)
class UpdateReceived(Event, RegionAsked):
    """A newer box of the same, moving target."""

    id: str
    token: int | None = None
    """Names the query to answer; None for a put."""
    told: bool = False
    """Whether a put for a request that is not there is told as feedback; false in logs whose daemon kept silent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CancelReceived(Event):
    """The client no longer wants the request."""

    token: int | None
    """Names the query to answer; None for a put."""
    id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlReceived(Event):
    """An operator's verb."""

    token: int | None
    """Names the query to answer; None for a put."""
    verb: Verb


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaseAsked(Event):
    """A person wants the head for himself, still wants it, gives it back, or wants it from whoever has it."""

    token: int | None
    """Names the query to answer; None for a put."""
    wish: LeaseWish
    owner: str
    rank: int = 0
    """Among people, 0 to 8: a higher one takes it from a lower one."""
    for_s: float | None = None
    """How long; None: as long as the settings allow."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveAsked(Event):
    """Whoever has the lease moves the head by hand; angles and rates are of the calibrated head frame."""

    token: int | None
    """Names the query to answer; None for a put."""
    owner: str
    wish: MoveWish
    pan_deg: float = 0.0
    """Of ``to`` and ``by``."""
    tilt_deg: float = 0.0
    point_px: tuple[float, float] | None = None
    """With ``point``: a place in the PTZ's picture."""
    box_px: Box | None = None
    """With ``box``: a rectangle in the PTZ's picture."""
    picture: HeadPose | None = None
    """The pose that the picture of ``point`` or ``box`` was taken at; None: where the head rests now."""
    pan_deg_s: float = 0.0
    """Of ``speed``: until the dead man strikes or something newer comes."""
    tilt_deg_s: float = 0.0
    zoom_rate: float = 0.0
    """-1 to 1: share of the fastest zoom, positive to the tele end."""
    hfov_deg: float | None = None
    """How wide the picture is to be; None: as it is."""
    fill: float | None = None
    """Share of the picture that the box is to fill; None: as the settings say."""
    lens: Lens | None = None
    """With ``lens``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GotoAsked(Event):
    """An operator, or whoever has the lease, sends the head to a named place."""

    token: int | None
    """Names the query to answer; None for a put."""
    place: str
    by: str = ""
    """Who asks."""
    hold_s: float | None = None
    """How long it stays there; None: as the settings say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RangesAsked(Event):
    """Somebody wants to know what locks have taught of the ranges, or takes some of it back."""

    token: int | None
    """Names the query to answer; None for a put."""
    forget_last: int = 0
    """What the newest so many locks have taught."""
    forget_box: Box | None = None
    """What lies in this rectangle of the fisheye's picture, px."""
    forget_all: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PatrolAsked(Event):
    """A person begins a patrol, lets it rest, go on, or end."""

    token: int | None
    """Names the query to answer; None for a put."""
    wish: PatrolWish
    patrol: str = ""
    """Which one begins; the others may name the one that is under way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PatrolDue(Event):
    """By the clock of the rig's time zone another patrol is due, or none any more."""

    patrol: str
    """Empty: none."""
    since: str
    """When its window of the schedule began, as UTC; empty: none. Names the window."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeAfterAsked(Event):
    """Somebody says how long the head is left where it is before it goes home."""

    token: int | None
    """Names the query to answer; None for a put."""
    after: HomeAfter | None
    """None: as the settings say."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameArrived(Event):
    """A fisheye frame entered the ring."""

    frame: FrameRef


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadReady(Event):
    """The PTZ is reachable; these are its limits, already cut to the configured ones, and where it stands."""

    limits: HeadLimits
    reading: HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceLost(Event):
    """A device does not answer or refuses."""

    device: Device
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceWell(Event):
    """A device works (again). The PTZ says it with HeadReady, which comes first."""

    device: Device


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadPolled(Event):
    """A position report."""

    reading: HeadReading
    motion: Motion


@dataclass(frozen=True, slots=True, kw_only=True)
class ForeignMotion(Event):
    """The head moved without being told to."""

    reading: HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadArrived(Event):
    """The head rests at the target of this move."""

    move_id: int
    reading: HeadReading


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadStalled(Event):
    """The head rests elsewhere, or did not arrive in time."""

    move_id: int
    reading: HeadReading
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class LensAnswered(Event):
    """The camera took a focus or iris, or refused it."""

    lens_id: int
    refused: str = ""
    """Why not; empty: it took it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadStopped(Event):
    """The camera confirmed a stop."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewTaken(Event):
    """A picture whose whole exposure lay in rest."""

    grab_id: int
    view: ViewRef


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewMissed(Event):
    """There is no picture of where the head would stand: it is a shadow's, and the camera stands elsewhere."""

    grab_id: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewsCompared(Event):
    """Two pictures at rest were held against the poses that were reported for them."""

    found: Turned
    reference: bool
    """The earlier one is the one kept of this very place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchFinished(Event):
    """A matcher's answer for one view."""

    match_id: int
    result: MatchResult


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchFailed(Event):
    """A matcher could not run, e.g. because a picture does not decode."""

    match_id: int
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class DeadlinePassed(Event):
    """The time the core asked for has come."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsChanged(Event):
    """The settings were read again; decisions from here on follow these, what was accepted stays as it is."""

    parts: dict[str, object] = field(default_factory=dict)
    """By name the parts of the settings that the core may be given while it runs, each complete: plain values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutdownRequested(Event):
    """The daemon is to end: every request gets its result, the head stops."""

    reason: str = "the daemon is stopping"


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot(Event):
    """First event of every log file: what is needed to drive a fresh core from here on."""

    state: dict[str, object] = field(default_factory=dict)
