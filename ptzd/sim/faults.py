"""Faults on order: what an HTTP camera does wrong, on which requests, for how long."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import StrEnum
from fnmatch import fnmatchcase
from typing import Annotated, Literal

from msgspec import Meta, Struct


class FaultKind(StrEnum):
    """What goes wrong."""

    HANG = "hang"
    """No answer until the client gives up."""
    STATUS = "status"
    """`status` with a small HTML body."""
    RESET = "reset"
    """The connection is cut without an answer."""
    SLOW = "slow"
    """`delay_s` before the answer."""
    HTML = "html"
    """200 with an HTML page of the wrong content type."""
    ERROR_TEXT = "error_text"
    """200 with ``Error:`` in the body."""
    GARBAGE = "garbage"
    """Numbers in the answer are replaced by nonsense."""
    EMPTY = "empty"
    """200 with an empty body."""
    STALL = "stall"
    """Streams: no further picture."""
    TRUNCATE = "truncate"
    """Streams and stills: the JPEG ends in its middle, headers and length agreeing with the short one."""
    SHORT = "short"
    """Streams: fewer bytes than the announced length, then the next part."""
    CORRUPT = "corrupt"
    """Streams and stills: bytes inside the JPEG are noise."""
    CUT = "cut"
    """Streams: the connection is cut inside a picture."""
    UNPLUG = "unplug"
    """The network is gone for `for_s`: connections are cut and refused, then all is as before."""
    REBOOT = "reboot"
    """The camera restarts: refused connections, then 503, then ready; the head re-homes."""
    FOREIGN_MOVE = "foreign_move"
    """Another user moves the head to `pan`, `tilt`, `zoom`."""
    PRESET = "preset"
    """Another user goes to the preset `name`."""
    ROLE = "role"
    """The daemon's account becomes `value`: viewer (without the PTZ right), operator or administrator."""
    GUESSES = "guesses"
    """Somebody guesses passwords: the throttle closes the door for everybody, for 10 s."""
    RECALIBRATE = "recalibrate"
    """The head drives into its stops and comes back."""
    KNOCK = "knock"
    """The head is bumped: it points `pan`, `tilt` degrees off its encoders, until a reboot finds its zero again."""
    STUCK = "stuck"
    """The motors turn and report, the optics stand: a gear that does not grip any more, until the next reboot."""
    FORGET_NONCES = "forget_nonces"
    """Every digest nonce given out is stale."""
    PARAMETER = "parameter"
    """Somebody sets parameter `name` to `value`."""


ONCE_KINDS = frozenset({
    FaultKind.UNPLUG, FaultKind.REBOOT, FaultKind.FOREIGN_MOVE, FaultKind.RECALIBRATE, FaultKind.KNOCK, FaultKind.STUCK,
    FaultKind.FORGET_NONCES, FaultKind.PARAMETER, FaultKind.PRESET, FaultKind.ROLE, FaultKind.GUESSES,
})  # fmt: skip
"""Happen once at their time."""
PICTURE_KINDS = frozenset({FaultKind.STALL, FaultKind.TRUNCATE, FaultKind.SHORT, FaultKind.CORRUPT, FaultKind.CUT})
"""Hit pictures."""
REQUEST_KINDS = frozenset(FaultKind) - ONCE_KINDS - PICTURE_KINDS
"""Hit requests."""
FISHEYE_KINDS = PICTURE_KINDS | {
    FaultKind.HANG, FaultKind.RESET, FaultKind.SLOW, FaultKind.STATUS, FaultKind.UNPLUG,
}  # fmt: skip
"""What a fisheye can suffer."""


class Fault(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One fault; a script is a list of them."""

    kind: FaultKind
    at_s: Annotated[float, Meta(ge=0)] = 0.0
    """Start, seconds after the rig started (scripts) or after the fault was added (calls)."""
    for_s: Annotated[float, Meta(gt=0)] | None = None
    """How long; None: until cleared or `count` is used up."""
    path: str = "*"
    """Pattern on path and query, e.g. ``*/ptz.cgi*query=position*``."""
    count: Annotated[int, Meta(ge=1)] | None = None
    """How many requests (or pictures) it hits."""
    device: Literal["ptz", "fisheye"] = "ptz"
    status: int = 503
    delay_s: float = 1.0
    pan: float | None = None
    tilt: float | None = None
    zoom: float | None = None
    name: str = ""
    value: str = ""


@dataclass(slots=True)
class _Armed:
    fault: Fault
    start_s: float
    used: int = 0

    def in_force(self, now_s: float) -> bool:
        over = self.fault.for_s is not None and now_s >= self.start_s + self.fault.for_s
        spent = self.fault.count is not None and self.used >= self.fault.count
        return now_s >= self.start_s and not over and not spent


class FaultBox:
    """Faults of one device; its server asks about every request and picture."""

    def __init__(self) -> None:
        self._armed: list[_Armed] = []

    def add(self, fault: Fault, now_s: float) -> None:
        """Arm a fault; its time counts from now."""
        self._armed.append(_Armed(fault, now_s + fault.at_s))

    def clear(self, fault: Fault | None = None) -> None:
        """End one fault, or all."""
        self._armed = [armed for armed in self._armed if fault is not None and armed.fault is not fault]

    @contextmanager
    def during(self, fault: Fault, now_s: float) -> Iterator[None]:
        """Keep a fault armed for a block of code."""
        self.add(fault, now_s)
        try:
            yield
        finally:
            self.clear(fault)

    def on_request(self, target: str, now_s: float) -> Fault | None:
        """The fault, if any, that this request runs into; counts it."""
        return self._hit(target, now_s, REQUEST_KINDS)

    def on_picture(self, target: str, now_s: float) -> Fault | None:
        """The fault, if any, that hits this picture of a stream or this still; counts it."""
        return self._hit(target, now_s, PICTURE_KINDS)

    def _hit(self, target: str, now_s: float, kinds: frozenset[FaultKind]) -> Fault | None:
        for armed in self._armed:
            if armed.fault.kind in kinds and armed.in_force(now_s) and fnmatchcase(target, armed.fault.path):
                armed.used += 1
                return armed.fault
        return None

    def due(self, now_s: float) -> list[Fault]:
        """Take out the faults that happen once and whose time has come."""
        due = [armed for armed in self._armed if armed.fault.kind in ONCE_KINDS and now_s >= armed.start_s]
        self._armed = [armed for armed in self._armed if armed not in due]
        return [armed.fault for armed in due]


def garbled(text: str) -> str:
    """Replace every value of ``key=value`` lines by something that is no number."""
    return "\r\n".join(f"{line.partition('=')[0]}=n/a#" for line in text.splitlines()) + "\r\n"
