"""Continuous moves, which last until somebody ends them: a dead man here does, whatever becomes of who steers."""

from __future__ import annotations

import asyncio
import logging

from ptzd.config import Ptz
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.answers import CameraSaysNo
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.mover import Mover
from ptzd.devices.vapix.poller import Poller
from ptzd.devices.vapix.poses import PoseRing
from ptzd.devices.vapix.speeds import SPEED_FORMS, SpeedCurve
from ptzd.errors import DeviceError
from ptzd.model import HeadReading, HeadSpeed
from ptzd.ports import Clock, MoveStalled, MoveSuperseded

LOGGER = logging.getLogger(__name__)
REST = HeadSpeed()


class Steering:
    """Turns and zooms the head at a speed, for as long as somebody says so.

    Parameters
    ----------
    settings : Ptz
    client : CameraClient
    mover : Mover
        The one writer: a move or a stop ends what is steered, and the other way round.
    poller : Poller
    poses : PoseRing
    clock : Clock
    """

    def __init__(
        self, settings: Ptz, client: CameraClient, mover: Mover, poller: Poller, poses: PoseRing, clock: Clock
    ) -> None:
        self._settings = settings
        self._client = client
        self._mover = mover
        self._poller = poller
        self._poses = poses
        self._clock = clock
        self._form = 0
        self._told: HeadSpeed | None = None
        self._ticket = 0
        self._until_ns = 0
        self._dead_man: asyncio.Task[None] | None = None
        self.turning = False
        """Whether a continuous move may be in force in the camera."""
        mover.taken = self._released

    async def close(self) -> None:
        """End the dead man; whoever closes has stopped the head."""
        if self._dead_man is not None:
            self._dead_man.cancel()
            await asyncio.gather(self._dead_man, return_exceptions=True)

    async def steer(self, speed: HeadSpeed, until_ns: int, top_deg_s: tuple[float, float] | None) -> HeadReading:
        """As :meth:`ptzd.ports.PtzHead.steer`; ``top_deg_s``: the camera's fastest pan and tilt."""
        self._poller.feed.check()
        self._ticket = ticket = self._mover.take_ticket()
        self._until_ns = until_ns if speed != REST else 0
        self._poses.commanded(self._clock.now_ns())
        if self._dead_man is None or self._dead_man.done():
            self._dead_man = asyncio.create_task(self._stop_in_time())
            self._dead_man.add_done_callback(_looked_at)
        if speed not in {REST, self._told}:
            curve = SpeedCurve(top_deg_s=top_deg_s, exponent=self._settings.steer_exponent)
            await self._tell(curve.percents(speed), ticket)
            self._told = speed
        with self._poller.eagerly():
            return await self._at_rest(ticket)

    async def stop_what_turns(self) -> None:
        """After the connection was lost: end what was steered before. Raises DeviceError when the camera does not."""
        if self.turning:
            await self._mover.send_stops(asyncio.get_running_loop().time() + self._settings.stall_s)

    def _released(self) -> None:
        """An absolute move or stops were taken by the camera: they ended what was steered."""
        self._told, self.turning = None, False
        if self._dead_man is not None and self._dead_man is not asyncio.current_task():
            self._dead_man.cancel()

    async def _tell(self, percents: tuple[float, float, float], ticket: int) -> None:
        """In the form that the camera takes."""
        self.turning = True
        while True:
            form = SPEED_FORMS[self._form]
            try:
                await self._mover.write(requests.continuous_move(self._settings.camera, percents, form), ticket)
            except CameraSaysNo as error:
                if self._form + 1 == len(SPEED_FORMS):
                    raise
                self._form += 1
                LOGGER.info("%s; asked in an older form", error)
            else:
                return

    async def _stop_in_time(self) -> None:
        """Whatever happens to who steers: when nothing newer has come, the head is told to stop."""
        while True:
            left_ns = self._until_ns - self._clock.now_ns()
            if left_ns > 0:
                await asyncio.sleep(left_ns / 1e9)
                continue
            self._told = None
            try:
                await self._mover.send_stops(asyncio.get_running_loop().time() + self._settings.stall_s, self._ticket)
            except MoveSuperseded:
                if self._until_ns > self._clock.now_ns():
                    continue
            return

    async def _at_rest(self, ticket: int) -> HeadReading:
        """Wait until the dead man has struck and the head rests."""
        loop = asyncio.get_running_loop()
        count, late_s = self._poller.feed.count, None
        while True:
            count, poll = await self._poller.feed.after(count)
            self._mover.check_ticket(ticket)
            dead_man = self._dead_man
            if dead_man is None or not dead_man.done():
                continue
            if not dead_man.cancelled() and isinstance(error := dead_man.exception(), DeviceError):
                raise error
            late_s = loop.time() + self._settings.stall_s if late_s is None else late_s
            rest = self._poses.rest
            if rest is not None:
                self._mover.under_way = False
                return rest.mean
            if loop.time() > late_s:
                raise MoveStalled(poll.reading, "the head still moves though it was told to stop")


def _looked_at(task: asyncio.Task[None]) -> None:
    if not task.cancelled():
        task.exception()
