"""The sans-IO core: who has the head, and what it does for them, as functions of what the daemon is told."""

from __future__ import annotations

import msgspec

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.memory import Memory
from ptzd.control.motor import Travel
from ptzd.control.parts import parts_of
from ptzd.control.planning.ranges import RangeMap
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
        self._parts = parts_of(memory, work)

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
        return None if self._memory.finished else self._parts.answers.deadline_ns()

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
            self._parts.operator.after_shutdown(event)
        else:
            self._parts.handlers[type(event)](event)
            self._parts.answers.answer_at_once()
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
