"""The patrol: from place to place, a while at each, again and again; whatever else is wanted goes before it."""

from __future__ import annotations

from typing import ClassVar

from ptzd.control.activities.activity import Activity, Failure, Over, Step
from ptzd.control.motor import spent
from ptzd.control.planning.places import place_named, reading_at
from ptzd.control.ranks import Rank
from ptzd.control.states import State
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.model import HeadReading, PatrolShown
from ptzd.presets import Stay

LEAST_NS = 1_000_000_000
"""Who comes back to a place that has less than this left of its time goes on to the next one."""


class Patrol(Activity, kw_only=True, tag="patrol"):
    """After an interruption it goes back to the place where it was, for the rest of that place's time."""

    state: ClassVar[State] = State.PATROL
    name: str
    since_ns: int
    due_since: str = ""
    """The window of the schedule that began it; empty when a person did."""
    index: int = 0
    """Of the place among those of the patrol."""
    place: str = ""
    """Its name: settings that are read again may move it to another index."""
    target: HeadReading | None = None
    """Where the head was sent for it since it has it."""
    there_ns: int | None = None
    left_ns: int = 0
    """Of the time at this place, when it is begun or came back to; 0: all of it."""
    paused: str = ""
    """By whom or what; empty: it goes on as soon as it may."""
    missed: str = ""
    """The place that the head did not get to last, until it is there."""
    trouble: str = ""
    """Why."""

    def begin(self, work: Work) -> Step:
        """Go on where it was."""
        self.target = self.there_ns = None
        stays = self._stays(work)
        if self.place and self.index < len(stays) and stays[self.index].place == self.place:
            return self._go(work, stays)
        places = [stay.place for stay in stays]
        self.index, self.left_ns = places.index(self.place) if self.place in places else 0, 0
        return self._go(work, stays)

    def phase_now(self) -> str:
        """See `Activity`."""
        return "on the way" if self.there_ns is None else "there"

    def on_arrived(self, work: Work) -> Step:
        """Its time begins."""
        self.there_ns = work.t_ns
        if self.missed == self.place:
            self.missed = self.trouble = ""
        return None

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """It spends its time where the head is: a blocked head is not driven from place to place without end."""
        self.missed, self.trouble = self.place, f"the head did not get to {self.place}: {failure.reason}"
        self.target, self.there_ns = None, work.t_ns
        return None

    def on_time(self, work: Work) -> Step:
        """On to the next place, when the motor's budget has a share for it."""
        ends_ns = self.wakes_ns(work)
        if ends_ns is None or work.t_ns < ends_ns:
            return None
        stays = self._stays(work)
        following = (self.index + 1) % max(len(stays), 1)
        found = spent(work.head.travel, work.config.motor, Rank.PATROL, work.t_ns)
        if found is not None and stays and stays[following].place != self.place:
            self.missed, self.trouble = stays[following].place, f"{self.name} stays at {self.place}: {found.words}"
            self.left_ns += max(found.frees_ns - ends_ns, LEAST_NS)
            return None
        self.index, self.left_ns = following, 0
        return self._go(work, stays)

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        del work
        return None if self.there_ns is None else self.there_ns + self.left_ns

    def set_aside(self, work: Work) -> None:
        """Something else has the head: remember how much of this place's time is left."""
        if self.there_ns is None:
            return
        self.left_ns -= work.t_ns - self.there_ns
        self.target = self.there_ns = None
        if self.left_ns < LEAST_NS:
            self.index, self.place, self.left_ns = self.index + 1, "", 0
            stays = self._stays(work)
            self.index %= max(len(stays), 1)
            self.place = stays[self.index].place if stays else ""

    def _stays(self, work: Work) -> tuple[Stay, ...]:
        return work.config.presets.patrols.get(self.name, ())

    def _go(self, work: Work, stays: tuple[Stay, ...]) -> Step:
        """Send the head to the present place, or to the first after it that can be reached."""
        if not stays:
            return Over(reason=f"patrol {self.name} is no longer in presets.yaml")
        for _ in stays:
            stay = stays[self.index]
            self.place = stay.place
            try:
                target = reading_at(work.rig, work.config, work.reach, stay.place, place_named(work.config, stay.place))
                self._check_way(work, target)
            except RequestRefused as refused:
                self.missed, self.trouble = stay.place, f"{stay.place} is passed over: {refused.message}"
                self.index, self.left_ns = (self.index + 1) % len(stays), 0
                continue
            self.left_ns = self.left_ns or seconds(stay.dwell_s)
            if target == self.target:
                self.there_ns = work.t_ns
            else:
                self.target, self.there_ns = target, None
                work.move(target)
            return None
        return Over(reason=f"patrol {self.name} is over, none of its places can be reached; {self.trouble}")

    def _check_way(self, work: Work, target: HeadReading) -> None:
        way = work.way_to(target)
        if isinstance(way, str):
            raise RequestRefused("unreachable", way)

    def shown(self, *, has_the_head: bool) -> PatrolShown:
        """As others see it."""
        phase = self.phase_now() if has_the_head else "paused" if self.paused else "waiting"
        until_ns = self.there_ns + self.left_ns if has_the_head and self.there_ns is not None else None
        return PatrolShown(
            patrol=self.name,
            place=self.place,
            phase=phase,
            paused=self.paused,
            since_ns=self.since_ns,
            scheduled=bool(self.due_since),
            until_ns=until_ns,
            trouble=self.trouble,
        )
