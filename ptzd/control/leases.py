"""Leases: a person has the head for himself, as long as he says so."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.activity import Over
from ptzd.control.activities.manual import Manual
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.memory import Memory
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused


@dataclass(slots=True, kw_only=True)
class Leases:
    """The people's part of the core."""

    memory: Memory
    work: Work
    desk: Desk
    authority: Authority

    def on_asked(self, event: ev.LeaseAsked) -> None:
        """Do as he wishes, or say who has the head."""
        wishes = {
            ev.LeaseWish.TAKE: self._take,
            ev.LeaseWish.RENEW: self._renew,
            ev.LeaseWish.GIVE: self._give,
            ev.LeaseWish.ASK: self._ask,
        }
        try:
            wishes[event.wish](event)
        except RequestRefused as refused:
            self.work.out.append(
                cmd.ReplyRefused(token=event.token, code=refused.code, message=refused.message, field=refused.field)
            )
            return
        if event.token is not None:
            lease = self.memory.lease
            self.work.out.append(cmd.ReplyLease(token=event.token, lease=None if lease is None else lease.shown()))

    def _take(self, event: ev.LeaseAsked) -> None:
        """Also once more, by whoever has it: for so long from now on, at the rank it was taken with."""
        most_s, lease = self.work.config.lease.max_s, self.memory.lease
        for_s = most_s if event.for_s is None else event.for_s
        if for_s > most_s:
            message = f"for {for_s:g} s: at most {most_s:g} s (lease.max_s); take it again before they are over"
            raise RequestRefused("invalid", message, "$.for_s")
        ends_ns = self.work.t_ns + seconds(for_s)
        if lease is not None and lease.owner == event.owner:
            lease.ends_ns, lease.heard_ns = ends_ns, self.work.t_ns
            return
        if lease is not None and event.rank <= lease.rank:
            raise self._held_by(lease)
        if lease is not None:
            self.authority.end_lease(Over(reason=f"{event.owner} has taken it"))
        self.authority.grant(
            Manual(
                owner=event.owner,
                rank=event.rank,
                since_ns=self.work.t_ns,
                ends_ns=ends_ns,
                heard_ns=self.work.t_ns,
            )
        )

    def _renew(self, event: ev.LeaseAsked) -> None:
        self.own(event).heard_ns = self.work.t_ns

    def _give(self, event: ev.LeaseAsked) -> None:
        self.own(event)
        self.authority.end_lease(Over(reason=f"{event.owner} gave it back"))
        self.authority.take_next()

    def _ask(self, event: ev.LeaseAsked) -> None:
        lease = self.memory.lease
        if lease is None:
            raise RequestRefused("free", "nobody has the head for himself; take it", "$.wish")
        if lease.owner == event.owner:
            raise RequestRefused("invalid", f"{event.owner} has the head already", "$.owner")
        lease.wanted_by = event.owner

    def own(self, event: ev.LeaseAsked | ev.MoveAsked) -> Manual:
        """The lease of whoever speaks; RequestRefused when it is not his."""
        lease = self.memory.lease
        if lease is None:
            message = f"{event.owner} does not have the head, nobody has; take it (again)"
            raise RequestRefused("lost", message, "$.owner")
        if lease.owner != event.owner:
            raise self._held_by(lease)
        if (over := lease.over(self.work)) is not None:
            raise RequestRefused("lost", f"{over.reason}; take it again", "$.owner")
        return lease

    def _held_by(self, lease: Manual) -> RequestRefused:
        since_s = (self.work.t_ns - lease.since_ns) / 1e9
        until_s = (lease.ends_ns - self.work.t_ns) / 1e9
        message = (
            f"{lease.owner} has had the head for {since_s:.0f} s and may have it {until_s:.0f} s more; "
            "ask for it (wish `ask`), or take it with a higher rank"
        )
        return RequestRefused("leased", message, "$.owner")
