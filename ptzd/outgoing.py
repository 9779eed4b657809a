"""What the daemon tells beside its decisions, said once for bus and log: pose, motors, what a picture shows.

Absent means unknown; readers skip fields that they do not know.
"""

from __future__ import annotations

from msgspec import Struct


class Outgoing(Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A message from the daemon."""


class ShadowPose(Outgoing, frozen=True):
    """Where the head would look, were it not for the shadow."""

    pan_deg: float
    tilt_deg: float
    zoom: float


class Pose(Outgoing, frozen=True):
    """Where the head looks: calibrated head frame, pan right +, tilt up +."""

    t_ns: int
    pan_deg: float
    tilt_deg: float
    zoom: float
    moving: bool
    motion: str
    """``moving``, ``settling``, ``stable`` or ``unknown``; of the imagined head where there is one."""
    hfov_deg: float | None = None
    sigma_deg: float | None = None
    shadow: ShadowPose | None = None
    """In shadow mode; all else is where the camera stands."""


class MotorStatus(Outgoing, frozen=True):
    """What the motors have gone, whoever moved them."""

    pan_deg: float
    """In their life, as are the next four."""
    tilt_deg: float
    zoom_steps: float
    moves: int
    """Asked for by the daemon."""
    spared: int
    """Not driven, since the head stood near enough."""
    moves_last_hour: int
    degrees_last_hour: float
    """Pan and tilt together."""
    moves_per_hour: int | None = None
    """Budget; None: no end."""
    degrees_per_hour: float | None = None


class ImageAttachment(Outgoing, frozen=True):
    """What a JPEG on ``image/…`` shows; w, h in px. Where it was taken is told of the PTZ's pictures."""

    seq: int
    t_capture_ns: int
    w: int
    h: int
    pan_deg: float | None = None
    tilt_deg: float | None = None
    zoom: float | None = None
    hfov_deg: float | None = None
    moving: bool | None = None
    motion: str | None = None
    """As in ``Pose``."""
