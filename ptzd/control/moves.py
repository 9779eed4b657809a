"""Moving the head by hand: only whoever has the lease, and only where the head may go."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.manual import Manual
from ptzd.control.authority import Authority
from ptzd.control.leases import Leases
from ptzd.control.memory import Memory
from ptzd.control.planning.by_hand import set_point, shown_pose, speed_shown, speed_wanted
from ptzd.control.work import Work
from ptzd.errors import GeometryError, RequestRefused
from ptzd.model import HeadReading, Motion


@dataclass(slots=True, kw_only=True)
class Moves:
    """What a person's hand does."""

    memory: Memory
    work: Work
    leases: Leases
    authority: Authority

    def on_asked(self, event: ev.MoveAsked) -> None:
        """Move, or say why not; his word counts as a heartbeat either way."""
        try:
            lease = self.leases.own(event)
            lease.heard_ns = self.work.t_ns
            reply = self._do(lease, event)
        except RequestRefused as refused:
            self.work.out.append(
                cmd.ReplyRefused(token=event.token, code=refused.code, message=refused.message, field=refused.field)
            )
            return
        if reply is not None:
            self.work.out.append(reply)

    def _do(self, lease: Manual, event: ev.MoveAsked) -> cmd.ReplyMove | None:
        if event.wish is ev.MoveWish.SPEED:
            return self._steer(lease, event)
        if event.wish is ev.MoveWish.LENS:
            self._set_lens(event)
            return None
        return self._go(lease, event)

    def _set_lens(self, event: ev.MoveAsked) -> None:
        """Answered when the camera has taken it."""
        limits, lens = self.work.head.limits, event.lens
        if not self.memory.serving or limits is None or lens is None:
            raise self._lost()
        for name, value, ends in (("focus", lens.focus, limits.focus), ("iris", lens.iris, limits.iris)):
            if value and ends is None:
                message = f"the camera tells no limits of its {name}: it cannot be set by hand"
                raise RequestRefused("unreachable", message, f"$.lens.{name}")
            if value and ends is not None and not ends[0] <= value <= ends[1]:
                message = f"{name} {value}: the camera has {ends[0]:.0f} to {ends[1]:.0f}"
                raise RequestRefused("unreachable", message, f"$.lens.{name}")
        self.work.set_lens(lens, event.token)

    def _go(self, lease: Manual, event: ev.MoveAsked) -> cmd.ReplyMove | None:
        start = self._in_hand(lease)
        head = self.work.head
        rests = head.motion is Motion.STABLE and head.asked is None
        if event.wish is ev.MoveWish.BY and lease.target is not None:
            start = lease.target
        limits = head.limits
        if limits is None:
            raise self._lost()
        fill = self.work.config.lock.fill
        target = set_point(self.work.rig, limits, event, start=start, rests=rests, fill=fill)
        way = self.work.way_to(target)
        if isinstance(way, str):
            raise RequestRefused("zone", way, f"$.{event.wish}")
        self._take_over(lease)
        lease.go(self.work, target)
        if event.token is None:
            return None
        pose = shown_pose(self.work.rig, target)
        return cmd.ReplyMove(token=event.token, pose=pose, hfov_deg=self._hfov_deg(target))

    def _steer(self, lease: Manual, event: ev.MoveAsked) -> cmd.ReplyMove | None:
        self._in_hand(lease)
        limits = self.work.head.limits
        if limits is None:
            raise self._lost()
        wanted = speed_wanted(self.work.rig, limits, event)
        self._take_over(lease)
        granted, slowed_by = lease.steer(self.work, wanted)
        if event.token is None:
            return None
        pan_deg_s, tilt_deg_s = speed_shown(self.work.rig, granted)
        return cmd.ReplyMove(
            token=event.token,
            pan_deg_s=pan_deg_s,
            tilt_deg_s=tilt_deg_s,
            zoom_rate=granted.zoom_rate,
            slowed_by=slowed_by,
        )

    def _in_hand(self, lease: Manual) -> HeadReading:
        """Where the head is, if his hand can reach it now."""
        if not self.memory.serving or self.work.head.reading is None:
            raise self._lost()
        if self.authority.stop_under_way is not None:
            message = f"the head is being stopped; {lease.owner} has it again when it stands"
            raise RequestRefused("stopping", message, "$")
        return self.work.head.reading

    def _take_over(self, lease: Manual) -> None:
        """What he asked for himself, a request or a named place, makes way to his hand."""
        if self.memory.task is not None or self.memory.goto is not None:
            self.authority.take_back(lease)
        holder = self.memory.holder
        if holder is None or holder.activity is not lease:
            raise AssertionError(f"{lease.owner} moves the head though it is not his")

    def _lost(self) -> RequestRefused:
        memory = self.memory
        return RequestRefused(
            "device_lost", f"the head cannot be moved: ptz {memory.ptz}, fisheye {memory.fisheye}", "$"
        )

    def _hfov_deg(self, target: HeadReading) -> float | None:
        try:
            return math.degrees(self.work.rig.camera(target).hfov_rad)
        except GeometryError:
            return None
