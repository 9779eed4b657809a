"""What comes of the work that was asked for, and what happens when nothing comes in time."""

from __future__ import annotations

from dataclasses import dataclass

from ptzd.control import events as ev
from ptzd.control.activities.activity import Failure
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.head_state import Awaited
from ptzd.control.memory import Memory
from ptzd.control.shadow import note_missed
from ptzd.control.work import Work
from ptzd.model import Outcome


@dataclass(slots=True, kw_only=True)
class Answers:
    """Leads each answer to the activity that waits for it; late ones are known by their id and lead nowhere."""

    memory: Memory
    work: Work
    desk: Desk
    authority: Authority

    def on_arrived(self, event: ev.HeadArrived) -> None:
        """The head rests at the target."""
        self.work.came_to_rest(event.move_id, event.reading)
        if self.work.arrived(event.move_id, event.reading) and self.memory.holder is not None:
            self.authority.apply(self.memory.holder.activity.on_arrived(self.work))

    def answer_at_once(self) -> None:
        """No camera answers moves that a zone refused, and those that need no motor."""
        self.authority.tell_refusals()
        while self.work.spared and self.memory.holder is not None:
            if not self.work.answers_head(Awaited.MOVE, self.work.spared[-1]):
                return
            self.authority.apply(self.memory.holder.activity.on_arrived(self.work))

    def on_stalled(self, event: ev.HeadStalled) -> None:
        """The head rests elsewhere."""
        self.work.came_to_rest(event.move_id, event.reading)
        self.work.head.reading = event.reading
        if self.work.answers_head(Awaited.MOVE, event.move_id):
            self._failed(Awaited.MOVE, event.reason)

    def on_lens(self, event: ev.LensAnswered) -> None:
        """Focus and iris are as asked for, or not."""
        self.work.lens_over(event.lens_id, event.refused)

    def on_view(self, event: ev.ViewTaken) -> None:
        """A picture at rest."""
        if self.work.answers_head(Awaited.GRAB, event.grab_id) and self.memory.holder is not None:
            self.authority.apply(self.memory.holder.activity.on_picture(self.work, event.view))

    def on_view_missed(self, event: ev.ViewMissed) -> None:
        """A look that a shadow would have taken."""
        if self.work.answers_head(Awaited.GRAB, event.grab_id):
            if self.memory.task is not None:
                note_missed(self.work, self.memory.task)
            self._failed(Awaited.GRAB, event.reason)

    def on_match(self, event: ev.MatchFinished) -> None:
        """A matcher's answer."""
        answered = self.work.answers_match(event.match_id)
        if answered is not None and self.memory.holder is not None:
            self.authority.apply(self.memory.holder.activity.on_match(self.work, answered.view, event.result))

    def on_match_failed(self, event: ev.MatchFailed) -> None:
        """A matcher that could not run."""
        if self.work.answers_match(event.match_id) is not None:
            self._failed(Awaited.MATCH, event.reason)

    def on_deadline(self, event: ev.DeadlinePassed) -> None:
        """Time has passed: stops, waiting requests, answers that are late, the activity's own time, the way home."""
        memory, t_ns = self.memory, self.work.t_ns
        stop = self.authority.stop_under_way
        if stop is not None:
            self.authority.apply(stop.on_time(self.work))
        for waiting in [request for request in memory.waiting if t_ns >= request.expires_ns]:
            self.desk.end_waiting(waiting, Outcome.TIMEOUT, self.desk.why_it_waited(waiting))
        for late in [match for match in self.work.head.matches if t_ns >= match.until_ns]:
            if self.work.answers_match(late.id) is not None:
                self._failed(Awaited.MATCH, "the matcher did not answer")
        for lens in [lens for lens in self.work.head.lenses if t_ns >= lens.until_ns]:
            self.work.lens_over(lens.id, "the camera did not answer in time")
        asked = self.work.head.asked
        if asked is not None and t_ns >= asked.until_ns:
            self.work.head.asked = None
            self._failed(asked.kind, f"the camera did not answer a {asked.kind} in time")
        if memory.holder is not None and self.authority.stop_under_way is None:
            self.authority.apply(memory.holder.activity.on_time(self.work))
        self.authority.expire()
        patrol_ns = self.authority.patrol_ns
        if patrol_ns is not None and t_ns >= patrol_ns:
            self.authority.wake_patrol()
        if memory.holder is None or patrol_ns is not None:
            self.authority.take_next()  # what waited for quiet, or for the motor's budget
        homing_ns = self.authority.homing_ns
        if homing_ns is not None and t_ns >= homing_ns:
            self.authority.go_home()

    def deadline_ns(self) -> int | None:
        """Earliest of all deadlines, ns: armed exactly while something is under way or waits for its time."""
        memory, head = self.memory, self.work.head
        wanted = [
            None if head.asked is None else head.asked.until_ns,
            *(match.until_ns for match in head.matches),
            *(lens.until_ns for lens in head.lenses),
            *(request.expires_ns for request in memory.waiting),
            None if memory.holder is None else memory.holder.activity.wakes_ns(self.work),
            self.authority.homing_ns,
            self.authority.patrol_ns,
            self.authority.lease_ends_ns,
            self.authority.budget_frees_ns,
        ]
        return min((deadline for deadline in wanted if deadline is not None), default=None)

    def _failed(self, what: Awaited, reason: str) -> None:
        holder = self.memory.holder
        if holder is not None:
            self.authority.apply(holder.activity.on_failed(self.work, Failure(what=what, reason=reason)))
