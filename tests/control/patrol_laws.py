"""Laws of patrols over random lives: last in rank, ended by a word alone, and always resumed where they were."""

from __future__ import annotations

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.model import PatrolShown

STEPS = 400
"""More answers and deadlines than any life leaves waiting."""
ENDS = (ev.PatrolAsked, ev.PatrolDue, ev.SettingsChanged, ev.ShutdownRequested)


class PatrolLaws:
    """Looks at every step of a life."""

    def __init__(self) -> None:
        self.before: PatrolShown | None = None

    def check(self, life, event: ev.Event, commands: list[cmd.Command]) -> None:
        status, before = life.status, self.before
        self.before = patrol = status.patrol
        if life.machine.state is State.PATROL:
            assert patrol is not None
            assert patrol.phase in {"on the way", "there"}
            assert not patrol.paused
            assert status.queue == (), "a request goes before it"
            assert (status.lease, status.goto, status.active) == (None, None, None), "everybody goes before it"
            assert not status.held
            assert life.machine.deadline_ns() is not None, "it goes on or is told"
        elif patrol is not None:
            assert patrol.phase == ("paused" if patrol.paused else "waiting")
        over = any(isinstance(told, cmd.ReplyRefused) and told.code == "patrol_over" for told in commands)
        if before is not None and patrol is None:
            assert over or isinstance(event, ENDS), "nothing but a word, the schedule or the settings ends it"
        if before is not None and patrol is not None and before.paused and not patrol.paused:
            assert isinstance(event, ev.PatrolAsked | ev.PatrolDue), "what was paused goes on by a word"

    def resume(self, life) -> None:
        """Whatever had the head gives it back in the end: a patrol that nobody paused goes on where it was."""
        if life.machine.state is State.STOPPED or self.before is None or self.before.paused:
            return
        life.tell(ev.ControlReceived(token=None, verb=ev.Verb.RELEASE))
        place = self.before.place if self.before is not None else ""
        for _ in range(STEPS):
            if life.machine.state in {State.STARTING, State.FAULT}:
                life.act("well_ptz")
                life.act("well_fisheye")
            if life.machine.state is State.PATROL or self.before is None:
                break
            if life.head is not None or life.matches or life.stop_sent_ns is not None:
                life.act("answer")
            else:
                life.act("deadline")
        assert self.before is None or life.machine.state is State.PATROL, f"{life.machine.state}: it does not go on"
        assert self.before is None or self.before.place == place or self.before.trouble, "it goes on where it was"
