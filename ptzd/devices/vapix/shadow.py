"""A head that is imagined beside the real camera: it takes its time and moves nothing.

The camera is asked for its limits, its position and its pictures, and is never told anything. A picture counts only
when the camera happens to stand where the imagined head does; any other shows something else than was asked for.
"""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator
from dataclasses import dataclass, replace

from ptzd.config import Ptz, Shadow
from ptzd.devices.vapix.head import LATENCY_S, REST_S, VapixHead
from ptzd.devices.vapix.mover import shown
from ptzd.devices.vapix.poses import offset_of
from ptzd.errors import DeviceLost
from ptzd.model import HeadLimits, HeadReading, HeadSpeed, Lens, Motion, ViewRef
from ptzd.ports import Clock, HeadPoll, MoveSuperseded, Picture, PictureMissed

USUAL_SPEED_DEG_S = 100.0
ZOOM_START_S = 0.25
"""The zoom's motor needs so long to its full speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """From rest to rest, each axis by itself: speeding up, going on, braking."""

    start: HeadReading
    target: HeadReading
    t_ns: int
    """When it begins."""
    speed_deg_s: float
    acceleration_deg_s2: float
    zoom_units_s: float

    @property
    def seconds(self) -> float:
        """How long the slowest axis takes."""
        return max(_seconds(abs(distance), *rates) for distance, rates in self._axes())

    def at(self, t_ns: int) -> HeadReading:
        """Where the head would be."""
        after_s = max(t_ns - self.t_ns, 0) / 1e9
        if after_s >= self.seconds:
            return self.target
        pan, tilt, zoom = (
            math.copysign(_gone(after_s, abs(distance), *rates), distance) for distance, rates in self._axes()
        )
        start = self.start
        return HeadReading(
            pan_deg=math.remainder(start.pan_deg + pan, 360.0), tilt_deg=start.tilt_deg + tilt, zoom=start.zoom + zoom
        )

    def _axes(self) -> tuple[tuple[float, tuple[float, float]], ...]:
        _, tilt, zoom = offset_of(self.target, self.start)
        pan = self.target.pan_deg - self.start.pan_deg
        angles = (self.speed_deg_s, self.acceleration_deg_s2)
        return (pan, angles), (tilt, angles), (zoom, (self.zoom_units_s, self.zoom_units_s / ZOOM_START_S))


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Steered: at one speed until the dead man strikes."""

    start: HeadReading
    speed: HeadSpeed
    t_ns: int
    """When it begins."""
    until_ns: int
    zoom_units_s: float
    """At the fastest zoom."""

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return max(self.until_ns - self.t_ns, 0) / 1e9

    def at(self, t_ns: int) -> HeadReading:
        """Where the head would be."""
        after_s, start, speed = min(max(t_ns - self.t_ns, 0) / 1e9, self.seconds), self.start, self.speed
        return HeadReading(
            pan_deg=math.remainder(start.pan_deg + after_s * speed.pan_deg_s, 360.0),
            tilt_deg=start.tilt_deg + after_s * speed.tilt_deg_s,
            zoom=start.zoom + after_s * speed.zoom_rate * self.zoom_units_s,
        )


def _seconds(distance: float, speed: float, acceleration: float) -> float:
    if distance * acceleration < speed * speed:
        return 2.0 * math.sqrt(distance / acceleration)
    return distance / speed + speed / acceleration


def _gone(after_s: float, distance: float, speed: float, acceleration: float) -> float:
    """Distance covered; symmetric in time about its middle."""
    whole_s = _seconds(distance, speed, acceleration)
    if after_s >= whole_s:
        return distance
    if after_s > whole_s / 2:
        return distance - _gone(whole_s - after_s, distance, speed, acceleration)
    ramp_s = min(speed / acceleration, whole_s / 2)
    ramped = acceleration * min(after_s, ramp_s) ** 2 / 2
    return ramped + speed * max(after_s - ramp_s, 0.0)


