"""The pump: stamp → log → handle → log → perform → re-arm. No decision is taken here."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.ports import Bus, Clock, EventLog
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.hands import Hands

Observer = Callable[[int, ev.Event, list[cmd.Command]], None]
"""Shown stamp (ns), event and commands of every step after it was performed."""


class Pump:
    """Feeds one core and performs what it wants.

    Parameters
    ----------
    machine : Machine
        The core.
    clock, log, bus, frames
        The world as ports; ``frames`` holds the pictures.
    observers : tuple of Observer
        Shown every step, after the commands were written.
    """

    def __init__(
        self,
        *,
        machine: Machine,
        clock: Clock,
        log: EventLog,
        bus: Bus,
        frames: FrameStore,
        observers: tuple[Observer, ...] = (),
    ) -> None:
        self.machine = machine
        self.finished = asyncio.Event()
        self.hands: Hands | None = None
        self._clock = clock
        self._log = log
        self._bus = bus
        self._frames = frames
        self.observers = observers
        self._waiting: deque[ev.Event] = deque()
        self._draining = False
        self._sequence = 0
        self._told = asyncio.Event()

    def tell(self, event: ev.Event) -> None:
        """Tell the core something; it is stamped when its turn has come.

        Calls from within a performed command wait until that command's siblings are performed: the order of events is
        the order in which they were told.
        """
        self._waiting.append(event)
        if self._draining:
            return
        self._draining = True
        try:
            while self._waiting:
                self._step(self._waiting.popleft(), self._clock.now_ns())
        finally:
            self._draining = False
        self._told.set()

    def cut_log(self) -> None:
        """Begin a new log file between two events: a snapshot of the core opens it."""
        self._sequence += 1
        self._log.rotate(self._sequence, self._clock.now_ns(), self.machine.snapshot())

    def _step(self, event: ev.Event, t_ns: int) -> None:
        self._sequence += 1
        self._log.event(self._sequence, t_ns, event)
        commands = self.machine.handle(event, t_ns)
        for command in commands:
            self._log.command(self._sequence, t_ns, command)
        for command in commands:
            self._perform(command)
        for observer in self.observers:
            observer(t_ns, event, commands)
        if self._log.rotate_due() or isinstance(event, ev.SettingsChanged):
            self.cut_log()

    def _perform(self, command: cmd.Command) -> None:
        match command:
            case cmd.PinFrame():
                self._frames.pin(command.request_id, command.frame, command.instead_of)
            case cmd.ReleaseFrames():
                self._frames.release(command.request_id)
            case cmd.SpareMove():
                pass
            case cmd.Finished():
                self.finished.set()
            case cmd.RefuseMove():
                pass  # log and journal have it, and whoever wanted the move hears of it otherwise
            case (
                cmd.MoveHead()
                | cmd.SteerHead()
                | cmd.SetLens()
                | cmd.StopHead()
                | cmd.GrabView()
                | cmd.RunMatch()
                | cmd.AbandonMatches()
            ):
                if self.hands is not None:
                    self.hands.perform(command)
            case _:
                self._bus.perform(command)

    async def keep_deadlines(self) -> None:
        """Wake the core when it wants to be woken; runs until cancelled."""
        while True:
            self._told.clear()
            deadline = self.machine.deadline_ns()
            wait_s = None if deadline is None else max(deadline - self._clock.now_ns(), 0) / 1e9
            try:
                async with asyncio.timeout(wait_s):
                    await self._told.wait()
            except TimeoutError:
                if deadline is not None and self._clock.now_ns() >= deadline:
                    self.tell(ev.DeadlinePassed())
