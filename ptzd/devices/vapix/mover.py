"""One writer of motion: latest wins, one request in flight, arrival proven by reports.

An absolute move comes to rest by itself when nobody talks to the head any more; a continuous one does not, so it is
only ever sent by a :class:`~ptzd.devices.vapix.steering.Steering`, whose dead man stops it.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ptzd.config import Ptz
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.poller import Poller
from ptzd.devices.vapix.poses import PoseRing, Stillness, offset_of, wrapped_deg
from ptzd.devices.vapix.requests import Request
from ptzd.errors import DeviceLost, DeviceRefused
from ptzd.model import HeadLimits, HeadReading
from ptzd.ports import Clock, MoveStalled, MoveSuperseded

STALL_REST_S = 1.0
"""A head that rests elsewhere for so long is not on its way any more."""
SLOWEST_DEG_S = 15.0
SLOWEST_ZOOM_S = 800.0
"""Zoom units per second; twelve seconds from end to end."""
MARGIN_S = 3.0
RETRY_S = 0.2
STOP_AGAIN_S = 1.0
"""A head that is not known to rest so long after the proof was due is told again."""
NEAR_DEG = 0.25
NEAR_ZOOM = 60.0
"""A head that rests this near has arrived as well as it can: coarse encoders step by a tenth of a degree."""
SLOW_REQUEST_NS = 100_000_000


class Mover:
    """Moves and stops the head.

    Parameters
    ----------
    settings : Ptz
    client : CameraClient
    poller : Poller
        Wakes the mover at every report.
    poses : PoseRing
        Told of every command, asked for rest.
    clock : Clock
    stillness : Stillness
        How long the proof of rest takes.
    """

    def __init__(
        self, settings: Ptz, client: CameraClient, poller: Poller, poses: PoseRing, clock: Clock, stillness: Stillness
    ) -> None:
        self._settings = settings
        self._client = client
        self._poller = poller
        self._poses = poses
        self._clock = clock
        self._proof_s = stillness.start_s + stillness.rest_s
        self._ticket = 0
        self._writing = asyncio.Lock()
        self._writes: set[asyncio.Task[None]] = set()
        self._sent_s = -1e9
        self.taken: Callable[[], None] = _nothing
        """Called when the camera took an absolute move or stops: what was steered is over."""
        self.under_way = False
        """Whether a move was sent whose end is not known."""

    async def close(self) -> None:
        """Abandon what is being sent."""
        for task in self._writes:
            task.cancel()
        await asyncio.gather(*self._writes, return_exceptions=True)

    async def move(self, target: HeadReading, limits: HeadLimits) -> HeadReading:
        """As :meth:`ptzd.ports.PtzHead.move`."""
        self._poller.feed.check()
        latest = self._poses.latest
        if latest is None:
            raise DeviceLost(f"{self._client.origin}: no position yet; a move from nowhere is not made")
        if limits.endless_pan:
            target = HeadReading(pan_deg=wrapped_deg(target.pan_deg), tilt_deg=target.tilt_deg, zoom=target.zoom)
        if not limits.contains(target):
            raise MoveStalled(
                latest.reading, f"{shown(target)} is outside the limits {_shown_limits(limits)}; nothing sent"
            )
        ticket = self.take_ticket()
        patience_s = self._patience_s(latest.reading, target)
        await self.write(requests.absolute_move(self._settings.camera, target), ticket)
        self.taken()
        with self._poller.eagerly():
            return await self._arrival(ticket, target, limits, patience_s)

    async def stop(self) -> None:
        """As :meth:`ptzd.ports.PtzHead.stop`."""
        ticket = self.take_ticket()
        loop = asyncio.get_running_loop()
        end_s = loop.time() + self._settings.stall_s + self._proof_s
        while True:
            await self.send_stops(end_s)
            again_s = loop.time() + self._proof_s + STOP_AGAIN_S
            count = self._poller.feed.count
            while loop.time() < again_s:
                if ticket != self._ticket:
                    return
                if self._poses.rest is not None:
                    self.under_way = False
                    return
                count, _ = await self._poller.feed.after(count)
            if loop.time() > end_s:
                raise DeviceRefused(f"{self._client.origin}: the head still moves though it was told to stop")

    async def send_stops(self, end_s: float, ticket: int | None = None) -> None:
        """Both stops, again and again until the camera took them or the time is over.

        With a ticket, only while it is the latest.
        An attempt that fails after the camera was connected anew says nothing of the new connection: one more is made.
        """
        while True:
            connection = self._poller.feed.openings
            try:
                for request in requests.stops(self._settings.camera):
                    await self.write(request, ticket, spaced=False)
            except DeviceLost:
                late = asyncio.get_running_loop().time() >= end_s
                if late and connection == self._poller.feed.openings:
                    raise
                await asyncio.sleep(RETRY_S)
            else:
                self.taken()
                return

    def take_ticket(self) -> int:
        """The right to move; whoever had it before has it no more."""
        self._ticket += 1
        return self._ticket

    def check_ticket(self, ticket: int | None) -> None:
        """MoveSuperseded unless the ticket is the latest; without one, nothing."""
        if ticket is not None and ticket != self._ticket:
            raise MoveSuperseded("a later move or a stop took its place")

    async def write(self, request: Request[None], ticket: int | None, *, spaced: bool = True) -> None:
        """Send in the order of the calls; a caller who is cancelled leaves no request that overtakes the next one."""
        task = asyncio.create_task(self._write_in_turn(request, ticket, spaced=spaced))
        self._writes.add(task)
        task.add_done_callback(self._written)
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError:
            if ticket == self._ticket:
                self.take_ticket()  # a move that still waits for its turn is not sent any more
            raise

    def _written(self, task: asyncio.Task[None]) -> None:
        self._writes.discard(task)
        if not task.cancelled():
            task.exception()

    async def _write_in_turn(self, request: Request[None], ticket: int | None, *, spaced: bool) -> None:
        loop = asyncio.get_running_loop()
        async with self._writing:
            self.check_ticket(ticket)
            if spaced:
                await asyncio.sleep(self._sent_s + self._settings.move_spacing_s - loop.time())
                self.check_ticket(ticket)
                self._sent_s = loop.time()
                self.under_way = True
            commanded_ns = self._clock.now_ns()
            self._poses.commanded(commanded_ns)
            await self._client.send(request)
            answered_ns = self._clock.now_ns()
            if answered_ns - commanded_ns > SLOW_REQUEST_NS:
                self._poses.commanded(answered_ns)

    async def _arrival(self, ticket: int, target: HeadReading, limits: HeadLimits, patience_s: float) -> HeadReading:
        loop = asyncio.get_running_loop()
        end_s, count = loop.time() + patience_s, self._poller.feed.count
        while True:
            count, poll = await self._poller.feed.after(count)
            self.check_ticket(ticket)
            rest = self._poses.rest
            if rest is not None and self._reached(rest.mean, target, limits):
                self.under_way = False
                return rest.mean
            if rest is not None and rest.span_ns >= STALL_REST_S * 1e9:
                self.under_way = False
                raise MoveStalled(rest.mean, self._off(rest.mean, target))
            proving_s = self._settings.stall_s if self._reached(poll.reading, target, limits) else 0.0
            if loop.time() > end_s + proving_s:
                raise MoveStalled(
                    poll.reading,
                    f"still on the way at {shown(poll.reading)} to {shown(target)} after {patience_s:.1f} s",
                )

    def _off(self, rest: HeadReading, target: HeadReading) -> str:
        """Where the head rests; and, when it is as near as heads come, which tolerance asks for more."""
        pan, tilt, zoom = offset_of(rest, target)
        settings, reason = self._settings, f"rests at {shown(rest)} instead of {shown(target)}"
        if max(abs(pan), abs(tilt)) <= NEAR_DEG and abs(zoom) <= NEAR_ZOOM:
            reason += (
                f", off by {max(abs(pan), abs(tilt)):.3f}° and zoom {abs(zoom):.0f}: as near as this head comes, but "
                f"ptz.arrival_tolerance_deg {settings.arrival_tolerance_deg:g} or ptz.zoom_tolerance "
                f"{settings.zoom_tolerance:g} asks for more; set them above that"
            )
        return reason

    def _reached(self, reading: HeadReading, target: HeadReading, limits: HeadLimits) -> bool:
        pan, tilt, zoom = offset_of(reading, target)
        if not limits.endless_pan:
            pan = reading.pan_deg - target.pan_deg
        tolerance_deg = self._settings.arrival_tolerance_deg
        return abs(pan) <= tolerance_deg and abs(tilt) <= tolerance_deg and abs(zoom) <= self._settings.zoom_tolerance

    def _patience_s(self, start: HeadReading, target: HeadReading) -> float:
        """Time for a slow head over the longest way, within the configured bound."""
        angle_deg = max(abs(target.pan_deg - start.pan_deg), abs(target.tilt_deg - start.tilt_deg))
        way_s = max(angle_deg / SLOWEST_DEG_S, abs(target.zoom - start.zoom) / SLOWEST_ZOOM_S)
        return min(self._settings.move_timeout_s, self._proof_s + way_s + STALL_REST_S + MARGIN_S)


def _nothing() -> None:
    """Nobody steers."""


def shown(reading: HeadReading) -> str:
    """A pose for messages."""
    return f"pan {reading.pan_deg:.2f}°, tilt {reading.tilt_deg:.2f}°, zoom {reading.zoom:.0f}"


def _shown_limits(limits: HeadLimits) -> str:
    pan = "any" if limits.endless_pan else f"{limits.pan_deg[0]:g}…{limits.pan_deg[1]:g}°"
    tilt, zoom = limits.tilt_deg, limits.zoom
    return f"pan {pan}, tilt {tilt[0]:g}…{tilt[1]:g}°, zoom {zoom[0]:g}…{zoom[1]:g}"
