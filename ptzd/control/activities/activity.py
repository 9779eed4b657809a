"""What every activity answers to, and what its answers mean.

The head serves exactly one activity at a time; the authority says whose. An activity asks for moves, pictures and
matches through `Work` and is told what came of them. Whatever it remembers are its fields, so that a snapshot holds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from msgspec import Struct

from ptzd.control.head_state import Awaited
from ptzd.control.states import State
from ptzd.control.work import Work
from ptzd.model import MatchResult, Outcome, ViewRef


@dataclass(frozen=True, slots=True, kw_only=True)
class Failure:
    """Something that was asked for did not come: the head stalled, no picture, no match, or no answer in time."""

    what: Awaited
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Next:
    """The same claim goes on with another activity."""

    activity: Activity


@dataclass(frozen=True, slots=True, kw_only=True)
class Over:
    """The activity is over, and with it the claim."""

    outcome: Outcome | None = None
    """What the client of a request hears; None where nobody asked for a result."""
    reason: str = ""
    probability: float | None = None
    again: bool = False
    """The target may be elsewhere: the request may begin once more from the start."""
    stop: bool = False
    """The head is under way for it and is to be stopped."""


Step = Next | Over | None
"""What an activity answers."""
GOES_ON: Step = None
"""Nothing follows yet."""
NEVER: int | None = None
"""When what waits for nothing wants to be woken."""


def out_of_time(work: Work, expires_ns: int) -> Over | None:
    """The client's time is kept: the end of a request that is not locked by then."""
    if work.t_ns < expires_ns:
        return None
    return Over(outcome=Outcome.TIMEOUT, reason="not locked within timeout_s", stop=True)


class Activity(Struct, kw_only=True, tag_field="activity"):
    """One thing the head is busy with; what it never asks for, it need not answer to."""

    state: ClassVar[State] = State.IDLE

    def state_now(self) -> State:
        """The daemon's state while this has the head."""
        return self.state

    def phase_now(self) -> str:
        """Where it stands inside that state; may be empty."""
        return ""

    def begin(self, work: Work) -> Step:
        """Take the head; the first thing it is told."""
        raise NotImplementedError

    def on_arrived(self, work: Work) -> Step:
        """The head rests where it was sent."""
        return GOES_ON

    def on_picture(self, work: Work, view: ViewRef) -> Step:
        """The picture that was asked for."""
        return GOES_ON

    def on_match(self, work: Work, view: int, result: MatchResult) -> Step:
        """What a matcher says of the view with this index."""
        return GOES_ON

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """What was asked for did not come."""
        return GOES_ON

    def on_update(self, work: Work) -> Step:
        """A newer box waits in the request."""
        return GOES_ON

    def on_reading(self, work: Work) -> Step:
        """The camera reported where the head is."""
        return GOES_ON

    def on_time(self, work: Work) -> Step:
        """Time has passed: whatever is due by ``work.t_ns``."""
        return GOES_ON

    def wakes_ns(self, work: Work) -> int | None:
        """When it wants `on_time`, ns; None: not of its own accord."""
        return NEVER
