"""What clients ask for: a request, a newer box of one, its end."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import events as ev
from ptzd.control.activities.activity import Over
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.memory import Memory
from ptzd.errors import RequestRefused
from ptzd.model import Outcome


@dataclass(slots=True, kw_only=True)
class Reception:
    """The clients' part of the core."""

    memory: Memory
    desk: Desk
    authority: Authority

    def on_request(self, event: ev.RequestReceived) -> None:
        """Take it on, or refuse it before anything moves; it goes before whatever it outranks."""
        memory = self.memory
        if not memory.serving:
            why = f"the rig is in {memory.state}: fisheye: {memory.fisheye}; ptz: {memory.ptz}"
            self.desk.refuse(event.token, RequestRefused("device_lost", why), event.id)
            return
        request = self.desk.take(event)
        if request is None:
            return
        if self.desk.outranks_served(self.desk.rank(request.priority, request.by)):
            came = f"request {request.id} came with priority {request.priority}"
            self.authority.end_request(Outcome.PREEMPTED, came)
        self.authority.lend(request.by)
        self.desk.confirm(event.token, request)
        self.authority.take_next()

    def on_update(self, event: ev.UpdateReceived) -> None:
        """A newer box: the activity that serves the request decides when to look for it."""
        request, holder = self.desk.adopt_update(event), self.memory.holder
        if request is not None and holder is not None and holder.task is not None and holder.task.request is request:
            self.authority.apply(holder.activity.on_update(self.authority.work))

    def on_cancel(self, event: ev.CancelReceived) -> None:
        """Take it back, wherever it stands."""
        task = self.memory.task
        if task is not None and task.request.id == event.id:
            self.authority.end(Over(outcome=Outcome.CANCELLED, reason="cancelled by the client", stop=True))
        elif (waiting := self.desk.find(event.id)) is not None:
            self.desk.end_waiting(waiting, Outcome.CANCELLED, "cancelled by the client")
        self.desk.answer_cancel(event)
