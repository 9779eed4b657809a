"""Whose the head is: one holder, what waits behind it by rank, and what follows when an activity answers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from ptzd.control.activities.activity import Activity, Failure, Next, Over, Step
from ptzd.control.activities.goto import Goto
from ptzd.control.activities.home import Home, is_there
from ptzd.control.activities.lock import Lock
from ptzd.control.activities.manual import Manual
from ptzd.control.activities.patrol import Patrol
from ptzd.control.activities.scan import Scan
from ptzd.control.activities.stop import Stop
from ptzd.control.desk import Desk
from ptzd.control.head_state import Awaited
from ptzd.control.memory import AnyActivity, Claim, Memory
from ptzd.control.motor import Spent, spent
from ptzd.control.ranks import Rank
from ptzd.control.shadow import NOT_TOLD
from ptzd.control.work import Work, seconds
from ptzd.model import Outcome

NEVER_NS = 1 << 62
"""From when on a head goes home that is told not to by itself: a word that changes that finds its claim."""
MAX_RESCANS = 1
"""A target that was found and lost is searched for once more from the beginning."""


@dataclass(slots=True, kw_only=True)
class Authority:
    """Grants the head; nothing else changes the holder."""

    memory: Memory
    work: Work
    desk: Desk

    @property
    def stop_under_way(self) -> Stop | None:
        """The stop that is not confirmed yet."""
        holder = self.memory.holder
        return holder.activity if holder is not None and isinstance(holder.activity, Stop) else None

    @property
    def homing_ns(self) -> int | None:
        """When the head goes home if nothing comes between; None when it does not."""
        if self.memory.holder is not None or not self.memory.serving:
            return None
        found = next((claim.from_ns for claim in self.memory.claims if claim.rank == Rank.HOME), None)
        return None if found == NEVER_NS else found

    def apply(self, step: Step) -> None:
        """Go on as the holder's activity answered."""
        holder = self.memory.holder
        if holder is None:
            return
        step = self._told_refusals(holder.activity, step)
        if step is None:
            return
        if isinstance(step, Over):
            again = self._again(holder, step)
            if again is None:
                self.end(step)
                self.take_next()
                return
            step = again
        self.work.abandon()
        holder.activity = cast("AnyActivity", step.activity)
        self.apply(holder.activity.begin(self.work))

    def end(self, over: Over) -> None:
        """The holder's claim is over: what it had set going is dropped, and whoever asked hears of it.

        A person whose turn it is has the head at once, since that moves nothing; what else waits is begun by whoever
        called, when it may.
        """
        holder, self.memory.holder = self.memory.holder, None
        if holder is None:
            return
        in_motion = isinstance(holder.activity, Manual) and self.work.head.asked is not None
        if isinstance(holder.activity, Manual):
            self.work.leave_lens()
        if isinstance(holder.activity, Stop):
            self.desk.answer_stops(holder.activity.take_tokens(), over.reason)
        elif not isinstance(holder.activity, Home):
            self.work.abandon()
            if holder.task is not None:
                self.desk.end_served(holder, over)
            elif isinstance(holder.activity, Goto):
                self.desk.end_goto(holder.activity, over)
            elif isinstance(holder.activity, Patrol):
                self.desk.end_patrol(over)
            if not (isinstance(holder.activity, Manual) and holder.activity.stays):
                self.plan_homing()
        if over.stop or in_motion:
            self.stop()
        elif (first := self._next()) is not None and isinstance(first.activity, Manual):
            self.memory.claims.remove(first)
            self._begin(first)

    def end_request(self, outcome: Outcome, reason: str, probability: float | None = None) -> None:
        """End the request that is being served, if there is one."""
        if self.memory.task is not None:
            self.end(Over(outcome=outcome, reason=reason, probability=probability))

    def end_goto(self, outcome: Outcome, reason: str, *, stop: bool = False) -> None:
        """End the way to a named place, or the while there, if there is one."""
        over = Over(outcome=outcome, reason=reason, stop=stop)
        for waiting in list(self.memory.claims):
            if isinstance(waiting.activity, Goto):
                self.memory.claims.remove(waiting)
                self.desk.end_goto(waiting.activity, over)
        if self.memory.holder is not None and isinstance(self.memory.holder.activity, Goto):
            self.end(over)

    def rest_patrol(self, *, paused: str = "", from_ns: int | None = None, still: bool = False) -> None:
        """Take the head from a patrol, which waits where it was.

        Until nothing goes before it, until ``from_ns`` where that is given, or, ``paused`` by something, until a person
        lets it go on. With ``still`` a head that is under way for it stops.
        """
        holder, in_motion = self.memory.holder, self._moves_for_patrol
        if holder is not None and isinstance(holder.activity, Patrol):
            self.work.abandon()
            self.memory.holder = None
            self._keep(holder)
        claim, patrol = self.memory.patrol_claim, self.memory.patrol
        if claim is not None and patrol is not None:
            claim.from_ns = claim.from_ns if from_ns is None else from_ns
            patrol.paused = paused or patrol.paused
        if still and in_motion:
            self.stop()

    def wake_patrol(self) -> None:
        """A patrol that waits for quiet goes on as soon as nothing goes before it."""
        claim = self.memory.patrol_claim
        if claim is not None:
            claim.from_ns = None

    def end_patrol(self) -> None:
        """There is no patrol any more; a head that is under way for it stops, and goes home after a while."""
        in_motion, had_the_head = self._moves_for_patrol, self.memory.holder is self.memory.patrol_claim
        self.rest_patrol()
        claim = self.memory.patrol_claim
        if claim is None:
            return
        self.memory.claims.remove(claim)
        if had_the_head:
            self.plan_homing()
        if in_motion:
            self.stop()

    @property
    def patrol_ns(self) -> int | None:
        """When a patrol that waits for quiet may go on."""
        claim = self.memory.patrol_claim
        return None if claim is None or not self.memory.serving else claim.from_ns

    @property
    def _moves_for_patrol(self) -> bool:
        holder = self.memory.holder
        return holder is not None and isinstance(holder.activity, Patrol) and self.work.head.asked is not None

    def _keep(self, claim: Claim) -> None:
        """A patrol that something goes before waits for its turn."""
        if isinstance(claim.activity, Patrol):
            claim.activity.set_aside(self.work)
            self.insert(claim)

    def end_all(self, outcome: Outcome, reason: str) -> None:
        """Give every request its result; the head stays where it is, but for a stop under way.

        Whoever has it for himself keeps it.
        """
        self.set_lease_aside()
        self.rest_patrol(paused=reason)
        if self.stop_under_way is None:
            self.end(Over(outcome=outcome, reason=reason))
        self.end_goto(outcome, reason)
        for waiting in self.memory.waiting:
            self.desk.end_waiting(waiting, outcome, reason)
        self.forget_homing()

    @property
    def lease_ends_ns(self) -> int | None:
        """When the lease ends if nothing more is heard; None without one."""
        lease = self.memory.lease
        return None if lease is None else lease.until_ns(self.work)

    def grant(self, lease: Manual) -> None:
        """A person takes the head: whatever has it makes way, and the head stops under his hand."""
        self.forget_homing()
        self.insert(Claim(owner=lease.owner, rank=Rank.LEASE + lease.rank, activity=lease))
        if self.memory.task is not None:
            self.end(Over(outcome=Outcome.PREEMPTED, reason=f"{lease.owner} has taken the head", stop=True))
        elif self.memory.goto is not None:
            self.end_goto(Outcome.PREEMPTED, f"{lease.owner} has taken the head", stop=True)
        elif self.memory.holder is not None and self.stop_under_way is None:
            self.leave_home()
            self.stop()
        self.take_next()

    def lend(self, by: str) -> None:
        """A request of whoever has the head goes before his own hand."""
        lease = self.memory.lease
        if lease is not None and lease.owner == by:
            self.set_lease_aside()

    def take_back(self, lease: Manual) -> None:
        """Whoever has the head moves it by hand: whatever else he asked for is over."""
        reason = f"{lease.owner} moves the head by hand"
        for claim in list(self.memory.claims):
            if claim.task is not None and claim.rank > Rank.LEASE:
                self.desk.end_waiting(claim.task.request, Outcome.PREEMPTED, reason)
        self.end_goto(Outcome.PREEMPTED, reason)
        self.end_request(Outcome.PREEMPTED, reason)
        self.take_next()

    def end_lease(self, over: Over) -> None:
        """The head is nobody's own any more; a request of his that is being served goes on."""
        if self.memory.holder is not None and isinstance(self.memory.holder.activity, Manual):
            self.end(over)
        self.work.leave_lens()
        claims = self.memory.claims
        claims[:] = [claim for claim in claims if not isinstance(claim.activity, Manual)]
        for waiting in list(claims):
            if waiting.task is not None and waiting.rank > Rank.LEASE:
                # what he asked for under it waits as anybody's does: the next person's hand goes before it
                claims.remove(waiting)
                waiting.rank = Rank.REQUEST + waiting.task.request.priority
                self.insert(waiting)

    def expire(self) -> None:
        """End a lease whose time is over."""
        lease = self.memory.lease
        over = None if lease is None else lease.over(self.work)
        if over is not None:
            self.end_lease(over)
            self.take_next()

    def take_next(self) -> None:
        """Give the head to what waits and may begin."""
        while (claim := self._next()) is not None:
            self.memory.claims.remove(claim)
            self._begin(claim)

    def stop(self, token: int | None = None) -> None:
        """Stop the head: that outranks everything, and nothing begins before the camera has confirmed it."""
        self.set_lease_aside()
        self.rest_patrol()
        activity = self.stop_under_way or Stop()
        activity.begin(self.work)
        if token is not None:
            activity.tokens.append(token)
        self.memory.holder = Claim(owner="stop", rank=Rank.STOP, activity=activity)

    def stop_is_over(self, reason: str = "") -> None:
        """The camera stands, or with a reason: did not say so. Whoever asked hears of it."""
        if self.stop_under_way is not None:
            self.end(Over(reason=reason or (NOT_TOLD if self.work.config.shadow.enabled else "")))

    def leave_home(self) -> None:
        """The head is on its way home no more."""
        if self.memory.holder is not None and isinstance(self.memory.holder.activity, Home):
            self.work.abandon()
            self.memory.holder = None

    def plan_homing(self) -> None:
        """Go home after some quiet, unless the head is there or an operator holds it."""
        self.forget_homing()
        if not self.work.head.held and not is_there(self.work.config, self.work.head.reading):
            after_s = self.work.home_after_s
            from_ns = NEVER_NS if after_s is None else self.work.t_ns + seconds(after_s)
            self.memory.claims.append(Claim(owner="home", rank=Rank.HOME, activity=Home(), from_ns=from_ns))

    def replan_homing(self) -> None:
        """Where the head is to go home by itself, count its quiet anew from now."""
        if any(claim.rank == Rank.HOME for claim in self.memory.claims):
            self.plan_homing()

    def forget_homing(self) -> None:
        """The head stays where it is."""
        self.memory.claims[:] = [claim for claim in self.memory.claims if claim.rank != Rank.HOME]

    def go_home(self) -> None:
        """Send the head home now, unless something has it."""
        self.forget_homing()
        if self.memory.holder is None:
            self._begin(Claim(owner="home", rank=Rank.HOME, activity=Home()))

    def _next(self) -> Claim | None:
        """What begins now: the first that waits for its turn alone, when nothing that goes before it has the head."""
        memory, holder = self.memory, self.memory.holder
        first = next((claim for claim in memory.claims if claim.ready and not self._spent(claim)), None)
        if first is None or not memory.serving or memory.stopping:
            return None
        taken = holder is not None and (holder.rank >= Rank.REQUEST or holder.rank >= first.rank)
        kept = self.work.head.held and first.rank < Rank.GOTO
        return None if taken or kept else first

    def _spent(self, claim: Claim) -> Spent | None:
        """The motor's budget that keeps a claim waiting."""
        return spent(self.work.head.travel, self.work.config.motor, claim.rank, self.work.t_ns)

    @property
    def budget_frees_ns(self) -> int | None:
        """When something that waits for the motor's budget may begin, if nothing comes between."""
        if self.memory.holder is not None or not self.memory.serving:
            return None
        waits = [self._spent(claim) for claim in self.memory.claims if claim.ready]
        return min((found.frees_ns for found in waits if found is not None), default=None)

    def insert(self, claim: Claim, *, first: bool = False) -> None:
        """Let a claim wait behind those of its rank, or as the ``first`` of them."""
        before = claim.rank + 1 if first else claim.rank
        self.memory.claims.insert(sum(1 for other in self.memory.claims if other.rank >= before), claim)

    def set_lease_aside(self) -> None:
        """Whoever has the head for himself waits, until nothing that goes before him has it."""
        holder = self.memory.holder
        if holder is not None and isinstance(holder.activity, Manual):
            self.memory.holder = None
            self.insert(holder)

    def _begin(self, claim: Claim) -> None:
        """Give the head to a claim; one that cannot even begin leaves it to whoever has it."""
        before, self.memory.holder = self.memory.holder, claim
        step = self._told_refusals(claim.activity, claim.activity.begin(self.work))
        if isinstance(step, Over):
            self.memory.holder = before
            if claim.task is not None:
                self.desk.end_served(claim, step)
            elif isinstance(claim.activity, Goto):
                self.desk.end_goto(claim.activity, step)
            elif isinstance(claim.activity, Patrol):
                self.desk.end_patrol(step)
            return
        if claim.rank > Rank.HOME:
            self.forget_homing()
        if before is not None:
            self._keep(before)

    def tell_refusals(self) -> None:
        """A move that was asked for outside of a step, and that a zone did not let be made, is told all the same."""
        if self.work.refusal is not None:
            self.apply(None)

    def _told_refusals(self, activity: Activity, step: Step) -> Step:
        """Tell an activity, step by step, of the moves that a zone did not let it make."""
        while step is None and self.work.refusal is not None:
            reason, self.work.refusal = self.work.refusal, None
            step = activity.on_failed(self.work, Failure(what=Awaited.MOVE, reason=reason))
        self.work.refusal = None
        return step

    def _again(self, holder: Claim, over: Over) -> Next | None:
        """Search once more for what was found and lost; a client that had its lock has its whole time again."""
        task, lock = holder.task, holder.activity
        if not over.again or task is None or task.rescans >= MAX_RESCANS:
            return None
        request = task.request
        if isinstance(lock, Lock) and lock.locked_ns is not None:
            request.expires_ns += self.work.t_ns - request.accepted_ns
        task.rescans += 1
        request.adopt_newest()
        self.work.feedback(request.id, "note", text=f"{over.reason}; scanning again")
        return Next(activity=Scan(task=task))
