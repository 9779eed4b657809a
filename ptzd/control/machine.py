"""The sans-IO core: who has the head, and what it does for them, as functions of what the daemon is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.answers import Answers
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.gotos import Gotos
from ptzd.control.health import Health
from ptzd.control.learning import Lessons
from ptzd.control.leases import Leases
from ptzd.control.memory import Memory
from ptzd.control.motor import Travel
from ptzd.control.moves import Moves
from ptzd.control.operator import Operator
from ptzd.control.patrols import Patrols
from ptzd.control.planning.ranges import RangeMap
from ptzd.control.reception import Reception
from ptzd.control.states import TRANSITIONS, ImpossibleEvent, State
from ptzd.control.work import Work
from ptzd.geometry.rig import Rig


class Machine:
    """Decides everything; knows no clock, no device, no bus.

    Parameters
    ----------
    rig, config
        The calibration, and the settings in force.
    memory : Memory, optional
        Where to go on from, see :meth:`restored`.
    """

    def __init__(self, rig: Rig, config: Config, memory: Memory | None = None) -> None:
        self._memory = memory = memory or Memory()
        self._work = work = Work(rig=rig, config=config, head=memory.head, ranges=memory.ranges)
        desk = Desk(memory=memory, work=work)
        authority = Authority(memory=memory, work=work, desk=desk)
        self._operator = operator = Operator(memory=memory, work=work, desk=desk, authority=authority)
        health = Health(memory=memory, work=work, authority=authority)
        reception = Reception(memory=memory, desk=desk, authority=authority)
        self._answers = answers = Answers(memory=memory, work=work, desk=desk, authority=authority)
        leases = Leases(memory=memory, work=work, desk=desk, authority=authority)
        patrols = Patrols(memory=memory, work=work, desk=desk, authority=authority)
        self._handlers: dict[type[ev.Event], Callable[[Any], None]] = {
            ev.RequestReceived: reception.on_request,
            ev.PayloadRefused: desk.refuse_payload,
            ev.UpdateReceived: reception.on_update,
            ev.CancelReceived: reception.on_cancel,
            ev.ControlReceived: operator.on_control,
            ev.LeaseAsked: leases.on_asked,
            ev.MoveAsked: Moves(memory=memory, work=work, leases=leases, authority=authority).on_asked,
            ev.GotoAsked: Gotos(memory=memory, work=work, desk=desk, authority=authority).on_asked,
            ev.RangesAsked: Lessons(work=work).on_asked,
            ev.PatrolAsked: patrols.on_asked,
            ev.PatrolDue: patrols.on_due,
            ev.FrameArrived: health.on_frame,
            ev.HeadReady: health.on_head_ready,
            ev.DeviceLost: health.on_lost,
            ev.DeviceWell: health.on_well,
            ev.HeadPolled: health.on_polled,
            ev.ForeignMotion: health.on_foreign_motion,
            ev.HeadArrived: answers.on_arrived,
            ev.HeadStalled: answers.on_stalled,
            ev.HeadStopped: operator.on_stopped,
            ev.LensAnswered: answers.on_lens,
            ev.ViewTaken: answers.on_view,
            ev.ViewMissed: answers.on_view_missed,
            ev.MatchFinished: answers.on_match,
            ev.MatchFailed: answers.on_match_failed,
            ev.DeadlinePassed: answers.on_deadline,
            ev.SettingsChanged: work.on_settings,
            ev.ShutdownRequested: operator.on_shutdown,
        }

    @classmethod
    def restored(cls, rig: Rig, config: Config, snapshot: ev.Snapshot) -> Machine:
        """Build a core that goes on exactly where :meth:`snapshot` was taken."""
        return cls(rig, config, msgspec.convert(snapshot.state, Memory, strict=False))

    def snapshot(self) -> ev.Snapshot:
        """Everything this core remembers, as the first event of a log file."""
        state: dict[str, object] = msgspec.to_builtins(self._memory)
        return ev.Snapshot(state=state)

    @property
    def state(self) -> State:
        """Where the daemon is."""
        return self._memory.state

    @property
    def config(self) -> Config:
        """The settings in force; with a snapshot of the same moment they make a core that goes on."""
        return self._work.config

    @property
    def ranges(self) -> RangeMap:
        """What confirmed locks have taught of the scene's ranges, for whoever keeps it."""
        return self._memory.ranges

    @property
    def travel(self) -> Travel:
        """What the motors have gone."""
        return self._memory.head.travel

    def deadline_ns(self) -> int | None:
        """When a DeadlinePassed event is wanted; None when nothing can time out."""
        return None if self._memory.finished else self._answers.deadline_ns()

    def handle(self, event: ev.Event, t_ns: int) -> list[cmd.Command]:
        """Take one event and say what is to be done.

        Parameters
        ----------
        event, t_ns
            What the core is told, and when on the daemon's steady clock, ns; not before the previous one.

        Returns
        -------
        list of Command
            In the order in which they are to be performed.

        Raises
        ------
        ImpossibleEvent
            When the table has no entry for the event in this state; nothing was changed.
        """
        before = self.state
        allowed = TRANSITIONS.get((before, type(event)))
        if allowed is None:
            raise ImpossibleEvent(before, event)
        self._work.begin(t_ns)
        if before is State.STOPPED:
            self._operator.after_shutdown(event)
        else:
            self._handlers[type(event)](event)
            self._answers.answer_at_once()
        if self.state not in allowed:
            raise AssertionError(f"{before} → {self.state} on {type(event).__name__} is not in the table")
        self._publish_status()
        return self._work.out

    def _publish_status(self) -> None:
        status, told = self._memory.status(shadow=self.config.shadow.enabled), self._memory.published
        if status == told:
            return
        if status.active is not None and (told is None or status.state != told.state):
            self._work.feedback(status.active, "state", state=status.state, phase=status.phase)
        self._memory.published = status
        self._work.out.append(status)
