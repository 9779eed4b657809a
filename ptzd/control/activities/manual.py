"""A person has the head: nothing moves but what he moves."""

from __future__ import annotations

from typing import ClassVar

from ptzd.control.activities.activity import Activity, Over, Step
from ptzd.control.states import State
from ptzd.control.work import Work, seconds
from ptzd.model import LeaseHeld


class Manual(Activity, kw_only=True, tag="manual"):
    """The head rests under somebody's hand; it is his until he gives it back, is silent, or his time is over."""

    state: ClassVar[State] = State.MANUAL
    owner: str
    rank: int
    since_ns: int
    ends_ns: int
    """At the latest."""
    heard_ns: int
    """His last word."""
    wanted_by: str = ""
    stays: bool = False
    """After an operator's stop: the head does not go home either when it is over."""

    def begin(self, work: Work) -> Step:
        """Nothing is asked of the head; also after a stop or a request of his own."""
        return self.on_time(work)

    def until_ns(self, work: Work) -> int:
        """When it is over if nothing more is heard."""
        return min(self.ends_ns, self.heard_ns + seconds(work.config.lease.silence_s))

    def over(self, work: Work) -> Over | None:
        """Why it is over; None while it lasts."""
        if work.t_ns < self.until_ns(work):
            return None
        silent = work.t_ns < self.ends_ns
        heard = f"{self.owner} has not been heard of for {work.config.lease.silence_s:g} s"
        return Over(reason=heard if silent else f"the time of {self.owner} is over")

    def shown(self) -> LeaseHeld:
        """As others see it."""
        return LeaseHeld(
            owner=self.owner, rank=self.rank, since_ns=self.since_ns, until_ns=self.ends_ns, wanted_by=self.wanted_by
        )

    def on_time(self, work: Work) -> Step:
        """See `Activity`."""
        return self.over(work)

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        return self.until_ns(work)
