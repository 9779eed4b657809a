"""Stop, home, hold and the end of the daemon: what an operator may ask for at any time."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.activity import Over
from ptzd.control.activities.goto import Goto
from ptzd.control.activities.home import home_of
from ptzd.control.activities.lock import Lock
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.health import WELL
from ptzd.control.memory import Memory
from ptzd.control.work import Work
from ptzd.errors import RequestRefused
from ptzd.model import Outcome


@dataclass(slots=True, kw_only=True)
class Operator:
    """The operator's part of the core."""

    memory: Memory
    work: Work
    desk: Desk
    authority: Authority

    def on_control(self, event: ev.ControlReceived) -> None:
        """Do as the verb says and answer who asked."""
        if event.verb is ev.Verb.HOLD:
            self.work.head.held = True
            self.authority.forget_homing()
            self.authority.rest_patrol(still=True)
            self.desk.reply(event.token, event.verb)
        elif event.verb is ev.Verb.RELEASE:
            self._release()
            self.desk.reply(event.token, event.verb)
        elif event.verb is ev.Verb.HOME and (lease := self.memory.lease) is not None:
            message = f"{lease.owner} has the head for himself; it goes home when he gives it back"
            self.work.out.append(cmd.ReplyRefused(token=event.token, code="leased", message=message, field="$"))
        elif event.verb is ev.Verb.HOME and (closed := self._way_home_closed()) is not None:
            self.work.out.append(cmd.ReplyRefused(token=event.token, code="zone", message=closed, field="$"))
        else:
            self.work.abandon()
            self.authority.end_all(Outcome.CANCELLED, f"the operator asked for {event.verb}")
            if event.verb is ev.Verb.STOP:
                self._stop(event.token)
            else:
                self._home(event)

    def on_home_after(self, event: ev.HomeAfterAsked) -> None:
        """The head's quiet counts anew from now."""
        self.work.head.home_after = event.after
        self.authority.replan_homing()
        if event.token is not None:
            self.work.out.append(cmd.ReplyHomeAfter(token=event.token, after_s=self.work.home_after_s))

    def on_settings(self, event: ev.SettingsChanged) -> None:
        """Another ``home.idle_s`` is newer than what somebody said before."""
        told = self.work.head.home_after
        self.work.on_settings(event)
        if told is not None and self.work.head.home_after is None:
            self.authority.replan_homing()

    def on_stopped(self, event: ev.HeadStopped) -> None:
        """The camera stands."""
        del event
        self.work.came_to_rest(None)
        self.authority.stop_is_over()
        self.authority.take_next()

    def on_shutdown(self, event: ev.ShutdownRequested) -> None:
        """Give every request its result, stop the head, and say Finished when it stands or is lost."""
        self.work.abandon()
        self.authority.end_all(Outcome.CANCELLED, event.reason)
        self.authority.end_lease(Over(reason=event.reason))
        for lens in list(self.work.head.lenses):
            self.work.lens_over(lens.id, event.reason)
        self.authority.end_patrol()
        self.authority.forget_homing()
        self.memory.stopping = True
        if self.memory.ptz == WELL:
            self.authority.stop()
        else:
            self.authority.stop_is_over(event.reason)
            self._finish()

    def after_shutdown(self, event: ev.Event) -> None:
        """What still comes in after the shutdown began."""
        lost_head = isinstance(event, ev.DeviceLost) and event.device is ev.Device.PTZ
        if isinstance(event, ev.HeadStopped):
            self.authority.stop_is_over()
        elif lost_head or isinstance(event, ev.DeadlinePassed):
            self.authority.stop_is_over("the daemon is stopping")
        elif isinstance(event, ev.RequestReceived):
            self.desk.refuse(event.token, RequestRefused("stopping", "the daemon is stopping"), event.id)
        elif isinstance(
            event,
            ev.CancelReceived
            | ev.ControlReceived
            | ev.GotoAsked
            | ev.HomeAfterAsked
            | ev.PatrolAsked
            | ev.LeaseAsked
            | ev.MoveAsked
            | ev.RangesAsked
            | ev.PayloadRefused
            | ev.UpdateReceived,
        ):
            self.desk.refuse(event.token, RequestRefused("stopping", "the daemon is stopping"))
        if self.authority.stop_under_way is None:
            self._finish()

    def _release(self) -> None:
        """A lock that was held ends; what waits goes on."""
        self.work.head.held = False
        activity = None if self.memory.holder is None else self.memory.holder.activity
        if isinstance(activity, Lock) and activity.locked_ns is not None:
            self.authority.end_request(Outcome.RELEASED, "released by the operator", activity.probability)
        elif isinstance(activity, Goto) and activity.there_ns is not None:
            self.authority.end_goto(Outcome.RELEASED, "released by the operator")
        self.authority.take_next()

    def _stop(self, token: int | None) -> None:
        """Nothing moves after it. A camera that is lost is told all the same, but nobody confirms it."""
        self.authority.stop(token)
        if (lease := self.memory.lease) is not None:
            lease.stays = True
        stop = self.authority.stop_under_way
        if self.memory.ptz != WELL and stop is not None:
            self.desk.answer_stops(stop.take_tokens(), self.memory.ptz)

    def _way_home_closed(self) -> str | None:
        """Why the head does not go home; None when nothing is known that keeps it from there."""
        limits, home = self.work.head.limits, home_of(self.work.config)
        if limits is None or not limits.contains(home):
            return None
        way = self.work.way_to(home)
        return way if isinstance(way, str) else None

    def _home(self, event: ev.ControlReceived) -> None:
        """Stops nothing but goes there at once."""
        if self.memory.serving:
            self.authority.go_home()
            self.desk.reply(event.token, event.verb)
        else:
            message = f"the head cannot move: {self.memory.ptz}"
            self.work.out.append(cmd.ReplyRefused(token=event.token, code="device_lost", message=message, field="$"))

    def _finish(self) -> None:
        if not self.memory.finished:
            self.memory.finished = True
            self.work.out.append(cmd.Finished())
