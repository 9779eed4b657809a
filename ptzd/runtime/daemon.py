"""The daemon: one pump, two watched devices, the bus, and a clean end."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import msgspec

from ptzd.config import Config, core_parts
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.head_state import HeadState
from ptzd.control.health import RING_FRAMES
from ptzd.control.machine import Machine
from ptzd.control.memory import Memory
from ptzd.control.motor import Travel
from ptzd.control.planning.ranges import RangeMap
from ptzd.control.states import State
from ptzd.errors import DeviceError
from ptzd.geometry.rig import Rig
from ptzd.model import HeadReading, Motion
from ptzd.outgoing import Pose, ShadowPose
from ptzd.ports import Bus, Clock, EventLog, FrameSource, HeadPoll, Perception, Picture, PtzHead
from ptzd.runtime.attachments import hfov_deg
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.gallery import Gallery
from ptzd.runtime.hands import Hands
from ptzd.runtime.motor_watch import Compare, MotorWatch
from ptzd.runtime.narrator import Narrator
from ptzd.runtime.overlays import Overlays
from ptzd.runtime.pump import Pump
from ptzd.runtime.watch import FisheyeWatch, HeadWatch

SPARE_FRAMES = 32
"""The store holds a few more frames than the core's ring, so that what the core accepts is certainly here."""
STOP_WITHIN_S = 4.5
"""The head's stop is confirmed within 3 s or reported as not confirmed; the whole end takes at most 5 s."""


def _nothing() -> None:
    """Said already."""


