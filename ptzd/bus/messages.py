"""Every message of the bus as a struct, with its encoding and its JSON Schema.

What comes in is strict: an unknown field is refused, so that a misspelt option is not silently ignored. What goes out
may gain fields without a new version, so readers of those skip what they do not know. Angles are degrees in fields
ending ``_deg``, times ns since the epoch in ``_ns``; absent means unknown.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta, Struct

from ptzd.bus.by_hand import MoveReply, MoveRequest
from ptzd.bus.fields import (
    END,
    BoxPx,
    Counter,
    Document,
    Id,
    Incoming,
    Label,
    Metres,
    Plain,
    Seconds,
    Timeout,
)
from ptzd.bus.known_ranges import RangesReply, RangesRequest
from ptzd.bus.places import GotoReply, GotoRequest, HomeAfterReply, HomeAfterRequest, PatrolReply, PatrolRequest
from ptzd.errors import RequestRefused
from ptzd.model import FrameRef, GotoShown, HomeAfter, LeaseHeld, Outcome, PatrolShown, Result
from ptzd.outgoing import ImageAttachment, MotorStatus, Outgoing, Pose

VERSION = "v1"
IMAGE_ENCODING = "image/jpeg"
"""Zenoh encoding of pictures; what they show is in the attachment, an ``ImageAttachment``."""


class FrameName(Incoming, frozen=True):
    """The fisheye frame a box was drawn on: one of the two."""

    seq: Counter | None = None
    t_capture_ns: Counter | None = None


class RangeM(Incoming, frozen=True):
    """Where along the ray to look, in m (in baselines when the rig is not metric); no ``max`` = up to infinity."""

    min: Metres
    max: Metres | None = None


class ZoomTo(Incoming, frozen=True):
    """Zoom until the picture is this wide."""

    hfov_deg: Annotated[float, Meta(gt=0, lt=180)]


Frame = Annotated[FrameName | None, Meta(extra_json_schema={"minProperties": 1, "maxProperties": 1})]


class RoiRequest(Incoming, frozen=True):
    """Look at this region. The same id again is the same request."""

    id: Id
    box: BoxPx
    frame: Frame = None
    """Absent = the newest frame."""
    range_m: RangeM | None = None
    zoom: Literal["fit", "keep"] | ZoomTo = "fit"
    fill: Annotated[float, Meta(ge=0.05, le=0.95)] | None = None
    """Share of the PTZ frame that the region is to fill, with zoom ``fit``."""
    hold_s: Seconds | None = None
    timeout_s: Timeout | None = None
    priority: Annotated[int, Meta(ge=0, le=9)] = 0
    label: Label = ""
    by: Id | Literal[""] = ""
    """Who asks: whoever has the lease is served under it."""


class RoiUpdate(Incoming, frozen=True):
    """A newer box of the same, moving target."""

    box: BoxPx
    frame: Frame = None


class LeaseRequest(Incoming, frozen=True):
    """Somebody wants the head for himself, still wants it, gives it back, or asks whoever has it."""

    owner: Id
    wish: Literal["take", "renew", "give", "ask"] = "take"
    """``renew`` well within ``lease.silence_s``, or it is over."""
    rank: Annotated[int, Meta(ge=0, le=8)] = 0
    """A higher one takes it from a lower one."""
    for_s: Timeout | None = None
    """Absent = as long as ``lease.max_s`` allows."""


class Empty(Incoming, frozen=True):
    """Payload of a cancel or a control verb: ``{}`` or nothing."""


class LogRequest(Incoming, frozen=True):
    """What to do with the log; nothing at all means ``list``."""

    action: Literal["list", "rotate"] = "list"


class Accepted(Outgoing, frozen=True):
    """The request is taken on."""

    id: str
    frame: FrameRef | None = None
    """The frame the box was taken from."""
    position: int = 0
    """0 = active now, 1… = place in the queue."""


class ErrorReply(Outgoing, frozen=True, omit_defaults=False):
    """Why not."""

    code: str
    message: str
    field: str = "$"
    """JSON path of the culprit, ``$`` for the whole message."""


class Feedback(Outgoing, frozen=True):
    """One step of a request."""

    id: str
    t_ns: int
    step: str
    detail: dict[str, Plain] = msgspec.field(default_factory=dict)


class Point(Outgoing, frozen=True):
    """A place in a picture, px."""

    x: float
    y: float


class LogReference(Outgoing, frozen=True):
    """Where in the log a moment lies."""

    file: str
    t_ns: int


_AS_THEY_ARE = tuple(field.name for field in fields(Result) if field.name not in {"box_ptz", "range_m"})


class RoiResult(Outgoing, frozen=True):
    """The one end of a request. Directions are of the calibrated head frame, pan right +, tilt up +."""

    id: str
    outcome: Outcome
    reason: str
    elapsed_ms: int
    views: int
    label: str = ""
    pan_deg: float | None = None
    tilt_deg: float | None = None
    zoom: float | None = None
    hfov_deg: float | None = None
    box_ptz: tuple[Point, ...] = ()
    """Corners of the region in the PTZ picture."""
    range_m: float | None = None
    """None when unknown, infinite, or when the rig is not metric."""
    range_baselines: float | None = None
    """In distances of both cameras, when the rig is not metric."""
    probability: float | None = None
    sigma_deg: float | None = None
    log: LogReference | None = None

    @classmethod
    def of(cls, result: Result, log: LogReference | None, *, metric: bool) -> RoiResult:
        """The message of a result: ranges under the name of their unit, corners as points."""
        same: Document = {name: getattr(result, name) for name in _AS_THEY_ARE}
        return cls(
            **same,
            box_ptz=tuple(Point(x=x, y=y) for x, y in result.box_ptz),
            range_m=result.range_m if metric else None,
            range_baselines=None if metric else result.range_m,
            log=log,
        )


class CancelReply(Outgoing, frozen=True):
    """What the cancel did."""

    outcome: str


class UpdateReply(Outgoing, frozen=True):
    """What the update did, where it was a query."""

    outcome: str


class ControlReply(Outgoing, frozen=True):
    """What the operator's verb did."""

    outcome: str


