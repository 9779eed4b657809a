"""The desk: takes requests in, keeps them in order, and gives each exactly one result."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.control import admission
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.activity import Over
from ptzd.control.activities.goto import Goto
from ptzd.control.activities.lock import Lock, range_of
from ptzd.control.activities.scan import Scan
from ptzd.control.learning import learn
from ptzd.control.memory import AnyActivity, Claim, Ended, Memory
from ptzd.control.motor import Spent, spent
from ptzd.control.ranks import Rank
from ptzd.control.requests import Request, Task
from ptzd.control.shadow import as_shadow
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.model import REFUSED, FrameRef, Outcome

ENDED_KEPT = 1024
"""Results remembered for repeated ids, besides their age limit; and as many refusals."""


@dataclass(slots=True, kw_only=True)
class Desk:
    """Requests of one core; all it knows lies in the core's memory."""

    memory: Memory
    work: Work

    def requests(self) -> list[Request]:
        """The served request first, then the waiting ones in the order they will be served."""
        served = self.memory.task
        return ([served.request] if served else []) + self.memory.waiting

    def find(self, request_id: str) -> Request | None:
        """The active or waiting request of this id."""
        return next((request for request in self.requests() if request.id == request_id), None)

    def ended(self, request_id: str) -> str | None:
        """How a request of this id ended lately."""
        known = (*self.memory.ended, *self.memory.refused)
        return next((ended.outcome for ended in known if ended.id == request_id), None)

    def take(self, event: ev.RequestReceived) -> Request | None:
        """Admit a request into the queue and pin its frame; None when it was refused or is a repetition.

        The same id again is answered as the first time and changes nothing.
        """
        if self._answer_repeated(event):
            return None
        try:
            # first what costs nothing: under a flood most find no room, and the lens' rays take their time
            rank = self.rank(event.priority, event.by)
            self._check_room(rank)
            self._check_budget(event, rank)
            request = admission.admit(event, self.memory, self.work)
        except RequestRefused as refused:
            self.refuse(event.token, refused, event.id)
            return None
        self._place(request, rank)
        self._pin(request, request.frame)
        if (found := self.spent(rank)) is not None:
            text = f"waits {self._until_s(found):.0f} s for the motor's budget ({found.words})"
            self.work.feedback(request.id, "note", text=text)
        return request

    def rank(self, priority: int, by: str) -> int:
        """Where a request stands: whoever has the head for himself is served under his lease."""
        lease = self.memory.lease
        own = lease is not None and by == lease.owner
        return Rank.LEASE + lease.rank + 1 if own and lease is not None else Rank.REQUEST + priority

    def outranks_served(self, rank: int) -> bool:
        """Whether a request of this rank takes the place of the one that is being served."""
        holder = self.memory.holder
        served = holder is not None and holder.task is not None
        outranks = served and not self.memory.head.held and holder is not None and rank > holder.rank
        return outranks and self.spent(rank) is None

    def spent(self, rank: int) -> Spent | None:
        """The motor's budget that has no share left for this rank."""
        return spent(self.work.head.travel, self.work.config.motor, rank, self.work.t_ns)

    def why_it_waited(self, request: Request) -> str:
        """Why a request that waits is over when its time is."""
        found = self.spent(self.rank(request.priority, request.by))
        return "its time ran out while it waited" + (
            "" if found is None else f" for the motor's budget ({found.words})"
        )

    def confirm(self, token: int | None, request: Request) -> None:
        """Answer the query of an accepted request with its place: 0 = served next or now."""
        if token is None:
            return
        place = next((index for index, known in enumerate(self.requests()) if known is request), 0)
        self.work.out.append(cmd.ReplyAccepted(token=token, id=request.id, frame=request.frame, position=place))

    def refuse(self, token: int | None, refused: RequestRefused, request_id: str | None = None) -> None:
        """Answer with an error; where nobody waits for an answer but an id is known, give that id its result."""
        if token is not None:
            reply = cmd.ReplyRefused(token=token, code=refused.code, message=refused.message, field=refused.field)
            self.work.out.append(reply)
        elif request_id is not None and self.find(request_id) is None and self.ended(request_id) is None:
            outcome = Outcome.STALE_FRAME if refused.code == "stale_frame" else Outcome.REJECTED
            reason = f"{refused.field}: {refused.message}"
            self._publish(_bare_result(request_id, "", outcome, reason, elapsed_ms=0))

    def refuse_verb(self, token: int | None, refused: RequestRefused) -> None:
        """Answer an operator's query with an error; where nobody waits for an answer, the journal tells it."""
        reply = cmd.ReplyRefused(token=token, code=refused.code, message=refused.message, field=refused.field)
        self.work.out.append(reply)

    def refuse_payload(self, event: ev.PayloadRefused) -> None:
        """Say to whoever can be told that a message is none."""
        refused = RequestRefused(event.code, event.message, event.field)
        self.refuse(event.token, refused, event.id)
        if event.token is None and event.about is not None:
            self.note_refusal(event.about, "message", refused)

    def note_refusal(self, request_id: str, what: str, refused: RequestRefused) -> None:
        """Tell whoever follows a request what was refused of it."""
        detail: dict[str, object] = {"text": f"{what} refused: {refused.field}: {refused.message}"}
        self.work.out.append(cmd.PublishFeedback(id=request_id, step="note", detail=detail))

    def refuse_update(self, event: ev.UpdateReceived, refused: RequestRefused, *, told: bool) -> None:
        """Answer the query; tell a put's refusal as feedback when it is to be told."""
        if event.token is not None:
            self.refuse(event.token, refused)
        if told:
            self.note_refusal(event.id, "update", refused)

    def adopt_update(self, event: ev.UpdateReceived) -> Request | None:
        """Take a newer box of a request; None when it is not known or the update is not acceptable."""
        request = self.find(event.id)
        if request is None:
            unknown = RequestRefused("unknown_id", f"no request {event.id} is active or waiting", "$.id")
            self.refuse_update(event, unknown, told=event.told and event.token is None)
            return None
        memory, work = self.memory, self.work
        try:
            self._check_budget_of_update(request)
            region = admission.find_region(event, memory, work)
        except RequestRefused as refused:
            self.refuse_update(event, refused, told=True)
            return None
        if memory.task is not None and memory.task.request is request:
            request.newer = region
        else:
            request.region = region
        self._pin(request, region.frame)
        work.out.append(cmd.PublishFeedback(id=event.id, step="update", detail={"seq": region.frame.seq}))
        if event.token is not None:
            work.out.append(cmd.ReplyOutcome(token=event.token, outcome="updated"))
        return request

    def _pin(self, request: Request, frame: FrameRef) -> None:
        """Keep the newest box's frame and that of the look under way; however fast updates come, no more than that."""
        replaced = tuple(kept for kept in request.pinned if kept not in {request.frame, frame})
        request.pinned = [kept for kept in request.pinned if kept not in {*replaced, frame}] + [frame]
        self.work.out.append(cmd.PinFrame(request_id=request.id, frame=frame, instead_of=replaced))

    def answer_cancel(self, event: ev.CancelReceived) -> None:
        """Say how the request ended, by this cancel or before it."""
        outcome = self.ended(event.id)
        if outcome is None:
            message = f"no request {event.id} is active, waiting or lately ended"
            unknown = RequestRefused("unknown_id", message, "$.id")
            if event.token is None:
                self.note_refusal(event.id, "cancel", unknown)
            else:
                self.refuse(event.token, unknown)
        elif event.token is not None:
            self.work.out.append(cmd.ReplyOutcome(token=event.token, outcome=outcome))

    def end_waiting(self, request: Request, outcome: Outcome, reason: str) -> None:
        """Take a waiting request back with a result."""
        claims = self.memory.claims
        claims[:] = [claim for claim in claims if claim.task is None or claim.task.request is not request]
        elapsed_ms = (self.work.t_ns - request.accepted_ns) // 1_000_000
        self._publish(_bare_result(request.id, request.label, outcome, reason, elapsed_ms=elapsed_ms))
        self.work.out.append(cmd.ReleaseFrames(request_id=request.id))

    def end_served(self, claim: Claim, over: Over) -> None:
        """Give the request that was served its result."""
        if claim.task is None or over.outcome is None:
            raise AssertionError(f"the claim of {claim.owner} has no request to end")
        outcome, reason = as_shadow(claim.task, over.outcome, over.reason)
        if (doubt := self.memory.head.doubts.words) != "":
            reason = f"{reason}; beware, the head is in doubt: {doubt}"
        self._publish(self._result(claim.task, claim.activity, outcome, reason, over.probability))
        if isinstance(claim.activity, Lock):
            learn(self.work, claim.activity, outcome)
        self.work.out.append(cmd.ReleaseFrames(request_id=claim.task.request.id))

    def end_goto(self, goto: Goto, over: Over) -> None:
        """Tell whoever sent the head to a place why it is not there; whoever was told that it is hears no more."""
        if goto.there_ns is None:
            code = Outcome.UNREACHABLE if over.outcome is None else over.outcome
            self.refuse_verb(goto.token, RequestRefused(code.value, over.reason, "$.place"))

    def end_patrol(self, over: Over) -> None:
        """Nobody waits for the end of a patrol; the journal tells why it came."""
        self.refuse_verb(None, RequestRefused("patrol_over", over.reason, "$.patrol"))

    def reply(self, token: int | None, outcome: str) -> None:
        """Answer a query that somebody waits for."""
        if token is not None:
            self.work.out.append(cmd.ReplyOutcome(token=token, outcome=outcome))

    def answer_stops(self, tokens: list[int], reason: str) -> None:
        """Tell whoever asked for a stop that the camera stands, or why nobody can say so."""
        for token in tokens:
            if reason:
                code = "shadow" if self.work.config.shadow.enabled else "device_lost"
                self.refuse(token, RequestRefused(code, f"the stop is not confirmed: {reason}"))
            else:
                self.reply(token, "stopped")

    def _answer_repeated(self, event: ev.RequestReceived) -> bool:
        request, outcome = self.find(event.id), self.ended(event.id)
        if request is not None:
            self.confirm(event.token, request)
        elif outcome is not None and event.token is not None:
            message = f"request {event.id} ended already: {outcome}; use a new id"
            self.refuse(event.token, RequestRefused("ended", message, "$.id"))
        return request is not None or outcome is not None

    def _check_room(self, rank: int) -> None:
        memory = self.memory
        waiting = len(memory.waiting)
        leased = memory.lease is not None and rank < Rank.LEASE
        waits = memory.task is not None or memory.goto is not None or memory.head.held or leased or waiting > 0
        if waits and not self.outranks_served(rank) and waiting >= self.work.config.queue.size:
            message = f"{waiting} requests are waiting, no more fit; try later or with a higher priority"
            raise RequestRefused("busy", message, "$.priority")

    def _check_budget(self, event: ev.RequestReceived, rank: int) -> None:
        """Refuse what would wait for the motor's budget longer than it has time."""
        found = self.spent(rank)
        if found is None:
            return
        timeout_s = self.work.config.queue.timeout_s if event.timeout_s is None else event.timeout_s
        if self.work.t_ns + seconds(timeout_s) <= found.frees_ns:
            again = f"there is some again in {self._until_s(found):.0f} s"
            advice = "ask then, with a longer timeout_s or a higher priority"
            message = f"the motor's budget is spent ({found.words}); {again}: {advice}"
            raise RequestRefused("budget", message, "$.priority")

    def _check_budget_of_update(self, request: Request) -> None:
        """A target that goes on and on may not use up what is left to others: the head stays at its last place."""
        found = self.spent(self.rank(request.priority, request.by))
        served = self.memory.task is not None and self.memory.task.request is request
        if served and found is not None:
            message = (
                f"the motor's budget is spent ({found.words}); there is some again in {self._until_s(found):.0f} s"
            )
            raise RequestRefused("budget", message, "$.id")

    def _until_s(self, found: Spent) -> float:
        return (found.frees_ns - self.work.t_ns) / 1e9

    def _place(self, request: Request, rank: int) -> None:
        memory = self.memory
        claim = Claim(owner=request.id, rank=rank, activity=Scan(task=Task(request=request)))
        memory.claims.insert(sum(1 for other in memory.claims if other.rank >= rank), claim)

    def _publish(self, result: cmd.PublishResult) -> None:
        self.work.out.append(result)
        oldest = self.work.t_ns - seconds(self.work.config.queue.results_kept_s)
        remembered = self.memory.refused if result.outcome in REFUSED else self.memory.ended
        kept = [ended for ended in remembered if ended.ended_ns >= oldest]
        kept.append(Ended(id=result.id, ended_ns=self.work.t_ns, outcome=result.outcome))
        remembered[:] = kept[-ENDED_KEPT:]

    def _result(
        self, task: Task, activity: AnyActivity, outcome: Outcome, reason: str, probability: float | None
    ) -> cmd.PublishResult:
        request = task.request
        elapsed_ms = (self.work.t_ns - request.accepted_ns) // 1_000_000
        if not isinstance(activity, Lock) or activity.view is None:
            return _bare_result(request.id, request.label, outcome, reason, elapsed_ms, task.views, probability)
        lock, zoom = activity, activity.view.reading.zoom
        return cmd.PublishResult(
            id=request.id,
            outcome=outcome,
            reason=reason,
            label=request.label,
            elapsed_ms=elapsed_ms,
            views=task.views,
            pan_deg=math.degrees(lock.place.pan_rad),
            tilt_deg=math.degrees(lock.place.tilt_rad),
            zoom=zoom,
            hfov_deg=math.degrees(self.work.rig.zoom.camera_at(zoom).hfov_rad),
            box_ptz=lock.box_ptz,
            range_m=range_of(lock.place),
            probability=lock.probability,
            sigma_deg=lock.sigma_deg,
        )


def _bare_result(
    request_id: str,
    label: str,
    outcome: Outcome,
    reason: str,
    elapsed_ms: int,
    views: int = 0,
    probability: float | None = None,
) -> cmd.PublishResult:
    return cmd.PublishResult(
        id=request_id,
        outcome=outcome,
        reason=reason,
        label=label,
        elapsed_ms=elapsed_ms,
        views=views,
        probability=probability,
    )
