"""The desk: takes requests in, keeps them in order, and gives each exactly one result."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ptzd.control import admission, lock
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.memory import Active, Ended, Memory, Request
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.model import FrameRef, Outcome

ENDED_KEPT = 1024
"""Results remembered for repeated ids, besides their age limit."""


@dataclass(slots=True, kw_only=True)
class Desk:
    """Requests of one core; all it knows lies in the core's memory."""

    work: Work

    @property
    def _memory(self) -> Memory:
        return self.work.memory

    def requests(self) -> list[Request]:
        """The active request first, then the waiting ones in the order they will be served."""
        active = self._memory.active
        return ([active.request] if active else []) + self._memory.queue

    def find(self, request_id: str) -> Request | None:
        """The active or waiting request of this id."""
        return next((request for request in self.requests() if request.id == request_id), None)

    def ended(self, request_id: str) -> str | None:
        """How a request of this id ended lately."""
        return next((ended.outcome for ended in self._memory.ended if ended.id == request_id), None)

    def take(self, event: ev.RequestReceived) -> Request | None:
        """Admit a request into the queue and pin its frame; None when it was refused or is a repetition.

        The same id again is answered as the first time and changes nothing.
        """
        if self._answer_repeated(event):
            return None
        try:
            request = admission.admit(event, self._memory, self.work.rig, self.work.config)
            self._place(request)
        except RequestRefused as refused:
            self.refuse(event.token, refused, event.id)
            return None
        self._pin(request, request.frame)
        return request

    def preempts(self, request: Request) -> bool:
        """Whether this waiting request takes the active one's place."""
        active = self._memory.active
        return active is not None and not self._memory.held and request.priority > active.request.priority

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
        frame_ns, memory, work = event.frame_t_capture_ns, self._memory, self.work
        try:
            admission.check_box(event.box, work.rig)
            frame = admission.resolve_frame(event.frame_seq, frame_ns, memory, event.t_ns, work.config)
        except RequestRefused as refused:
            self.refuse_update(event, refused, told=True)
            return None
        if memory.active is not None and memory.active.request is request:
            request.newer_box, request.newer_frame = event.box, frame
        else:
            request.box, request.frame = event.box, frame
        self._pin(request, frame)
        work.out.append(cmd.PublishFeedback(id=event.id, step="update", detail={"seq": frame.seq}))
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
        """Take a request out of the queue with a result."""
        self._memory.queue.remove(request)
        elapsed_ms = (self.work.t_ns - request.accepted_ns) // 1_000_000
        self._publish(_bare_result(request.id, request.label, outcome, reason, elapsed_ms=elapsed_ms))
        self.work.out.append(cmd.ReleaseFrames(request_id=request.id))

    def end_active(self, outcome: Outcome, reason: str, probability: float | None = None) -> None:
        """Give the active request its result."""
        active = self._memory.active
        if active is None:
            raise AssertionError("no request to end")
        self._publish(self._result(active, outcome, reason, probability))
        self.work.out.append(cmd.ReleaseFrames(request_id=active.request.id))
        self._memory.active = None

    def _answer_repeated(self, event: ev.RequestReceived) -> bool:
        request, outcome = self.find(event.id), self.ended(event.id)
        if request is not None:
            self.confirm(event.token, request)
        elif outcome is not None and event.token is not None:
            message = f"request {event.id} ended already: {outcome}; use a new id"
            self.refuse(event.token, RequestRefused("ended", message, "$.id"))
        return request is not None or outcome is not None

    def _place(self, request: Request) -> None:
        memory = self._memory
        waits = memory.active is not None or memory.held or bool(memory.queue)
        if waits and not self.preempts(request) and len(memory.queue) >= self.work.config.queue.size:
            message = f"{len(memory.queue)} requests are waiting, no more fit; try later or with a higher priority"
            raise RequestRefused("busy", message, "$.priority")
        ahead = sum(1 for waiting in memory.queue if waiting.priority >= request.priority)
        memory.queue.insert(ahead, request)

    def _publish(self, result: cmd.PublishResult) -> None:
        self.work.out.append(result)
        oldest = self.work.t_ns - seconds(self.work.config.queue.results_kept_s)
        kept = [ended for ended in self._memory.ended if ended.ended_ns >= oldest]
        kept.append(Ended(id=result.id, ended_ns=self.work.t_ns, outcome=result.outcome))
        self._memory.ended = kept[-ENDED_KEPT:]

    def _result(self, active: Active, outcome: Outcome, reason: str, probability: float | None) -> cmd.PublishResult:
        request, place = active.request, active.lock
        elapsed_ms = (self.work.t_ns - request.accepted_ns) // 1_000_000
        if place is None or place.view is None:
            return _bare_result(request.id, request.label, outcome, reason, elapsed_ms, active.views, probability)
        zoom = place.view.reading.zoom
        return cmd.PublishResult(
            id=request.id,
            outcome=outcome,
            reason=reason,
            label=request.label,
            elapsed_ms=elapsed_ms,
            views=active.views,
            pan_deg=math.degrees(place.place.pan_rad),
            tilt_deg=math.degrees(place.place.tilt_rad),
            zoom=zoom,
            hfov_deg=math.degrees(self.work.rig.zoom.camera_at(zoom).hfov_rad),
            box_ptz=place.box_ptz,
            range_m=lock.range_of(place.place),
            probability=place.probability,
            sigma_deg=place.sigma_deg,
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
