"""Watching the two devices: what they deliver, when they are lost, when they are well again."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from ptzd.backoff import Backoff
from ptzd.control import events as ev
from ptzd.errors import DeviceError, DeviceRefused
from ptzd.jpeg.walk import UPRIGHT, read_header, turned
from ptzd.model import HeadReading, Motion
from ptzd.ports import EventLog, FrameSource, HeadPoll, Picture, PtzHead
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.hands import Tell

LOGGER = logging.getLogger(__name__)

LONGEST_RETRY_S = 15.0
"""Between attempts to reach a lost device: a camera reboots in 30–60 s, so four quick tries, then calm."""


class Health:
    """Tells the core once that a device is lost, and once that it is well."""

    def __init__(self, device: ev.Device, tell: Tell) -> None:
        self._device = device
        self._tell = tell
        self._said: str | None = None
        self.lost_since_start = 0

    @property
    def well(self) -> bool:
        """Whether the core was last told that the device is well."""
        return self._said == ""

    def report_well(self) -> None:
        """The device delivers."""
        if self._said != "":
            self._said = ""
            self._tell(ev.DeviceWell(device=self._device))

    def report_lost(self, error: DeviceError) -> None:
        """The device does not."""
        reason = str(error)
        if self._said == reason:
            return
        self.lost_since_start += self._said == ""
        self._said = reason
        self._tell(ev.DeviceLost(device=self._device, reason=reason))


class Turns:
    """Warns once whenever a camera begins to ask viewers to turn its pictures, or asks for another turn."""

    def __init__(self, camera: str) -> None:
        self._camera = camera
        self._orientation = UPRIGHT

    def note(self, orientation: int) -> None:
        """Take the EXIF orientation of the newest picture."""
        if orientation not in {UPRIGHT, self._orientation}:
            LOGGER.warning("%s", turned(self._camera, orientation))
        self._orientation = orientation


class FisheyeWatch:
    """Feeds fisheye frames to ring, core and log.

    Parameters
    ----------
    size_px : tuple of int
        What the calibration is for; other pictures make the device lost, since every bearing would be wrong.
    shown : callable
        Offered every frame, e.g. for the bus.
    """

    def __init__(
        self,
        *,
        source: FrameSource,
        tell: Tell,
        frames: FrameStore,
        log: EventLog,
        size_px: tuple[int, int],
        shown: Callable[[Picture], None],
    ) -> None:
        self.health = Health(ev.Device.FISHEYE, tell)
        self.frames_seen = 0
        self.frames_lost = 0
        self._source = source
        self._tell = tell
        self._frames = frames
        self._log = log
        self._size_px = size_px
        self._turns = Turns("fisheye")
        self._shown = shown

    async def run(self) -> None:
        """Watch until cancelled."""
        backoff = Backoff(LONGEST_RETRY_S)
        while True:
            try:
                async for picture in self._source.pictures():
                    self._take(picture)
                    backoff.reset()
            except DeviceError as error:
                self._frames.clear_ring()
                self.health.report_lost(error)
                await asyncio.sleep(backoff.pause_s())

    def _take(self, picture: Picture) -> None:
        self._check(picture)
        self.frames_seen += 1
        self.frames_lost += picture.lost_before
        self._frames.add(picture)
        self._log.picture("/fisheye/image", picture)
        self._tell(ev.FrameArrived(frame=picture.frame))
        self.health.report_well()
        self._shown(picture)

    def _check(self, picture: Picture) -> None:
        header = read_header(picture.jpeg)
        width, height = header.size_px
        self._turns.note(header.orientation)
        if (width, height) != self._size_px:
            wanted = f"{self._size_px[0]}×{self._size_px[1]}"
            message = (
                f"the fisheye sends {width}×{height} px, the calibration is for {wanted} px; "
                "set fisheye.size_px or calibrate at this size"
            )
            raise DeviceRefused(message)


class HeadWatch:
    """Connects to the PTZ, follows its position and its pictures, and reconnects."""

    def __init__(
        self,
        *,
        head: PtzHead,
        tell: Tell,
        log: EventLog,
        polled: Callable[[HeadPoll], None],
        shown: Callable[[Picture, HeadReading, Motion], None],
    ) -> None:
        self.health = Health(ev.Device.PTZ, tell)
        self.last_poll: HeadPoll | None = None
        self._head = head
        self._tell = tell
        self._log = log
        self._polled = polled
        self._turns = Turns("PTZ")
        self._shown = shown
        self._broken = asyncio.Event()
        self._error: DeviceError | None = None

    def report_lost(self, error: DeviceError) -> None:
        """A command failed: the connection counts as lost and is made anew."""
        self._error = error
        self.health.report_lost(error)
        self._broken.set()

    async def run(self) -> None:
        """Watch until cancelled."""
        backoff = Backoff(LONGEST_RETRY_S)
        while True:
            try:
                await self._connected(backoff)
            except DeviceError as error:
                self.health.report_lost(error)
                await asyncio.sleep(backoff.pause_s())

    async def _connected(self, backoff: Backoff) -> None:
        """One connection from its beginning to its loss."""
        self._broken.clear()
        limits = await self._head.describe()
        polls = self._head.polls()
        first = await anext(polls)
        self._tell(ev.HeadReady(limits=limits, reading=first.reading))
        self._on_poll(first)
        tasks = [
            asyncio.create_task(self._follow_polls()),
            asyncio.create_task(self._follow_pictures(backoff)),
            asyncio.create_task(self._wait_broken()),
        ]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _wait_broken(self) -> None:
        await self._broken.wait()
        if self._error is not None:
            raise self._error

    async def _follow_polls(self) -> None:
        async for poll in self._head.polls():
            self._on_poll(poll)

    def _on_poll(self, poll: HeadPoll) -> None:
        self.last_poll = poll
        if poll.foreign:
            self._tell(ev.ForeignMotion(reading=poll.reading))
        self._tell(ev.HeadPolled(reading=poll.reading, motion=poll.motion))
        self._polled(poll)

    async def _follow_pictures(self, backoff: Backoff) -> None:
        async for picture, reading, motion in self._head.pictures():
            self._turns.note(read_header(picture.jpeg).orientation)
            self._log.picture("/ptz/image", picture)
            self._shown(picture, reading, motion)
            self.health.report_well()
            backoff.reset()
