"""What the shell expects of the world; adapters fulfil it, tests put others in their place.

Every adapter follows the same life: the constructor assigns, ``async with`` does IO and cleans up.
All times are ns on the daemon's steady clock (:class:`Clock`).
"""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import dataclass
from typing import Protocol

from ptzd.control.commands import Command, RunMatch
from ptzd.control.events import Event, Snapshot
from ptzd.model import FrameRef, HeadLimits, HeadReading, HeadSpeed, Lens, MatchResult, Motion, ViewRef
from ptzd.outgoing import ImageAttachment, Pose


class Clock(Protocol):
    """Steady time: epoch at start plus monotonic since, so it never jumps."""

    def now_ns(self) -> int:
        """Ns since the epoch."""
        ...

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        """Convert a CLOCK_MONOTONIC stamp, e.g. of a V4L2 buffer."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A compressed picture as the camera sent it."""

    frame: FrameRef
    t_arrival_ns: int
    jpeg: bytes
    """Untouched bytes, complete from SOI to EOI."""
    lost_before: int = 0
    """Pictures known to be lost since the previous one."""
    exposed_after_ns: int | None = None
    """Earliest time of the exposure when it may have waited on its way; None when the stamp is the device's own."""


class FrameSource(Protocol):
    """The fisheye: an endless series of pictures that heals itself.

    ``pictures()`` yields the newest picture; while the device is lost it raises :class:`ptzd.errors.DeviceLost` or
    ``DeviceRefused`` once; calling ``pictures()`` again waits (with back-off) until the device is back.
    """

    def pictures(self) -> AsyncIterator[Picture]:
        """Pictures from now on; older ones are dropped and counted in ``lost_before``."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadPoll:
    """One position report with its time."""

    reading: HeadReading
    t_ns: int
    """Middle of the round trip minus the camera's report lag."""
    motion: Motion
    foreign: bool = False
    """True on the first report of a motion that nobody here asked for."""
    camera: HeadReading | None = None
    """Where the camera itself stands, when ``reading`` is where a shadow's head would."""


class PtzHead(Protocol):
    """The PTZ camera: moves, positions, pictures.

    Methods raise :class:`ptzd.errors.DeviceError` when the camera cannot answer; nothing is guessed.
    """

    async def describe(self) -> HeadLimits:
        """Connect and read the camera's capabilities and limits; safe to call again after a loss."""
        ...

    async def move(self, target: HeadReading) -> HeadReading:
        """Move, wait for rest at the target and return the resting position; a newer move or stop cancels this one.

        Raises :class:`MoveSuperseded` for a move that a later one replaced, :class:`MoveStalled` when the head rests
        elsewhere or does not arrive in time.
        """
        ...

    async def steer(self, speed: HeadSpeed, until_ns: int) -> HeadReading:
        """Turn and zoom at this speed, and stop when nothing newer has come until then; returns the resting position.

        The stop is the adapter's own: it comes whatever becomes of the caller. Raises as :meth:`move` does.
        """
        ...

    async def set_lens(self, lens: Lens) -> None:
        """Set focus and iris, or leave them to the camera; `DeviceRefused` when it has no such thing."""
        ...

    async def stop(self) -> None:
        """Stop all axes; returns when the camera confirmed it."""
        ...

    async def grab(self, not_before_ns: int) -> tuple[Picture, ViewRef]:
        """The first picture exposed wholly at rest at or after ``not_before_ns``.

        Raises :class:`PictureMissed` when there is none of where the head would stand.
        """
        ...

    def polls(self) -> AsyncIterator[HeadPoll]:
        """Position reports as they come; raises when the camera is lost."""
        ...

    def pictures(self) -> AsyncIterator[tuple[Picture, HeadReading, Motion]]:
        """Every picture of the stream with the pose it is believed to show; raises when the stream is lost."""
        ...


class MoveSuperseded(Exception):
    """A later move or a stop took this one's place."""


class PictureMissed(Exception):
    """The camera stands elsewhere than the head that is imagined; one sentence."""


class MoveStalled(Exception):
    """The head rests elsewhere than asked.

    Parameters
    ----------
    reading : HeadReading
        Where it rests.
    reason : str
        One sentence.
    """

    def __init__(self, reading: HeadReading, reason: str) -> None:
        super().__init__(reason)
        self.reading = reading
        self.reason = reason


class Bus(Protocol):
    """The outside: structurally checked events come in, commands that publish or reply go out."""

    def events(self) -> AsyncIterator[Event]:
        """Incoming messages as events, what is urgent first; never blocks the sender, bounded."""
        ...

    def perform(self, command: Command) -> None:
        """Reply or publish; returns at once."""
        ...

    def publish_pose(self, pose: Pose) -> None:
        """Tell where the head looks; returns at once."""
        ...

    def publish_image(self, key: str, jpeg: bytes, attachment: ImageAttachment) -> None:
        """Offer a picture: sent only if somebody listens, latest wins, never waits."""
        ...

    def image_wanted(self, key: str) -> bool:
        """Whether somebody listens to this picture key."""
        ...


class EventLog(Protocol):
    """The black box. Calls only enqueue; decisions are never dropped, pictures are when the disk cannot follow."""

    def event(self, sequence: int, t_ns: int, event: Event) -> None:
        """What the core is about to be told, and when."""
        ...

    def command(self, sequence: int, t_ns: int, command: Command) -> None:
        """What the core answered to the event of this sequence number."""
        ...

    def picture(self, topic: str, picture: Picture) -> None:
        """A picture with the camera's own bytes."""
        ...

    def rotate_due(self) -> bool:
        """Whether the file has reached its size or age."""
        ...

    def rotate(self, sequence: int, t_ns: int, snapshot: Snapshot) -> None:
        """Cut the file here: everything told so far goes into the old one, the snapshot opens the new one."""
        ...

    def document(self, topic: str, t_ns: int, document: dict[str, object]) -> None:
        """Any other topic (``/pose``, annotations, ``/log``)."""
        ...


class Perception(Protocol):
    """Runs matchers off the loop."""

    async def match(self, job: RunMatch, fisheye_jpeg: bytes, view_jpeg: bytes) -> MatchResult:
        """Run one match. Raises :class:`ptzd.errors.PtzdError` when it fails, whatever it stumbled over."""
        ...
