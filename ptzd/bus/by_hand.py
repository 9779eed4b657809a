"""Messages of whoever has the head for himself and moves it by hand."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from ptzd.bus.fields import BoxPx, Id, Incoming, Pixel
from ptzd.outgoing import Outgoing


class PanTilt(Incoming, frozen=True):
    """Angles of the calibrated head frame, deg: pan right +, tilt up +."""

    pan_deg: Annotated[float, Meta(ge=-360, le=360)]
    tilt_deg: Annotated[float, Meta(ge=-180, le=180)]


class Step(Incoming, frozen=True):
    """So much further, deg; absent = not at all."""

    pan_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    tilt_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0


class PixelPtz(Incoming, frozen=True):
    """A place in the PTZ's picture, px; pixel centres at integers."""

    x: Pixel
    y: Pixel


class Speed(Incoming, frozen=True):
    """How fast to turn and zoom, until something newer comes or 0.3 s are over."""

    pan_deg_s: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    tilt_deg_s: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    zoom_rate: Annotated[float, Meta(ge=-1, le=1)] = 0.0
    """Share of the fastest zoom, positive to the tele end."""


class ViewPose(Incoming, frozen=True):
    """The pose of a picture, as its attachment tells it."""

    pan_deg: Annotated[float, Meta(ge=-360, le=360)]
    tilt_deg: Annotated[float, Meta(ge=-180, le=180)]
    zoom: Annotated[float, Meta(ge=1, le=19999)]


Auto = Literal["auto"]


class LensWanted(Incoming, frozen=True):
    """Focus and iris, in the camera's own units or automatic; absent = as it is."""

    focus: Annotated[int, Meta(ge=1, le=9999)] | Auto | None = None
    iris: Annotated[int, Meta(ge=1, le=9999)] | Auto | None = None


class MoveRequest(Incoming, frozen=True):
    """Whoever has the lease moves the head: exactly one of ``to``, ``by``, ``point``, ``box``, ``speed``, ``lens``."""

    owner: Id
    to: PanTilt | None = None
    """A set point."""
    by: Step | None = None
    """From where the head is, or goes."""
    point: PixelPtz | None = None
    """Bring this pixel of the PTZ's picture to the centre."""
    box: BoxPx | None = None
    """And zoom until this rectangle of the PTZ's picture fills it."""
    speed: Speed | None = None
    lens: LensWanted | None = None
    """Until the end of the lease; then both are automatic again."""
    hfov_deg: Annotated[float, Meta(gt=0, lt=180)] | None = None
    """How wide the picture is to be; absent = as it is."""
    fill: Annotated[float, Meta(ge=0.05, le=0.95)] | None = None
    """Share of the picture that ``box`` is to fill."""
    picture: ViewPose | None = None
    """Where ``point`` or ``box`` was seen; absent = where the head rests now."""


class MoveReply(Outgoing, frozen=True):
    """What the head does now, in the calibrated head frame; ``pose`` and ``status`` tell of its end."""

    pan_deg: float | None = None
    """Where it goes."""
    tilt_deg: float | None = None
    zoom: float | None = None
    hfov_deg: float | None = None
    pan_deg_s: float | None = None
    """How it is steered: slower than asked for near a limit."""
    tilt_deg_s: float | None = None
    zoom_rate: float | None = None
    slowed_by: str = ""
    """Which limit, where one slows it."""
    focus: int | Auto | None = None
    """What the camera took."""
    iris: int | Auto | None = None
