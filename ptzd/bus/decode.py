"""From payloads of strangers to events: either a legal value or a refusal with the path of the culprit.

The decoder proper is msgspec's; a second look with the standard library finds what JSON itself allows but no sane
sender means (a key twice, null for a number that is none) and names the place of a NaN, which is no JSON at all.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from typing import TypeVar

import msgspec
from msgspec import Struct

from ptzd.bus.by_hand import LensWanted, MoveRequest
from ptzd.bus.fields import BoxPx, Incoming
from ptzd.bus.keys import is_id
from ptzd.bus.known_ranges import RangesRequest
from ptzd.bus.messages import FrameName, LeaseRequest, RangeM, RoiRequest, RoiUpdate, ZoomTo
from ptzd.bus.places import GotoRequest, HomeAfterRequest, PatrolRequest
from ptzd.control.events import (
    GotoAsked,
    HomeAfterAsked,
    LeaseAsked,
    LeaseWish,
    MoveAsked,
    MoveWish,
    PatrolAsked,
    PatrolWish,
    PayloadRefused,
    RangesAsked,
    RequestReceived,
    UpdateReceived,
    ZoomWish,
)
from ptzd.errors import RequestRefused
from ptzd.model import AUTOMATIC, Box, HeadPose, HomeAfter, Lens

MAX_PAYLOAD_BYTES = 8192
"""Longest message accepted; the session's low-pass filter drops much longer ones before they get here."""

_M = TypeVar("_M", bound=Struct)
_NAMED_FIELD = re.compile(r"(?:unknown|required) field `([^`]*)`")


class _Repeated(ValueError):
    """A key occurs twice in one object."""

    def __init__(self, key: str) -> None:
        super().__init__(key)
        self.key = key


def decode(payload: bytes, message: type[_M]) -> _M:
    """Decode and check one message.

    Raises
    ------
    RequestRefused
        ``too_large``, ``not_json``, or ``invalid`` with the JSON path of the culprit.
    """
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise too_large(len(payload))
    try:
        value = msgspec.json.decode(payload, type=message)
    except msgspec.ValidationError as error:
        raise _invalid(str(error)) from None
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise _not_json(payload, str(error)) from None
    _refuse_loose(payload)
    return value


def check(message: Incoming) -> None:
    """Refuse what the types of a message allow and its meaning does not.

    Raises
    ------
    RequestRefused
        ``invalid`` with the JSON path of the culprit.
    """
    if isinstance(message, RoiRequest):
        _check_range(message.range_m)
    if isinstance(message, RoiRequest | RoiUpdate):
        _check_frame(message.frame)
    if isinstance(message, MoveRequest):
        check_move(message)
    if isinstance(message, RangesRequest):
        _check_ranges(message)


def too_large(size: int) -> RequestRefused:
    """The refusal of a payload of so many bytes."""
    return RequestRefused("too_large", f"the payload has {size} bytes, at most {MAX_PAYLOAD_BYTES} are allowed")


def request_event(payload: bytes, token: int | None) -> RequestReceived | PayloadRefused:
    """What came in on ``roi``, as the event the core is told.

    Parameters
    ----------
    payload : bytes
        The message as it came.
    token : int or None
        Names the query to answer; None for a put.
    """
    try:
        request = decode(payload, RoiRequest)
        check(request)
    except RequestRefused as error:
        return refused(error, token, readable_id(payload))
    return RequestReceived(
        token=token,
        id=request.id,
        box=_box(request.box),
        frame_seq=request.frame.seq if request.frame else None,
        frame_t_capture_ns=request.frame.t_capture_ns if request.frame else None,
        range_m=_range(request.range_m),
        zoom=ZoomWish.HFOV if isinstance(request.zoom, ZoomTo) else ZoomWish(request.zoom),
        hfov_deg=request.zoom.hfov_deg if isinstance(request.zoom, ZoomTo) else None,
        fill=request.fill,
        hold_s=request.hold_s,
        timeout_s=request.timeout_s,
        priority=request.priority,
        label=request.label,
        by=request.by,
    )


def update_event(payload: bytes, request_id: str, token: int | None) -> UpdateReceived | PayloadRefused:
    """What came in on ``roi/<id>/update``.

    A refused update names its request as the one that it is about: that goes on and must not be told that it ended.
    """
    try:
        update = decode(payload, RoiUpdate)
        check(update)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"update of {request_id}: {error.message}", error.field)
        return refused(named, token, None, about=request_id)
    return UpdateReceived(
        token=token,
        told=True,
        id=request_id,
        box=_box(update.box),
        frame_seq=update.frame.seq if update.frame else None,
        frame_t_capture_ns=update.frame.t_capture_ns if update.frame else None,
    )


