"""The hands of the daemon: one task per move, picture and match that the core asked for."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from functools import partial

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import DeviceError, DeviceRefused, PtzdError
from ptzd.model import HeadReading
from ptzd.ports import EventLog, MoveStalled, MoveSuperseded, Perception, PictureMissed, PtzHead
from ptzd.runtime.frames import FrameStore

Tell = Callable[[ev.Event], None]


class Hands:
    """Performs what takes time and tells the core how it went.

    Parameters
    ----------
    tell : callable
        :meth:`Pump.tell`.
    lost : callable
        Told of a :class:`DeviceError` of the head; whoever supervises the head tells the core.
    """

    def __init__(
        self,
        *,
        tell: Tell,
        lost: Callable[[DeviceError], None],
        head: PtzHead,
        perception: Perception,
        frames: FrameStore,
        log: EventLog,
    ) -> None:
        self._tell = tell
        self._lost = lost
        self._head = head
        self._perception = perception
        self._frames = frames
        self._log = log
        self.defect: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        """Raises what nobody expected: a daemon with a defect ends and says so, it does not wait for deadlines."""
        self._head_task: asyncio.Task[None] | None = None
        self._matches: set[asyncio.Task[None]] = set()
        self._stops: set[asyncio.Task[None]] = set()
        self._lenses: set[asyncio.Task[None]] = set()

    def perform(self, command: cmd.Command) -> None:
        """Start a command; returns at once."""
        match command:
            case cmd.MoveHead():
                self._replace_head_task(self._move(command.move_id, partial(self._head.move, command.target)))
            case cmd.SteerHead():
                steer = partial(self._head.steer, command.speed, command.until_ns)
                self._replace_head_task(self._move(command.move_id, steer))
            case cmd.GrabView():
                self._replace_head_task(self._grab(command))
            case cmd.SetLens():
                self._keep(self._lenses, self._lens(command))
            case cmd.StopHead():
                self._replace_head_task(None)
                self._keep(self._stops, self._stop())
            case cmd.RunMatch():
                self._keep(self._matches, self._match(command))
            case cmd.AbandonMatches():
                for task in self._matches:
                    task.cancel()
            case _:
                raise TypeError(f"{type(command).__name__} is not done by hand")

    async def close(self) -> None:
        """Cancel what is under way and wait until it is gone."""
        tasks = [*self._matches, *self._stops, *self._lenses, *([self._head_task] if self._head_task else [])]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self.defect.cancel()

    def _replace_head_task(self, work: Coroutine[None, None, None] | None) -> None:
        if self._head_task is not None:
            self._head_task.cancel()
        self._head_task = None if work is None else self._started(work)

    def _keep(self, tasks: set[asyncio.Task[None]], work: Coroutine[None, None, None]) -> None:
        task = self._started(work)
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    def _started(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.create_task(work)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        error = None if task.cancelled() else task.exception()
        if error is not None and not self.defect.done():
            self.defect.set_exception(error)

    async def _move(self, number: int, move: Callable[[], Awaitable[HeadReading]]) -> None:
        try:
            reading = await move()
        except MoveSuperseded:
            return
        except MoveStalled as stalled:
            where, reason = stalled.reading, stalled.reason
            self._tell(ev.HeadStalled(move_id=number, reading=where, reason=reason))
        except DeviceError as error:
            self._lost(error)
        else:
            self._tell(ev.HeadArrived(move_id=number, reading=reading))

    async def _lens(self, command: cmd.SetLens) -> None:
        number = command.lens_id
        try:
            await self._head.set_lens(command.lens)
        except DeviceRefused as error:
            self._tell(ev.LensAnswered(lens_id=number, refused=str(error)))
        except DeviceError as error:
            self._lost(error)
        else:
            self._tell(ev.LensAnswered(lens_id=number))

    async def _stop(self) -> None:
        try:
            await self._head.stop()
        except DeviceError as error:
            self._lost(error)
        else:
            self._tell(ev.HeadStopped())

    async def _grab(self, command: cmd.GrabView) -> None:
        number = command.grab_id
        try:
            picture, view = await self._head.grab(command.not_before_ns)
        except PictureMissed as missed:
            reason = str(missed)
            self._tell(ev.ViewMissed(grab_id=number, reason=reason))
            return
        except DeviceError as error:
            self._lost(error)
            return
        self._frames.add_view(picture)
        self._log.picture("/ptz/image", picture)
        self._tell(ev.ViewTaken(grab_id=number, view=view))

    async def _match(self, command: cmd.RunMatch) -> None:
        number = command.match_id
        fisheye, view = self._frames.fisheye(command.frame), self._frames.view(command.view.frame)
        if fisheye is None or view is None:
            which = "fisheye frame" if fisheye is None else "view"
            self._tell(ev.MatchFailed(match_id=number, reason=f"the {which} is gone"))
            return
        try:
            result = await self._perception.match(command, fisheye.jpeg, view.jpeg)
        except PtzdError as error:
            reason = str(error)
            self._tell(ev.MatchFailed(match_id=number, reason=reason))
        else:
            self._tell(ev.MatchFinished(match_id=number, result=result))