class LeaseReply(Outgoing, frozen=True):
    """The lease as it is now."""

    lease: LeaseHeld | None = None
    """None: nobody has it."""


class LogReply(Outgoing, frozen=True):
    """Closed log files, oldest first."""

    files: tuple[str, ...]


class Status(Outgoing, frozen=True):
    """The state of the rig."""

    t_ns: int
    state: str
    phase: str = ""
    active: str | None = None
    """Id of the request being worked on."""
    queue: tuple[str, ...] = ()
    fisheye: str = ""
    """``well`` or the reason why not."""
    ptz: str = ""
    held: bool = False
    lease: LeaseHeld | None = None
    """Who has the head for himself."""
    shadow: bool = False
    """What is decided moves nothing."""
    doubt: str = ""
    """What speaks against the head: it is stuck, or has lost its zero; empty: nothing does."""
    goto: GotoShown | None = None
    """Where an operator sent it."""
    patrol: PatrolShown | None = None
    """The one under way."""
    home_after: HomeAfter | None = None
    """How long the head is left where it is before it goes home: as was said while the daemon ran, or as set."""
    devices: Document = msgspec.field(default_factory=dict)
    motor: MotorStatus | None = None
    pose: Pose | None = None
    log: Document = msgspec.field(default_factory=dict)
    versions: dict[str, str] = msgspec.field(default_factory=dict)


class Calibration(Outgoing, frozen=True):
    """The loaded ``rig.yaml``."""

    ptzd_calibration: int
    fisheye: Document
    ptz: Document
    head: Document
    rig: Document
    uncertainty: Document = msgspec.field(default_factory=dict)
    provenance: Document = msgspec.field(default_factory=dict)


MESSAGES: dict[str, type[Struct]] = {
    message.__name__: message
    for message in (
        RoiRequest, RoiUpdate, LeaseRequest, MoveRequest, RangesRequest, Empty, LogRequest, Accepted, ErrorReply,
        Feedback, RoiResult, CancelReply, ControlReply, UpdateReply, LeaseReply, MoveReply, RangesReply, LogReply, Pose,
        Status, Calibration, ImageAttachment, GotoRequest, GotoReply, PatrolRequest, PatrolReply, HomeAfterRequest,
        HomeAfterReply,
    )
}  # fmt: skip

PUBLISHED: dict[str, type[Outgoing]] = {
    "status": Status,
    "pose": Pose,
    "roi/*/feedback": Feedback,
    "roi/*/result": RoiResult,
    "image/fisheye": ImageAttachment,
    "image/ptz": ImageAttachment,
    "image/overlay": ImageAttachment,
}
"""Every key that is published, below the rig's, and its message; of pictures the attachment is the message."""


def encoding(name: str) -> str:
    """Zenoh encoding of a message type, e.g. ``application/json;ptzd.RoiRequest.v1``."""
    return f"application/json;ptzd.{name}.{VERSION}"


def message_types() -> tuple[str, ...]:
    """Names of all messages, in alphabetical order."""
    return tuple(sorted(MESSAGES))


def schema(name: str) -> dict[str, object]:
    """JSON Schema (draft 2020-12) of a message type.

    Raises
    ------
    RequestRefused
        When there is no such type; the message lists all.
    """
    if name not in MESSAGES:
        message = f"there is no message type {name!r}; there are {', '.join(message_types())}"
        raise RequestRefused("unknown_type", message)
    body = _portable(msgspec.json.schema(MESSAGES[name]))
    if issubclass(MESSAGES[name], Incoming):
        body = _without_null(body)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": f"ptzd.{name}.{VERSION}", **body}


def _portable(node: Any) -> Any:  # noqa: ANN401 - any JSON
    """Patterns for every engine: in a schema ``$`` is the end, and RE2 and its kin refuse a look-ahead."""
    if isinstance(node, dict):
        return {key: _portable(value) for key, value in node.items()}
    if isinstance(node, list):
        return [_portable(value) for value in node]
    return node.removesuffix(END) + "$" if isinstance(node, str) and node.endswith(END) else node


def _without_null(node: Any) -> Any:  # noqa: ANN401 - any JSON
    """What comes in has no null: a field is there or absent."""
    if isinstance(node, list):
        return [_without_null(value) for value in node if value != {"type": "null"}]
    if not isinstance(node, dict):
        return node
    kept = {key: _without_null(value) for key, value in node.items() if (key, value) != ("default", None)}
    if len(kept.get("anyOf", ())) == 1:
        kept |= kept.pop("anyOf")[0]
    return kept