def lease_event(payload: bytes, token: int | None) -> LeaseAsked | PayloadRefused:
    """What came in on ``control/lease``."""
    try:
        asked = decode(payload, LeaseRequest)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"lease: {error.message}", error.field)
        return refused(named, token, None)
    wish = LeaseWish(asked.wish)
    return LeaseAsked(token=token, wish=wish, owner=asked.owner, rank=asked.rank, for_s=asked.for_s)


def move_event(payload: bytes, token: int | None) -> MoveAsked | PayloadRefused:
    """What came in on ``control/move``."""
    try:
        asked = decode(payload, MoveRequest)
        wish = check_move(asked)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"move: {error.message}", error.field)
        return refused(named, token, None)
    angles, speed, point, seen = asked.to or asked.by, asked.speed, asked.point, asked.picture
    return MoveAsked(
        token=token,
        owner=asked.owner,
        wish=wish,
        pan_deg=angles.pan_deg if angles else 0.0,
        tilt_deg=angles.tilt_deg if angles else 0.0,
        point_px=(point.x, point.y) if point else None,
        box_px=_box(asked.box) if asked.box else None,
        picture=HeadPose(pan_deg=seen.pan_deg, tilt_deg=seen.tilt_deg, zoom=seen.zoom) if seen else None,
        pan_deg_s=speed.pan_deg_s if speed else 0.0,
        tilt_deg_s=speed.tilt_deg_s if speed else 0.0,
        zoom_rate=speed.zoom_rate if speed else 0.0,
        hfov_deg=asked.hfov_deg,
        fill=asked.fill,
        lens=_lens(asked.lens) if asked.lens else None,
    )


def _lens(wanted: LensWanted) -> Lens:
    focus, iris = (AUTOMATIC if value == "auto" else value for value in (wanted.focus, wanted.iris))
    return Lens(focus=focus, iris=iris)


def ranges_event(payload: bytes, token: int | None) -> RangesAsked | PayloadRefused:
    """What came in on ``control/ranges``."""
    try:
        asked = decode(payload or b"{}", RangesRequest)
        check(asked)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"ranges: {error.message}", error.field)
        return refused(named, token, None)
    return RangesAsked(
        token=token,
        forget_last=asked.forget_last or 0,
        forget_box=_box(asked.forget_box) if asked.forget_box else None,
        forget_all=asked.forget_all,
    )


def _check_ranges(asked: RangesRequest) -> None:
    given = [name for name in ("forget_last", "forget_box", "forget_all") if getattr(asked, name)]
    if len(given) > 1:
        raise RequestRefused("invalid", f"expected at most one way to forget; there is {' and '.join(given)}", "$")


def check_move(asked: MoveRequest) -> MoveWish:
    """Which of the ways to move it is.

    Raises
    ------
    RequestRefused
        None or several, or something that does not go with it.
    """
    given = [wish for wish in MoveWish if getattr(asked, wish) is not None]
    if len(given) != 1:
        there = " and ".join(given) or "none"
        raise RequestRefused("invalid", f"expected exactly one of {', '.join(MoveWish)}; there is {there}", "$")
    (wish,) = given
    allowed = {
        MoveWish.SPEED: frozenset[str](),
        MoveWish.LENS: frozenset[str](),
        MoveWish.POINT: frozenset({"hfov_deg", "picture"}),
        MoveWish.BOX: frozenset({"hfov_deg", "picture", "fill"}),
    }.get(wish, frozenset({"hfov_deg"}))
    for name in ("hfov_deg", "fill", "picture"):
        if getattr(asked, name) is not None and name not in allowed:
            raise RequestRefused("invalid", f"`{name}` does not go with `{wish}`", f"$.{name}")
    if asked.lens is not None and asked.lens.focus is asked.lens.iris is None:
        raise RequestRefused("invalid", "neither focus nor iris is given", "$.lens")
    if asked.hfov_deg is not None and asked.fill is not None:
        raise RequestRefused("invalid", "`hfov_deg` and `fill` both say how far to zoom; give one", "$.fill")
    return wish


def goto_event(payload: bytes, token: int | None) -> GotoAsked | PayloadRefused:
    """What came in on ``control/goto``."""
    try:
        asked = decode(payload, GotoRequest)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"goto: {error.message}", error.field)
        return refused(named, token, None)
    return GotoAsked(token=token, place=asked.place, by=asked.by, hold_s=asked.hold_s)


def patrol_event(payload: bytes, token: int | None) -> PatrolAsked | PayloadRefused:
    """What came in on ``control/patrol``."""
    try:
        asked = decode(payload, PatrolRequest)
    except RequestRefused as error:
        named = RequestRefused(error.code, f"patrol: {error.message}", error.field)
        return refused(named, token, None)
    return PatrolAsked(token=token, wish=PatrolWish(asked.wish), patrol=asked.patrol)