class ShadowHead:
    """Stands for :class:`ptzd.ports.PtzHead` where nothing is to move.

    Parameters
    ----------
    camera : VapixHead
        The real one, which only asks.
    settings, shadow
        Its timing, and how fast the imagined head is.
    clock : Clock
    """

    def __init__(self, camera: VapixHead, settings: Ptz, shadow: Shadow, clock: Clock) -> None:
        self._camera = camera
        self._settings = settings
        self._shadow = shadow
        self._clock = clock
        self._endless = False
        self._way: Way | Turn | None = None

    async def describe(self) -> HeadLimits:
        """As the camera says; the imagined head begins where the real one stands, and goes on from where it was."""
        limits = await self._camera.describe()
        self._endless = limits.endless_pan
        if self._way is None:
            first = await anext(self._camera.polls())
            self._way = self._way_to(first.reading, first.reading)
        return limits

    async def move(self, target: HeadReading) -> HeadReading:
        """Be on the way for as long as the real head would, the proof of its rest included; nothing is sent."""
        way = self._way = self._way_to(self._now(), target)
        await asyncio.sleep(LATENCY_S + way.seconds + REST_S)
        if way is not self._way:
            raise MoveSuperseded("a later move or a stop took its place")
        return target

    async def steer(self, speed: HeadSpeed, until_ns: int) -> HeadReading:
        """Be turned until then; nothing is sent."""
        here, now_ns = self._now(), self._clock.now_ns()
        way = self._way = Turn(
            start=here, speed=speed, t_ns=now_ns, until_ns=until_ns, zoom_units_s=self._shadow.zoom_units_s
        )
        await asyncio.sleep(way.seconds + REST_S)
        if way is not self._way:
            raise MoveSuperseded("a later move or a stop took its place")
        return way.at(until_ns)

    async def set_lens(self, lens: Lens) -> None:
        """Nothing is sent."""

    async def stop(self) -> None:
        """The imagined head stands at once; nothing is sent."""
        here = self._now()
        self._way = self._way_to(here, here)

    async def grab(self, not_before_ns: int) -> tuple[Picture, ViewRef]:
        """A picture of the camera, where it was taken at the place that is asked for.

        Raises
        ------
        PictureMissed
            It stands elsewhere.
        DeviceError
            The camera does not answer.
        """
        settings = self._settings
        await asyncio.sleep(settings.settle_s + settings.image_latency_s + 1 / settings.fps)
        here = self._now()
        stands = (await anext(self._camera.polls())).reading
        if not self._same(stands, here):
            raise PictureMissed(f"the camera stands at {shown(stands)}, not at {shown(here)}")
        picture, view = await self._camera.grab(not_before_ns)
        if not self._same(view.reading, here):
            raise PictureMissed(f"the camera stands at {shown(view.reading)}, not at {shown(here)}")
        return picture, view

    async def polls(self) -> AsyncIterator[HeadPoll]:
        """The imagined head's place with every report of the camera; somebody else's motion is not the shadow's."""
        async for poll in self._camera.polls():
            now_ns, way = self._clock.now_ns(), self._way
            under_way = way is not None and now_ns < way.t_ns + way.seconds * 1e9
            motion = Motion.MOVING if under_way else Motion.STABLE
            yield replace(poll, reading=self._now(), motion=motion, foreign=False, camera=poll.reading)

    def pictures(self) -> AsyncIterator[tuple[Picture, HeadReading, Motion]]:
        """The camera's own, with where the camera really stood."""
        return self._camera.pictures()

    def _now(self) -> HeadReading:
        if self._way is None:
            raise DeviceLost("not connected; describe() comes first")
        return self._way.at(self._clock.now_ns())

    def _way_to(self, start: HeadReading, target: HeadReading) -> Way:
        said = self._camera.capabilities.attributes.max_speed_deg_s if self._camera.capabilities else None
        if self._endless:
            pan, _, _ = offset_of(target, start)
            start = replace(start, pan_deg=target.pan_deg - pan)
        return Way(
            start=start,
            target=target,
            t_ns=self._clock.now_ns() + round(LATENCY_S * 1e9),
            speed_deg_s=self._shadow.speed_deg_s or said or USUAL_SPEED_DEG_S,
            acceleration_deg_s2=self._shadow.acceleration_deg_s2,
            zoom_units_s=self._shadow.zoom_units_s,
        )

    def _same(self, stands: HeadReading, wanted: HeadReading) -> bool:
        pan, tilt, zoom = offset_of(stands, wanted)
        settings = self._settings
        return max(abs(pan), abs(tilt)) <= settings.arrival_tolerance_deg and abs(zoom) <= settings.zoom_tolerance
