"""The sans-IO core: one request at a time, from a box in the fisheye to a held lock and back home."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from ptzd.config import Config, with_parts
from ptzd.control import commands as cmd
from ptzd.control import deadlines, lock, search
from ptzd.control import events as ev
from ptzd.control.desk import Desk
from ptzd.control.memory import Active, Awaited, Memory
from ptzd.control.operator import Operator
from ptzd.control.search import Ended, Found, Progress
from ptzd.control.states import SERVING, TRANSITIONS, ImpossibleEvent, State
from ptzd.control.work import Work
from ptzd.errors import RequestRefused
from ptzd.geometry.rig import Rig
from ptzd.model import Outcome

WELL = "well"
RING_FRAMES = 128
"""Fisheye frames that a request may name; at 30 fps 4 s, more than the default ``frame_max_age_s`` in use."""
MAX_RESCANS = 1
"""A target that was found and lost is searched for once more from the beginning."""


class Machine:
    """Decides everything; knows no clock, no device, no bus.

    Parameters
    ----------
    rig : Rig
        The calibration.
    config : Config
        The settings.
    memory : Memory, optional
        Where to go on from, see :meth:`restored`.
    """

    def __init__(self, rig: Rig, config: Config, memory: Memory | None = None) -> None:
        self._memory = memory or Memory()
        self._work = Work(rig=rig, config=config, memory=self._memory)
        self._desk = Desk(work=self._work)
        self._operator = Operator(work=self._work, desk=self._desk)
        self._handlers: dict[type[ev.Event], Callable[[Any], None]] = {
            ev.RequestReceived: self._on_request,
            ev.PayloadRefused: self._on_payload_refused,
            ev.UpdateReceived: self._on_update,
            ev.CancelReceived: self._on_cancel,
            ev.ControlReceived: self._on_control,
            ev.FrameArrived: self._on_frame,
            ev.HeadReady: self._on_head_ready,
            ev.DeviceLost: self._on_device_lost,
            ev.DeviceWell: self._on_device_well,
            ev.HeadPolled: self._on_polled,
            ev.ForeignMotion: self._on_foreign_motion,
            ev.HeadArrived: self._on_arrived,
            ev.HeadStalled: self._on_stalled,
            ev.HeadStopped: self._on_stopped,
            ev.ViewTaken: self._on_view,
            ev.GrabFailed: self._on_grab_failed,
            ev.MatchFinished: self._on_match,
            ev.MatchFailed: self._on_match_failed,
            ev.DeadlinePassed: self._on_deadline,
            ev.SettingsChanged: self._on_settings,
            ev.ShutdownRequested: self._on_shutdown,
        }

    @classmethod
    def restored(cls, rig: Rig, config: Config, snapshot: ev.Snapshot) -> Machine:
        """Build a core that goes on exactly where :meth:`snapshot` was taken."""
        return cls(rig, config, msgspec.convert(snapshot.state, Memory, strict=False))

    def snapshot(self, t_ns: int) -> ev.Snapshot:
        """Everything this core remembers, as the first event of a log file."""
        state: dict[str, object] = msgspec.to_builtins(self._memory)
        return ev.Snapshot(t_ns=t_ns, state=state)

    @property
    def state(self) -> State:
        """Where the daemon is."""
        return self._memory.state

    @property
    def config(self) -> Config:
        """The settings in force; with a snapshot of the same moment they make a core that goes on."""
        return self._work.config

    def deadline_ns(self) -> int | None:
        """When a DeadlinePassed event is wanted; None when nothing can time out."""
        return deadlines.next_deadline_ns(self._work)

    def handle(self, event: ev.Event) -> list[cmd.Command]:
        """Take one event and say what is to be done.

        Parameters
        ----------
        event : Event
            With ``t_ns`` not before that of the previous one.

        Returns
        -------
        list of Command
            In the order in which they are to be performed.

        Raises
        ------
        ImpossibleEvent
            When the table has no entry for the event in this state; nothing was changed.
        """
        memory, before = self._memory, self._memory.state
        allowed = TRANSITIONS.get((before, type(event)))
        if allowed is None:
            raise ImpossibleEvent(before, event)
        self._work.t_ns, self._work.out = event.t_ns, []
        if before is State.STOPPED:
            self._operator.after_shutdown(event)
        else:
            self._handlers[type(event)](event)
        if memory.state not in allowed:
            raise AssertionError(f"{before} → {memory.state} on {type(event).__name__} is not in the table")
        self._publish_status()
        return self._work.out

    # requests

    def _on_request(self, event: ev.RequestReceived) -> None:
        memory = self._memory
        if memory.state not in SERVING:
            why = f"the rig is in {memory.state}: fisheye: {memory.fisheye}; ptz: {memory.ptz}"
            self._desk.refuse(event.token, RequestRefused("device_lost", why), event.id)
            return
        request = self._desk.take(event)
        if request is None:
            return
        if self._desk.preempts(request):
            self._end(Outcome.PREEMPTED, f"request {request.id} came with priority {request.priority}")
        self._desk.confirm(event.token, request)
        self._start_next()

    def _on_payload_refused(self, event: ev.PayloadRefused) -> None:
        self._desk.refuse_payload(event)

    def _on_update(self, event: ev.UpdateReceived) -> None:
        request, active = self._desk.adopt_update(event), self._memory.active
        if request is not None and active is not None and active.request is request and active.lock is not None:
            self._apply_lock(lock.on_update(self._work, active))

    def _on_cancel(self, event: ev.CancelReceived) -> None:
        active = self._memory.active
        was_active = active is not None and active.request.id == event.id
        if was_active:
            self._end(Outcome.CANCELLED, "cancelled by the client")
            self._work.stop()
        elif (waiting := self._desk.find(event.id)) is not None:
            self._desk.end_waiting(waiting, Outcome.CANCELLED, "cancelled by the client")
        self._desk.answer_cancel(event)

    def _end(self, outcome: Outcome, reason: str, probability: float | None = None) -> None:
        """Give the active request its result and drop what it had set going."""
        self._work.abandon()
        self._desk.end_active(outcome, reason, probability)
        self._memory.state = State.IDLE
        self._operator.plan_homing()

    def _start_next(self) -> None:
        memory = self._memory
        while memory.queue and self._operator.may_start():
            memory.active = Active(request=memory.queue.pop(0))
            ended = search.begin(self._work, memory.active)
            if ended is None:
                memory.state, memory.home_at_ns = State.SCAN, None
            else:
                self._desk.end_active(ended.outcome, ended.reason)

    def _apply_scan(self, verdict: Progress) -> None:
        memory, active = self._memory, self._memory.active
        if active is None:
            raise AssertionError("a verdict without a request")
        if isinstance(verdict, Found):
            self._work.abandon()
            memory.state = State.LOCK
            self._apply_lock(lock.begin(self._work, active, verdict))
        elif isinstance(verdict, Ended):
            self._end(verdict.outcome, verdict.reason, verdict.probability)
            self._start_next()
        else:
            memory.state = State.MATCH if search.all_views_taken(self._work, active) else State.SCAN

    def _apply_lock(self, ended: Ended | None) -> None:
        active = self._memory.active
        if ended is None or active is None:
            return
        if lock.may_rescan(active, ended) and active.rescans < MAX_RESCANS:
            self._work.abandon()
            if lock.was_locked(active):
                active.request.expires_ns += self._work.t_ns - active.request.accepted_ns
            active.lock, active.rescans = None, active.rescans + 1
            active.request.adopt_newest()
            self._work.feedback("note", text=f"{ended.reason}; scanning again")
            again = search.begin(self._work, active)
            if again is None:
                self._memory.state = State.SCAN
                return
        self._end(ended.outcome, ended.reason, ended.probability)
        self._start_next()

    # operator

    def _on_control(self, event: ev.ControlReceived) -> None:
        if event.verb is ev.Verb.HOLD:
            self._memory.held, self._memory.home_at_ns = True, None
        elif event.verb is ev.Verb.RELEASE:
            self._release()
        else:
            self._work.abandon()
            self._operator.end_all(Outcome.CANCELLED, f"the operator asked for {event.verb}")
            self._operator.stop_or_home(event)
            return
        self._operator.reply(event.token, event.verb)

    def _release(self) -> None:
        memory, active = self._memory, self._memory.active
        memory.held = False
        if active is not None and active.lock is not None and active.lock.locked_ns is not None:
            self._end(Outcome.RELEASED, "released by the operator", active.lock.probability)
        self._start_next()

    def _on_stopped(self, event: ev.HeadStopped) -> None:
        del event
        self._operator.stop_confirmed()
        self._start_next()

    def _on_shutdown(self, event: ev.ShutdownRequested) -> None:
        self._work.abandon()
        self._operator.shut_down(event.reason)

    def _on_settings(self, event: ev.SettingsChanged) -> None:
        self._work.config = with_parts(self._work.config, event.parts)

    # devices

    def _on_frame(self, event: ev.FrameArrived) -> None:
        frames = self._memory.frames
        frames.append(event.frame)
        if len(frames) > RING_FRAMES:
            del frames[: len(frames) - RING_FRAMES]

    def _on_head_ready(self, event: ev.HeadReady) -> None:
        self._memory.limits, self._memory.reading = event.limits, event.reading

    def _on_device_lost(self, event: ev.DeviceLost) -> None:
        memory = self._memory
        if memory.active is not None:
            self._end(Outcome.DEVICE_LOST, f"{event.device}: {event.reason}")
        self._work.abandon()
        memory.state = State.STARTING if memory.state is State.STARTING else State.FAULT
        if event.device is ev.Device.FISHEYE:
            memory.fisheye = event.reason
            memory.frames.clear()
            if memory.ptz == WELL:
                self._work.stop()
        else:
            memory.ptz = event.reason
            self._operator.stop_failed(event.reason)

    def _on_device_well(self, event: ev.DeviceWell) -> None:
        memory = self._memory
        if event.device is ev.Device.FISHEYE:
            memory.fisheye = WELL
        else:
            memory.ptz = WELL
        all_well = memory.fisheye == memory.ptz == WELL and memory.limits is not None
        if memory.state not in SERVING and all_well:
            memory.state = State.IDLE
            self._operator.plan_homing()
            self._start_next()

    def _on_polled(self, event: ev.HeadPolled) -> None:
        self._memory.reading, self._memory.motion = event.reading, event.motion

    def _on_foreign_motion(self, event: ev.ForeignMotion) -> None:
        memory = self._memory
        memory.reading = event.reading
        if memory.state is State.HOME:
            self._work.abandon()
            memory.state = State.IDLE
        if memory.active is not None:
            self._end(Outcome.PREEMPTED, "somebody else moves the camera")
        memory.home_at_ns = None

    # answers to the work of the active request

    def _on_arrived(self, event: ev.HeadArrived) -> None:
        memory = self._memory
        memory.reading = event.reading
        if not self._work.answers_head(Awaited.MOVE, event.move_id):
            return
        if memory.state is State.HOME:
            memory.state = State.IDLE
        elif memory.active is not None:
            self._work.grab(memory.moved_ns)

    def _on_stalled(self, event: ev.HeadStalled) -> None:
        self._memory.reading = event.reading
        if self._work.answers_head(Awaited.MOVE, event.move_id):
            self._on_head_failed(event.reason)

    def _on_head_failed(self, reason: str) -> None:
        active = self._memory.active
        if self._memory.state is State.HOME:
            self._memory.state = State.IDLE
        elif active is not None and active.scan is not None:
            self._apply_scan(search.on_skip(self._work, active, reason))
        elif active is not None:
            confirmed = active.lock is not None and active.lock.confirmed
            self._end(Outcome.LOST if confirmed else Outcome.UNREACHABLE, reason)
            self._start_next()

    def _on_view(self, event: ev.ViewTaken) -> None:
        active = self._memory.active
        if not self._work.answers_head(Awaited.GRAB, event.grab_id) or active is None:
            return
        if active.scan is not None:
            self._apply_scan(search.on_view(self._work, active, event.view))
        else:
            lock.on_view(self._work, active, event.view)

    def _on_grab_failed(self, event: ev.GrabFailed) -> None:
        if self._work.answers_head(Awaited.GRAB, event.grab_id):
            self._on_head_failed(event.reason)

    def _on_match(self, event: ev.MatchFinished) -> None:
        active, answered = self._memory.active, self._work.answers_match(event.match_id)
        if answered is None or active is None:
            return
        if active.scan is not None:
            self._apply_scan(search.on_match(self._work, active, answered.view, event.result))
        else:
            self._apply_lock(lock.on_match(self._work, active, event.result))

    def _on_match_failed(self, event: ev.MatchFailed) -> None:
        active, answered = self._memory.active, self._work.answers_match(event.match_id)
        if answered is None or active is None:
            return
        if active.scan is not None:
            self._apply_scan(search.on_match_failed(self._work, active, event.reason))
        else:
            self._apply_lock(lock.on_unverified(self._work, active, event.reason))

    # time

    def _on_deadline(self, event: ev.DeadlinePassed) -> None:
        memory, t_ns = self._memory, event.t_ns
        if memory.stop_until_ns is not None and t_ns >= memory.stop_until_ns:
            self._operator.stop_failed("the camera did not confirm it in time")
            self._start_next()
        for waiting in [request for request in memory.queue if t_ns >= request.expires_ns]:
            self._desk.end_waiting(waiting, Outcome.TIMEOUT, "its time ran out while it waited")
        for late in [match for match in memory.matches if t_ns >= match.until_ns]:
            self._on_match_failed(ev.MatchFailed(t_ns=t_ns, match_id=late.id, reason="the matcher did not answer"))
        if memory.head is not None and t_ns >= memory.head.until_ns:
            kind, memory.head = memory.head.kind, None
            self._on_head_failed(f"the camera did not answer a {kind} in time")
        if memory.active is not None:
            self._on_request_deadline(memory.active)
        if memory.state is State.IDLE and memory.home_at_ns is not None and t_ns >= memory.home_at_ns:
            self._operator.go_home()

    def _on_request_deadline(self, active: Active) -> None:
        if not lock.was_locked(active) and self._work.t_ns >= active.request.expires_ns:
            self._end(Outcome.TIMEOUT, "not locked within timeout_s")
            self._work.stop()
        elif active.lock is not None:
            self._apply_lock(lock.on_deadline(self._work, active))

    def _status_now(self) -> cmd.PublishStatus:
        memory, active = self._memory, self._memory.active
        return cmd.PublishStatus(
            state=memory.state,
            active=active.request.id if active else None,
            phase=active.lock.phase if active and active.lock else "",
            queue=tuple(request.id for request in memory.queue),
            fisheye=memory.fisheye,
            ptz=memory.ptz,
            held=memory.held,
        )

    def _publish_status(self) -> None:
        status, told = self._status_now(), self._memory.published
        if status == told:
            return
        if self._memory.active is not None and (told is None or status.state != told.state):
            self._work.feedback("state", state=status.state, phase=status.phase)
        self._memory.published = status
        self._work.out.append(status)
