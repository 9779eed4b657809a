"""The two cameras as all of the daemon sees them where there are privacy zones: pictures come without what is private.

What these hand on is all that bus, log, matching and evidence ever get, so that a replay sees what was seen. A picture
of the PTZ that comes near a zone waits for the first report of the pose from after its exposure.
"""

from __future__ import annotations

import asyncio
import math
from collections import OrderedDict, deque
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Mask
from ptzd.geometry.zones import Zone
from ptzd.model import FrameRef, HeadLimits, HeadReading, HeadSpeed, Lens, Motion, ViewRef
from ptzd.ports import FrameSource, HeadPoll, Picture, PtzHead
from ptzd.runtime.blackening import REST_RAD, HeadScreen, blackened

MOVING_RAD = math.radians(10.0)
"""More room around a zone while the head moves: half of 400°/s² over a report and its lag."""
AROUND_NS = 300_000_000
"""Reports before and after an exposure that say how far the head may have been from where it is believed to be."""
REPORT_WITHIN_S = 0.5
"""A picture without a report from after its exposure for so long is black as a whole."""
SURE_RAD = math.radians(0.25)
"""Reports that differ by less are of a head at rest."""
KEPT = 64
"""Pictures whose black parts are remembered: a picture that is grabbed has come with the stream as well."""


class PrivateFisheye:
    """A fisheye without what a mask covers: :class:`ptzd.ports.FrameSource`."""

    def __init__(self, source: FrameSource, mask: Mask) -> None:
        self._source = source
        self._mask = mask

    async def pictures(self) -> AsyncIterator[Picture]:
        """See the port."""
        async for picture in self._source.pictures():
            yield replace(picture, jpeg=await asyncio.to_thread(blackened, picture.jpeg, self._mask))


@dataclass(frozen=True, slots=True)
class _Screened:
    """A picture that was handed on."""

    picture: Picture
    sure: bool
    """Whether its pose was known as for a picture at rest."""


class PrivateHead:
    """A PTZ without what is private: :class:`ptzd.ports.PtzHead`.

    Parameters
    ----------
    head : PtzHead
        The camera.
    rig : Rig
    zones : tuple of Zone
        Privacy zones only; at least one.
    """

    def __init__(self, head: PtzHead, rig: Rig, zones: tuple[Zone, ...]) -> None:
        self._head = head
        self._screen = HeadScreen(rig, zones)
        self._polls: deque[HeadPoll] = deque(maxlen=64)
        self._polled = asyncio.Condition()
        self._done: OrderedDict[FrameRef, _Screened] = OrderedDict()
        self._one_by_one = asyncio.Lock()

    async def describe(self) -> HeadLimits:
        """See the port."""
        return await self._head.describe()

    async def move(self, target: HeadReading) -> HeadReading:
        """See the port."""
        return await self._head.move(target)

    async def steer(self, speed: HeadSpeed, until_ns: int) -> HeadReading:
        """See the port."""
        return await self._head.steer(speed, until_ns)

    async def set_lens(self, lens: Lens) -> None:
        """See the port."""
        await self._head.set_lens(lens)

    async def stop(self) -> None:
        """See the port."""
        await self._head.stop()

    async def polls(self) -> AsyncIterator[HeadPoll]:
        """See the port."""
        async for poll in self._head.polls():
            async with self._polled:
                self._polls.append(poll)
                self._polled.notify_all()
            yield poll

    async def grab(self, not_before_ns: int) -> tuple[Picture, ViewRef]:
        """See the port; a picture that went out with more black than one at rest needs is not used."""
        while True:
            picture, view = await self._head.grab(not_before_ns)
            margin = REST_RAD + math.radians(3.0 * view.sigma_deg)
            screened = await self._once(picture, view.reading, margin, sure=True)
            if screened.sure:
                return screened.picture, view
            not_before_ns = picture.frame.t_capture_ns + 1

    async def pictures(self) -> AsyncIterator[tuple[Picture, HeadReading, Motion]]:
        """See the port."""
        async for picture, reading, motion in self._head.pictures():
            yield await self._of_stream(picture, reading, motion), reading, motion

    async def _of_stream(self, picture: Picture, reading: HeadReading, motion: Motion) -> Picture:
        if not self._screen.may_show(reading, math.pi / 4.0):
            return picture
        since_ns = min(picture.exposed_after_ns or picture.frame.t_capture_ns, picture.frame.t_capture_ns)
        known = await self._reported_after(picture.frame.t_capture_ns)
        readings = [poll.reading for poll in self._polls if poll.t_ns >= since_ns - AROUND_NS]
        off = max((self._screen.apart_rad(reading, other) for other in readings), default=math.pi)
        sure = known and motion is Motion.STABLE and off < SURE_RAD
        margin = REST_RAD + off if sure else REST_RAD + 1.5 * off + MOVING_RAD
        return (await self._once(picture, reading, margin if known else math.pi, sure=sure)).picture

    async def _reported_after(self, t_ns: int) -> bool:
        """Whether a report from after this time comes soon."""
        try:
            async with asyncio.timeout(REPORT_WITHIN_S), self._polled:
                await self._polled.wait_for(lambda: bool(self._polls) and self._polls[-1].t_ns >= t_ns)
        except TimeoutError:
            return False
        return True

    async def _once(self, picture: Picture, reading: HeadReading, margin_rad: float, *, sure: bool) -> _Screened:
        """Black parts are decided on once for each picture: the log and a match must have the same one."""
        async with self._one_by_one:
            known = self._done.get(picture.frame)
            if known is None:
                jpeg = await asyncio.to_thread(self._blackened, picture.jpeg, reading, margin_rad)
                known = self._done[picture.frame] = _Screened(replace(picture, jpeg=jpeg), sure)
                while len(self._done) > KEPT:
                    self._done.popitem(last=False)
            return known

    def _blackened(self, jpeg: bytes, reading: HeadReading, margin_rad: float) -> bytes:
        return blackened(jpeg, self._screen.mask(reading, margin_rad))