class Daemon:
    """Wires a core to its ports and runs until told to stop.

    Parameters
    ----------
    rig, config
        Calibration and settings.
    clock, fisheye, head, bus, log, perception
        The world; already opened by whoever composes the daemon.
    answering : callable
        Called once, when every device is well or has been reported lost: whoever asks gets an answer from now on.
    serving : callable
        Called once, when requests can be served.
    travel : Travel, optional
        What the motors had gone before.
    ranges : RangeMap, optional
        What locks have taught before.
    compare : callable, optional
        Holds two pictures of the PTZ against their poses; without it nobody watches whether they agree.
    watching : sequence of callables
        Shown every step of the core, after the log: its number, event and commands.
    """

    def __init__(
        self,
        *,
        rig: Rig,
        config: Config,
        clock: Clock,
        fisheye: FrameSource,
        head: PtzHead,
        bus: Bus,
        log: EventLog,
        perception: Perception,
        answering: Callable[[], None] = _nothing,
        serving: Callable[[], None] = _nothing,
        travel: Travel | None = None,
        ranges: RangeMap | None = None,
        compare: Compare | None = None,
        watching: Sequence[Callable[[int, ev.Event, list[cmd.Command]], None]] = (),
    ) -> None:
        self._rig = rig
        self._bus = bus
        self._log = log
        self._answering = answering
        self._serving = serving
        self.frames = FrameStore(RING_FRAMES + SPARE_FRAMES)
        self.overlays = Overlays(rig=rig, bus=bus, frames=self.frames)
        self.gallery = Gallery(rig=rig, bus=bus, overlays=self.overlays)
        machine = Machine(rig, config, Memory(head=HeadState(travel=travel or Travel()), ranges=ranges or RangeMap()))
        observers = (self.overlays.seen, Narrator().seen, self._watch_readiness, *watching)
        self.pump = Pump(machine=machine, clock=clock, log=log, bus=bus, frames=self.frames, observers=observers)
        self._motor_watch: MotorWatch | None = None
        if compare is not None:
            wanted = lambda: machine.config.motor.watch  # noqa: E731
            self._motor_watch = MotorWatch(compare, self.pump.tell, self.frames, wanted)
            self.pump.observers += (self._motor_watch.seen,)
        self.fisheye_watch = FisheyeWatch(
            source=fisheye,
            tell=self.pump.tell,
            frames=self.frames,
            log=log,
            size_px=rig.fisheye.size_px,
            shown=self.gallery.show_fisheye,
        )
        self.head_watch = HeadWatch(
            head=head, tell=self.pump.tell, log=log, polled=self._publish_pose, shown=self._show_view
        )
        self._hands = self.pump.hands = Hands(
            tell=self.pump.tell,
            lost=self._head_lost,
            head=head,
            perception=perception,
            frames=self.frames,
            log=log,
        )

    async def run(self, stop: asyncio.Event, *beside: Callable[[], Coroutine[Any, Any, None]]) -> None:
        """Serve until ``stop`` is set; then every request gets its result and the head stops.

        Parameters
        ----------
        stop : asyncio.Event
        beside : callables
            Run as long as the daemon does; what they raise ends it.
        """
        self.pump.cut_log()
        watching = () if self._motor_watch is None else (self._motor_watch.run,)
        tasks = [
            *(asyncio.create_task(work()) for work in (*beside, *watching)),
            asyncio.create_task(self.fisheye_watch.run(), name="fisheye"),
            asyncio.create_task(self.head_watch.run(), name="head"),
            asyncio.create_task(self._listen(), name="bus"),
            asyncio.create_task(self.pump.keep_deadlines(), name="deadlines"),
        ]
        stopping = asyncio.create_task(stop.wait(), name="stop")
        watched: list[asyncio.Future[Any]] = [stopping, self._hands.defect, *tasks]
        try:
            done, _ = await asyncio.wait(watched, return_when=asyncio.FIRST_COMPLETED)
            for ended in done:
                ended.result()
        finally:
            await self._end([stopping, *tasks])

    async def _end(self, tasks: Sequence[asyncio.Task[Any]]) -> None:
        self.pump.tell(ev.ShutdownRequested())
        try:
            async with asyncio.timeout(STOP_WITHIN_S):
                await self.pump.finished.wait()
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await self._hands.close()
            await self.overlays.close()

    def adopt(self, config: Config) -> None:
        """Let the core go on with the parts of these settings that may change; a new log file begins with them."""
        self.pump.tell(ev.SettingsChanged(parts=core_parts(config)))

    def _show_view(self, picture: Picture, reading: HeadReading, motion: Motion) -> None:
        self.gallery.show_ptz(picture, reading, motion)
        if self._motor_watch is not None:
            self._motor_watch.shown(picture, reading, motion)

    async def _listen(self) -> None:
        async for event in self._bus.events():
            self.pump.tell(event)

    def _head_lost(self, error: DeviceError) -> None:
        self.head_watch.report_lost(error)

    def _watch_readiness(self, t_ns: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        del t_ns, commands
        serving = self.pump.machine.state is not State.STARTING
        if serving or isinstance(event, ev.DeviceLost):
            answering, self._answering = self._answering, _nothing
            answering()
        if serving:
            now_serving, self._serving = self._serving, _nothing
            now_serving()

    def pose(self, poll: HeadPoll) -> Pose:
        """Where the head looks, for the bus key ``pose`` and the log topic ``/pose``.

        Of a shadow it is where the camera stands, with where the imagined head does beside it.
        """
        reading = poll.camera or poll.reading
        pan_deg, tilt_deg = self._direction_deg(reading)
        hfov, uncertainty = hfov_deg(self._rig, reading.zoom), self._rig.uncertainty
        return Pose(
            t_ns=poll.t_ns,
            pan_deg=pan_deg,
            tilt_deg=tilt_deg,
            zoom=reading.zoom,
            moving=poll.motion is not Motion.STABLE,
            motion=poll.motion.value,
            hfov_deg=None if hfov is None else round(hfov, 4),
            sigma_deg=0.0 if uncertainty is None else round(math.degrees(uncertainty.head_rad), 4),
            shadow=None if poll.camera is None else self._shadow(poll.reading),
        )

    def _shadow(self, reading: HeadReading) -> ShadowPose:
        pan_deg, tilt_deg = self._direction_deg(reading)
        return ShadowPose(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=reading.zoom)

    def _direction_deg(self, reading: HeadReading) -> tuple[float, float]:
        pan, tilt = self._rig.head.pan_tilt_from_vapix(reading)
        return round(math.degrees(pan), 4), round(math.degrees(tilt), 4)

    def _publish_pose(self, poll: HeadPoll) -> None:
        pose = self.pose(poll)
        self._bus.publish_pose(pose)
        self._log.document("/pose", pose.t_ns, msgspec.to_builtins(pose))
