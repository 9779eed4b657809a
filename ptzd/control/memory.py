"""Everything the core remembers: plain values, so that a snapshot at the head of a log file carries it all."""

from __future__ import annotations

from dataclasses import dataclass, field

from ptzd.control.activities.goto import Goto
from ptzd.control.activities.home import Home
from ptzd.control.activities.lock import Lock
from ptzd.control.activities.manual import Manual
from ptzd.control.activities.patrol import Patrol
from ptzd.control.activities.scan import Scan
from ptzd.control.activities.stop import Stop
from ptzd.control.commands import PublishStatus
from ptzd.control.head_state import HeadState
from ptzd.control.planning.ranges import RangeMap
from ptzd.control.requests import Request, Task
from ptzd.control.states import State
from ptzd.model import FrameRef, PatrolShown

AnyActivity = Scan | Lock | Home | Stop | Manual | Goto | Patrol
"""Every kind there is: a snapshot tells them apart by their tag."""


@dataclass(slots=True, kw_only=True)
class Claim:
    """Somebody's claim on the head."""

    owner: str
    """The request's id, or which of the daemon's own wishes it is."""
    rank: int
    activity: AnyActivity
    from_ns: int | None = None
    """Not before then; None: as soon as it may."""

    @property
    def ready(self) -> bool:
        """Whether it may have the head as soon as nothing goes before it."""
        return self.from_ns is None and not (isinstance(self.activity, Patrol) and self.activity.paused)

    @property
    def task(self) -> Task | None:
        """The request behind it; None for the daemon's own wishes."""
        return self.activity.task if isinstance(self.activity, Scan | Lock) else None


@dataclass(slots=True, kw_only=True)
class Ended:
    """A result that was given, kept so that the same id again is answered the same."""

    id: str
    ended_ns: int
    outcome: str


@dataclass(slots=True, kw_only=True)
class Memory:
    """The whole state of the core."""

    serving: bool = False
    """Both devices are well."""
    served: bool = False
    """They were, at least once: what is lost from then on is a fault."""
    stopping: bool = False
    """The daemon is to end."""
    finished: bool = False
    fisheye: str = "not seen yet"
    """``well``, or why not."""
    ptz: str = "not seen yet"
    head: HeadState = field(default_factory=HeadState)
    frames: list[FrameRef] = field(default_factory=list)
    holder: Claim | None = None
    """Whose the head is; None: nobody wants it."""
    claims: list[Claim] = field(default_factory=list)
    """What waits, by rank, and by its coming where ranks are equal."""
    ended: list[Ended] = field(default_factory=list)
    refused: list[Ended] = field(default_factory=list)
    """Puts that were refused: apart, so that a flood of them lets no request's end be forgotten."""
    ranges: RangeMap = field(default_factory=RangeMap)
    """How far away things are, as confirmed locks have taught."""
    due_since: str = ""
    """Names the window of the schedule that is due; empty: none is."""
    published: PublishStatus | None = None
    """The status that was told last."""

    @property
    def state(self) -> State:
        """Where the daemon is: from the shutdown, else from the devices, else from whoever holds the head."""
        if self.stopping:
            return State.STOPPED
        if not self.serving:
            return State.FAULT if self.served else State.STARTING
        return State.IDLE if self.holder is None else self.holder.activity.state_now()

    @property
    def task(self) -> Task | None:
        """The request that is being served."""
        return None if self.holder is None else self.holder.task

    @property
    def lease(self) -> Manual | None:
        """Who has the head for himself, also while it is stopped, lost or busy with a request of his."""
        claims = self.claims if self.holder is None else [self.holder, *self.claims]
        return next((claim.activity for claim in claims if isinstance(claim.activity, Manual)), None)

    @property
    def goto(self) -> Goto | None:
        """Where an operator sent the head, also while it waits for a stop to be confirmed."""
        claims = self.claims if self.holder is None else [self.holder, *self.claims]
        return next((claim.activity for claim in claims if isinstance(claim.activity, Goto)), None)

    @property
    def patrol_claim(self) -> Claim | None:
        """The patrol that has the head or waits for it."""
        claims = self.claims if self.holder is None else [self.holder, *self.claims]
        return next((claim for claim in claims if isinstance(claim.activity, Patrol)), None)

    @property
    def patrol(self) -> Patrol | None:
        """The patrol that is under way."""
        claim = self.patrol_claim
        return claim.activity if claim is not None and isinstance(claim.activity, Patrol) else None

    @property
    def patrol_shown(self) -> PatrolShown | None:
        """As others see it."""
        patrol, holder = self.patrol, self.holder
        return None if patrol is None else patrol.shown(has_the_head=holder is not None and holder.activity is patrol)

    def status(self, *, shadow: bool) -> PublishStatus:
        """The state as others see it; ``shadow``: nothing that is decided moves the camera."""
        return PublishStatus(
            state=self.state,
            active=self.task.request.id if self.task else None,
            phase=self.holder.activity.phase_now() if self.serving and self.holder else "",
            queue=tuple(request.id for request in self.waiting),
            fisheye=self.fisheye,
            ptz=self.ptz,
            held=self.head.held,
            lease=None if self.lease is None else self.lease.shown(),
            shadow=shadow,
            doubt=self.head.doubts.words,
            goto=None if self.goto is None else self.goto.shown(held=self.head.held),
            patrol=self.patrol_shown,
            home_after=self.head.home_after,
        )

    @property
    def waiting(self) -> list[Request]:
        """Requests that wait, in the order they will be served."""
        return [claim.task.request for claim in self.claims if claim.task is not None]
