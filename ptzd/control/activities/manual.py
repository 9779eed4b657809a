"""A person has the head: nothing moves but what he moves."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from ptzd.control.activities.activity import Activity, Failure, Over, Step
from ptzd.control.planning.by_hand import FORESIGHT_S, at_rest_below_slowest, within_limits
from ptzd.control.states import State
from ptzd.control.work import Work, seconds
from ptzd.model import HeadReading, HeadSpeed, LeaseHeld

DEAD_MAN_S = 0.3
"""A speed lasts no longer without a newer word."""
SLOWED_SHARE = 0.1
"""Near a limit the camera is told of a slower speed in steps of this share."""


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
    doing: str = ""
    """``moving``, ``steering``, why the last move failed, or nothing."""
    target: HeadReading | None = None
    """Where it goes."""
    wanted: HeadSpeed | None = None
    """The speed that was asked for last."""
    sent: HeadSpeed | None = None
    """The speed that the camera was told."""
    steered_until_ns: int = 0

    def begin(self, work: Work) -> Step:
        """Nothing is asked of the head; also after a stop or a request of his own."""
        self.doing, self.target, self.wanted, self.sent = "", None, None, None
        return self.on_time(work)

    def phase_now(self) -> str:
        """See `Activity`."""
        return self.doing

    def go(self, work: Work, target: HeadReading) -> None:
        """Move there; replaces what his hand did before."""
        work.move(target)
        self.doing, self.target, self.wanted, self.sent = "moving", target, None, None

    def steer(self, work: Work, wanted: HeadSpeed) -> tuple[HeadSpeed, str]:
        """Turn at this speed for :data:`DEAD_MAN_S`; returns what the limits leave of it, and which."""
        self.doing, self.target, self.wanted = "steering", None, wanted
        self.steered_until_ns = work.t_ns + seconds(DEAD_MAN_S)
        return self._send(work, wanted)

    def on_reading(self, work: Work) -> Step:
        """On the way to a limit the speed falls."""
        if self.wanted is not None and self.sent is not None and work.t_ns < self.steered_until_ns:
            granted, _ = _granted(work, self.wanted)
            if _much_slower(granted, self.sent):
                self._send(work, self.wanted)
        return None

    def on_arrived(self, work: Work) -> Step:
        """It rests; from where it may not, by a zone that it was let pass, it moves off."""
        self.doing, self.target, self.wanted, self.sent = "", None, None, None
        reading = work.head.reading
        if reading is not None and work.reach.objection(reading) is not None:
            self.go(work, work.reach.nearest(reading))
        return None

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """He is told why, and may try something else."""
        del work
        self.doing, self.target, self.wanted, self.sent = failure.reason, None, None, None
        return None

    def _send(self, work: Work, wanted: HeadSpeed) -> tuple[HeadSpeed, str]:
        granted, slowed_by = _granted(work, wanted)
        self.sent = granted
        work.steer(granted, self.steered_until_ns)
        return granted, slowed_by

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


def _granted(work: Work, wanted: HeadSpeed) -> tuple[HeadSpeed, str]:
    """What limits and no-go zones leave of a speed, and which of them slowed it."""
    limits, reading = work.head.limits, work.head.reading
    if limits is None or reading is None:
        return wanted, ""
    granted, by_limits = within_limits(limits, reading, wanted)
    if granted.zoom_rate > 0 and (private := work.reach.private_in(reading)):
        granted, by_limits = replace(granted, zoom_rate=0.0), ", ".join(filter(None, (by_limits, private)))
    if not work.reach.has_ways:
        return granted, by_limits
    granted, by_zones = work.reach.slowed(work.drifting(), granted, FORESIGHT_S)
    return at_rest_below_slowest(granted), ", ".join(filter(None, (by_limits, by_zones)))


def _much_slower(granted: HeadSpeed, sent: HeadSpeed) -> bool:
    pairs = (
        (granted.pan_deg_s, sent.pan_deg_s),
        (granted.tilt_deg_s, sent.tilt_deg_s),
        (granted.zoom_rate, sent.zoom_rate),
    )
    return any(abs(now) < (1 - SLOWED_SHARE) * abs(before) for now, before in pairs)
