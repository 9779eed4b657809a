"""Messages of named places, patrols, and the way home."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from ptzd.bus.fields import END, Id, Incoming, Seconds
from ptzd.model import PatrolShown
from ptzd.outgoing import Outgoing

PlaceName = Annotated[
    str,
    Meta(
        min_length=1,
        max_length=64,
        pattern=rf"^[^\x00-\x1f\x7f-\x9f]*{END}",
        description="as in presets.yaml: 1 to 64 characters, no control characters",
    ),
]


class GotoRequest(Incoming, frozen=True):
    """Send the head to a named place."""

    place: PlaceName
    by: Id | Literal[""] = ""
    """Who asks: where somebody has the head for himself, he alone may."""
    hold_s: Seconds | None = None
    """How long it stays there before what waits goes on; absent = ``presets.hold_s``."""


class GotoReply(Outgoing, frozen=True):
    """The head is there, in the calibrated head frame."""

    place: str
    pan_deg: float
    tilt_deg: float
    zoom: float
    hfov_deg: float


class PatrolRequest(Incoming, frozen=True):
    """Begin a patrol, let it rest, go on, or end."""

    wish: Literal["start", "pause", "resume", "stop"] = "start"
    patrol: PlaceName | Literal[""] = ""
    """Which one begins; the other wishes may name the one that is meant."""


class PatrolReply(Outgoing, frozen=True):
    """How the patrol stands now."""

    patrol: PatrolShown | None = None
    """None: none is under way."""


class HomeAfterRequest(Incoming, frozen=True):
    """How long the head is left where it is before it goes home, until the daemon ends or ``home.idle_s`` changes."""

    after_s: Seconds | Literal["never", "settings"]
    """``settings``: as ``home.idle_s`` says."""


class HomeAfterReply(Outgoing, frozen=True):
    """What holds now."""

    after_s: float | None = None
    """None: it does not go home by itself."""
