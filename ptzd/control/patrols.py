"""Patrols: begun, paused and ended by a person's word or by the schedule."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.patrol import Patrol
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.memory import Claim, Memory
from ptzd.control.planning.places import place_named, reading_at
from ptzd.control.ranks import Rank
from ptzd.control.work import Work
from ptzd.errors import RequestRefused
from ptzd.presets import nearest_names

PAUSED_BY_WORD = "somebody paused it"


@dataclass(slots=True, kw_only=True)
class Patrols:
    """One patrol at a time; the last word counts, whether a person's or the schedule's."""

    memory: Memory
    work: Work
    desk: Desk
    authority: Authority

    def on_asked(self, event: ev.PatrolAsked) -> None:
        """Do as he wishes and say how the patrol stands."""
        wishes = {
            ev.PatrolWish.START: self._start,
            ev.PatrolWish.PAUSE: self._pause,
            ev.PatrolWish.RESUME: self._resume,
            ev.PatrolWish.STOP: self._stop,
        }
        try:
            wishes[event.wish](event)
        except RequestRefused as refused:
            self.desk.refuse_verb(event.token, refused)
            return
        if event.token is not None:
            self.work.out.append(cmd.ReplyPatrol(token=event.token, patrol=self.memory.patrol_shown))

    def on_due(self, event: ev.PatrolDue) -> None:
        """A window of the schedule began or ended; the patrol of one that a person ended before stays ended."""
        before, self.memory.due_since = self.memory.due_since, event.since
        if event.since == before:
            return
        patrol = self.memory.patrol
        scheduled = patrol is not None and bool(before) and patrol.due_since == before
        if patrol is not None and scheduled and patrol.name == event.patrol:
            patrol.due_since = event.since
            return
        if scheduled:
            self.authority.end_patrol()
        if event.since:
            self._begin(event.patrol, event.since)
        self.authority.take_next()

    def _start(self, event: ev.PatrolAsked) -> None:
        self._check(event.patrol)
        self._begin(event.patrol)
        self.authority.take_next()

    def _pause(self, event: ev.PatrolAsked) -> None:
        self.authority.rest_patrol(paused=self._present(event).paused or PAUSED_BY_WORD, still=True)

    def _resume(self, event: ev.PatrolAsked) -> None:
        self._present(event).paused = ""
        self.authority.wake_patrol()
        self.authority.take_next()

    def _stop(self, event: ev.PatrolAsked) -> None:
        self._present(event)
        self.authority.end_patrol()
        self.authority.take_next()

    def _begin(self, name: str, due_since: str = "") -> None:
        self.authority.end_patrol()
        stays = self.work.config.presets.patrols.get(name)
        place = stays[0].place if stays else ""
        patrol = Patrol(name=name, since_ns=self.work.t_ns, due_since=due_since, place=place)
        self.authority.insert(Claim(owner=name, rank=Rank.PATROL, activity=patrol))

    def _present(self, event: ev.PatrolAsked) -> Patrol:
        patrol = self.memory.patrol
        if patrol is None:
            raise RequestRefused("no_patrol", "no patrol is under way; start one", "$.wish")
        if event.patrol and event.patrol != patrol.name:
            raise RequestRefused("no_patrol", f"patrol {patrol.name} is under way, not {event.patrol}", "$.patrol")
        return patrol

    def _check(self, name: str) -> None:
        """Every place of it can be reached, as far as the head's limits are known."""
        work, presets = self.work, self.work.config.presets
        stays = presets.patrols.get(name)
        if stays is None:
            near = nearest_names(name, presets.patrols)
            raise RequestRefused("unknown_patrol", f"no patrol {name!r}; {near}", "$.patrol")
        if work.head.limits is None:
            return
        for stay in stays:
            try:
                reading_at(work.rig, work.config, work.reach, stay.place, place_named(work.config, stay.place))
            except RequestRefused as refused:
                raise RequestRefused(refused.code, f"patrol {name}: {refused.message}", "$.patrol") from None