def home_after_event(payload: bytes, token: int | None) -> HomeAfterAsked | PayloadRefused:
    """What came in on ``control/home_after``."""
    try:
        asked = decode(payload, HomeAfterRequest).after_s
    except RequestRefused as error:
        named = RequestRefused(error.code, f"home_after: {error.message}", error.field)
        return refused(named, token, None)
    if asked == "settings":
        return HomeAfterAsked(token=token, after=None)
    return HomeAfterAsked(token=token, after=HomeAfter(after_s=None if isinstance(asked, str) else asked))


def refused(
    error: RequestRefused, token: int | None, request_id: str | None, about: str | None = None
) -> PayloadRefused:
    """The refusal as an event."""
    return PayloadRefused(
        token=token,
        code=error.code,
        message=error.message,
        field=error.field,
        id=request_id,
        about=about,
    )


def readable_id(payload: bytes) -> str | None:
    """The request's id in a payload that was refused; None when it cannot be told for certain."""
    if len(payload) > MAX_PAYLOAD_BYTES:
        return None
    try:
        document = _CAREFUL.decode(payload.decode())
    except (ValueError, RecursionError):
        return None
    found = document.get("id") if isinstance(document, dict) else None
    return found if isinstance(found, str) and is_id(found) else None


def _invalid(text: str) -> RequestRefused:
    message, _, path = text.partition(" - at `")
    field = path.rstrip("`") or "$"
    named = _NAMED_FIELD.search(message)
    return RequestRefused("invalid", message, f"{field}.{named.group(1)}" if named else field)


def _not_json(payload: bytes, reason: str) -> RequestRefused:
    try:
        document = _CAREFUL.decode(payload.decode())
    except (ValueError, RecursionError):
        return RequestRefused("not_json", f"the payload is not JSON in UTF-8: {reason}")
    path = not_finite(document, "$")
    if path is None:
        return RequestRefused("not_json", f"the payload is not JSON in UTF-8: {reason}")
    return RequestRefused(
        "invalid", "NaN and infinity are no numbers of JSON; give a finite value or leave it out", path
    )


def not_finite(value: object, path: str) -> str | None:
    """Path of the first number in a document that is none; None when there is no such."""
    return _path_of(value, path, lambda leaf: isinstance(leaf, float) and not math.isfinite(leaf))


def _path_of(value: object, path: str, wanted: Callable[[object], bool]) -> str | None:
    if wanted(value):
        return path
    items: list[tuple[str, object]] = []
    if isinstance(value, dict):
        items = [(f"{path}.{key}", item) for key, item in value.items()]
    elif isinstance(value, list):
        items = [(f"{path}[{index}]", item) for index, item in enumerate(value)]
    found = (_path_of(item, inner, wanted) for inner, item in items)
    return next((inner for inner in found if inner is not None), None)


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    document: dict[str, object] = {}
    for key, value in pairs:
        if key in document:
            raise _Repeated(key)
        document[key] = value
    return document


_CAREFUL = json.JSONDecoder(object_pairs_hook=_unique)


def _refuse_loose(payload: bytes) -> None:
    """Refuse what the decoder proper takes: a field twice, and null, which NaN and infinity are in many languages."""
    try:
        document = _CAREFUL.decode(payload.decode())
    except _Repeated as error:
        message = f"the field `{error.key}` occurs more than once"
        raise RequestRefused("invalid", message, f"$..{error.key}") from None
    path = _path_of(document, "$", lambda leaf: leaf is None)
    if path is not None:
        message = (
            "null is no value, though many languages write NaN and infinity so; leave the field out for the default"
        )
        raise RequestRefused("invalid", message, path)


def _check_range(wanted: RangeM | None) -> None:
    if wanted is not None and wanted.max is not None and wanted.min >= wanted.max:
        got = f"{wanted.min:g} and {wanted.max:g} (m; baselines on a rig without scale)"
        message = f"the nearest range must be below the farthest, got {got}"
        raise RequestRefused("invalid", message, "$.range_m.max")


def _check_frame(frame: FrameName | None) -> None:
    if frame is not None and (frame.seq is None) == (frame.t_capture_ns is None):
        raise RequestRefused("invalid", "name the frame by exactly one of seq and t_capture_ns", "$.frame")


def _range(wanted: RangeM | None) -> tuple[float, float] | None:
    if wanted is None:
        return None
    return (wanted.min, math.inf if wanted.max is None else wanted.max)


def _box(box: BoxPx) -> Box:
    return Box(x=box.x, y=box.y, w=box.w, h=box.h)
