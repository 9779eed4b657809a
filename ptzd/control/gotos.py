"""Named places: an operator sends the head to one."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import events as ev
from ptzd.control.activities.goto import Goto
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.memory import Claim, Memory
from ptzd.control.planning.places import place_named, reading_at
from ptzd.control.ranks import Rank
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.model import HeadReading, Outcome


@dataclass(slots=True, kw_only=True)
class Gotos:
    """Goes before every request; where somebody has the head for himself, he alone may."""

    memory: Memory
    work: Work
    desk: Desk
    authority: Authority

    def on_asked(self, event: ev.GotoAsked) -> None:
        """Check everything before anything moves; then what has the head makes way, an earlier goto too."""
        try:
            target = self._target(event)
        except RequestRefused as refused:
            self.desk.refuse_verb(event.token, refused)
            return
        lease = self.memory.lease
        hold_s = self.work.config.presets.hold_s if event.hold_s is None else event.hold_s
        goto = Goto(
            place=event.place,
            target=target,
            # under his own hand it stays anyway
            hold_ns=seconds(hold_s) if lease is None else 0,
            since_ns=self.work.t_ns,
            by=event.by,
            token=event.token,
        )
        came = f"the operator asked for {event.place}" if lease is None else f"{lease.owner} asked for {event.place}"
        self.authority.end_goto(Outcome.PREEMPTED, came)
        self.authority.end_request(Outcome.PREEMPTED, came)
        self.authority.lend(event.by)
        rank = Rank.GOTO if lease is None else Rank.LEASE + lease.rank + 1
        self.authority.insert(Claim(owner=event.place, rank=rank, activity=goto), first=True)
        self.authority.take_next()

    def _target(self, event: ev.GotoAsked) -> HeadReading:
        work, lease = self.work, self.memory.lease
        place = place_named(work.config, event.place)
        if lease is not None and lease.owner != event.by:
            message = f"{lease.owner} has the head for himself; ask for it, or say who you are if that is you (by)"
            raise RequestRefused("leased", message, "$.by")
        if not self.memory.serving or work.head.limits is None:
            message = f"the head cannot go: fisheye: {self.memory.fisheye}; ptz: {self.memory.ptz}"
            raise RequestRefused("device_lost", message)
        target = reading_at(work.rig, work.config, work.reach, event.place, place)
        way = work.way_to(target)
        if isinstance(way, str):
            raise RequestRefused("unreachable", f"{event.place}: {way}", "$.place")
        return target
