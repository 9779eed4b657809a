"""Stop, home, hold and the end of the daemon: what an operator may ask for at any time."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.desk import Desk
from ptzd.control.memory import Memory
from ptzd.control.states import SERVING, State
from ptzd.control.work import Work, seconds
from ptzd.errors import RequestRefused
from ptzd.model import HeadReading, Outcome


@dataclass(slots=True, kw_only=True)
class Operator:
    """The operator's part of the core."""

    work: Work
    desk: Desk

    @property
    def _memory(self) -> Memory:
        return self.work.memory

    def reply(self, token: int | None, outcome: str) -> None:
        """Answer a query that somebody waits for."""
        if token is not None:
            self.work.out.append(cmd.ReplyOutcome(token=token, outcome=outcome))

    def may_start(self) -> bool:
        """Whether the next waiting request may begin now."""
        memory = self._memory
        free = memory.state in {State.IDLE, State.HOME} and memory.active is None
        return free and not memory.held and memory.stop_until_ns is None

    def end_all(self, outcome: Outcome, reason: str) -> None:
        """Give every request its result."""
        if self._memory.active is not None:
            self.desk.end_active(outcome, reason)
        for waiting in list(self._memory.queue):
            self.desk.end_waiting(waiting, outcome, reason)

    def stop_or_home(self, event: ev.ControlReceived) -> None:
        """Stop pre-empts everything and nothing moves after it; home stops nothing but goes there at once.

        A camera that is lost is told to stop all the same, but whoever asked hears at once that nobody confirms it.
        """
        memory = self._memory
        serving = memory.state in SERVING
        if serving:
            memory.state = State.IDLE
        if event.verb is ev.Verb.STOP:
            memory.home_at_ns = None
            self.work.stop()
            if event.token is not None:
                memory.stop_tokens.append(event.token)
            if memory.ptz != "well":
                self._refuse_stops(memory.ptz)
        elif serving:
            self.go_home()
            self.reply(event.token, event.verb)
        else:
            message = f"the head cannot move: {memory.ptz}"
            self.work.out.append(cmd.ReplyRefused(token=event.token, code="device_lost", message=message, field="$"))

    def stop_confirmed(self) -> None:
        """The camera stands."""
        self._memory.stop_until_ns = None
        for token in self._memory.stop_tokens:
            self.reply(token, "stopped")
        self._memory.stop_tokens.clear()

    def stop_failed(self, reason: str) -> None:
        """The camera did not say that it stands: whoever asked hears so."""
        self._memory.stop_until_ns = None
        self._refuse_stops(reason)

    def _refuse_stops(self, reason: str) -> None:
        for token in self._memory.stop_tokens:
            self.desk.refuse(token, RequestRefused("device_lost", f"the stop is not confirmed: {reason}"))
        self._memory.stop_tokens.clear()

    def home(self) -> HeadReading:
        """Where the head rests."""
        home = self.work.config.home
        return HeadReading(pan_deg=home.pan_deg, tilt_deg=home.tilt_deg, zoom=home.zoom)

    def plan_homing(self) -> None:
        """Go home after the configured quiet time, unless the head is there or an operator holds it."""
        memory, ptz = self._memory, self.work.config.ptz
        home, now = self.home(), memory.reading
        there = (
            now is not None
            and abs(now.pan_deg - home.pan_deg) <= 2 * ptz.arrival_tolerance_deg
            and abs(now.tilt_deg - home.tilt_deg) <= 2 * ptz.arrival_tolerance_deg
            and abs(now.zoom - home.zoom) <= 2 * ptz.zoom_tolerance
        )
        wanted = not memory.held and not there
        memory.home_at_ns = self.work.t_ns + seconds(self.work.config.home.idle_s) if wanted else None

    def go_home(self) -> None:
        """Send the head home; a home outside the camera's own limits is not gone to."""
        memory = self._memory
        memory.home_at_ns = None
        if memory.limits is not None and memory.limits.contains(self.home()) and memory.stop_until_ns is None:
            self.work.move(self.home())
            memory.state = State.HOME

    def shut_down(self, reason: str) -> None:
        """Give every request its result, stop the head, and say Finished when it stands or is lost."""
        memory = self._memory
        self.end_all(Outcome.CANCELLED, reason)
        head_answers = memory.ptz == "well"
        memory.state = State.STOPPED
        memory.home_at_ns = None
        if head_answers:
            self.work.stop()
        else:
            self.stop_failed(reason)
            self._finish()

    def after_shutdown(self, event: ev.Event) -> None:
        """What still comes in after the shutdown began."""
        lost_head = isinstance(event, ev.DeviceLost) and event.device is ev.Device.PTZ
        if isinstance(event, ev.HeadStopped):
            self.stop_confirmed()
        elif lost_head or isinstance(event, ev.DeadlinePassed):
            self.stop_failed("the daemon is stopping")
        elif isinstance(event, ev.RequestReceived):
            self.desk.refuse(event.token, RequestRefused("stopping", "the daemon is stopping"), event.id)
        elif isinstance(event, ev.CancelReceived | ev.ControlReceived | ev.PayloadRefused | ev.UpdateReceived):
            self.desk.refuse(event.token, RequestRefused("stopping", "the daemon is stopping"))
        if self._memory.stop_until_ns is None:
            self._finish()

    def _finish(self) -> None:
        if not self._memory.finished:
            self._memory.finished = True
            self.work.out.append(cmd.Finished())
