"""Whether the devices are well, and what follows when one is lost or comes back."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import events as ev
from ptzd.control.authority import Authority
from ptzd.control.memory import Memory
from ptzd.control.work import Work, seconds
from ptzd.model import Motion, Outcome

WELL = "well"
RING_FRAMES = 128
"""Fisheye frames that a request may name; at 30 fps 4 s, more than the default ``frame_max_age_s`` in use."""


@dataclass(slots=True, kw_only=True)
class Health:
    """The devices' part of the core."""

    memory: Memory
    work: Work
    authority: Authority

    def on_frame(self, event: ev.FrameArrived) -> None:
        """Requests may name it from now on."""
        frames = self.memory.frames
        frames.append(event.frame)
        if len(frames) > RING_FRAMES:
            del frames[: len(frames) - RING_FRAMES]

    def on_head_ready(self, event: ev.HeadReady) -> None:
        """What the head can do is known."""
        self.work.head.limits, self.work.head.reading = event.limits, event.reading
        self.work.head.motion = Motion.UNKNOWN
        self.work.came_to_rest(None)

    def on_polled(self, event: ev.HeadPolled) -> None:
        """Where the head is."""
        self.work.head.reading, self.work.head.motion = event.reading, event.motion
        if not self.work.config.shadow.enabled:
            self.work.head.travel.report(event.reading, self.work.t_ns)
        if event.motion is Motion.STABLE:
            self.work.reported_rest(event.reading)
        if self.memory.serving and self.memory.holder is not None:
            self.authority.apply(self.memory.holder.activity.on_reading(self.work))

    def on_compared(self, event: ev.ViewsCompared) -> None:
        """Pictures follow the motors, or they do not."""
        self.work.head.doubts.compared(event.found, reference=event.reference)

    def on_foreign_motion(self, event: ev.ForeignMotion) -> None:
        """Somebody else moves the head: it is left to them."""
        self.work.head.reading, self.work.head.span = event.reading, None
        self.authority.leave_home()
        self.authority.rest_patrol(from_ns=self.work.t_ns + seconds(self.work.config.presets.quiet_s))
        self.authority.end_request(Outcome.PREEMPTED, "somebody else moves the camera")
        self.authority.end_goto(Outcome.PREEMPTED, "somebody else moves the camera")
        self.authority.forget_homing()

    def on_lost(self, event: ev.DeviceLost) -> None:
        """The request ends, and nothing begins before both devices are well."""
        memory = self.memory
        self.authority.end_request(Outcome.DEVICE_LOST, f"{event.device}: {event.reason}")
        self.authority.end_goto(Outcome.DEVICE_LOST, f"{event.device}: {event.reason}")
        self.authority.leave_home()
        self.authority.set_lease_aside()
        self.authority.rest_patrol()
        self.work.abandon()
        memory.serving = False
        if event.device is ev.Device.FISHEYE:
            memory.fisheye = event.reason
            memory.frames.clear()
            if memory.ptz == WELL:
                self.authority.stop()
        else:
            memory.ptz = event.reason
            for lens in list(self.work.head.lenses):
                self.work.lens_over(lens.id, event.reason)
            self.authority.stop_is_over(event.reason)

    def on_well(self, event: ev.DeviceWell) -> None:
        """With both well the daemon serves."""
        memory = self.memory
        if event.device is ev.Device.FISHEYE:
            memory.fisheye = WELL
        else:
            memory.ptz = WELL
        all_well = memory.fisheye == memory.ptz == WELL and self.work.head.limits is not None
        if all_well and not memory.serving:
            memory.serving = memory.served = True
            self.authority.plan_homing()
            self.authority.take_next()
