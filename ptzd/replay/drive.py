"""Drive the core from a log: the recorded events in, the commands compared with the recorded ones."""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import msgspec

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.memory import Memory
from ptzd.control.states import ImpossibleEvent
from ptzd.errors import LogError, PtzdError
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LoggedEvent, LogReader
from ptzd.log.topics import FISHEYE_IMAGE, PTZ_IMAGE
from ptzd.model import MatchResult
from ptzd.replay.compare import EXACT, Difference, Tolerance, differences, kind, named_path
from ptzd.replay.wishes import Wish, note_wishes

Matcher = Callable[[cmd.RunMatch, bytes, bytes], MatchResult]
"""Runs one match on the bytes of a fisheye frame and a view."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hole:
    """Events that were recorded and are not in the file any more."""

    first: int
    """Sequence number of the first missing one."""
    last: int
    t_before_ns: int
    """Of the last event before them."""
    t_after_ns: int

    def __str__(self) -> str:
        seconds = (self.t_after_ns - self.t_before_ns) / 1e9
        return (
            f"events {self.first} to {self.last} are missing in the file ({seconds:.1f} s), a damaged part was passed "
            f"over: decisions are compared up to event {self.first - 1}"
        )


@dataclass(slots=True, kw_only=True)
class Replay:
    """What a replay found."""

    regime: str = ""
    """What was done and what counts as equal, for a person."""
    events: int = 0
    commands: int = 0
    matches: int = 0
    """Match results computed anew."""
    t_first_ns: int = 0
    t_last_ns: int = 0
    recorded: dict[str, cmd.PublishResult] = field(default_factory=dict)
    """Results by request, as recorded."""
    replayed: dict[str, cmd.PublishResult] = field(default_factory=dict)
    """A request that parted before its end has none: nobody took the pictures that it would have asked for."""
    holes: list[Hole] = field(default_factory=list)
    """Where events are missing in the file; behind the first one nothing is compared."""
    passed_over: list[int] = field(default_factory=list)
    """Bytes at which a recovery passed over a damaged part: pictures, or commands, or events, which are holes too."""
    shadow: list[Wish] = field(default_factory=list)
    """What a shadow would have moved, as replayed; empty for a log of a head that moved."""
    differences: list[Difference] = field(default_factory=list)
    """Of each request the first, and where it parts."""
    elapsed_s: float = 0.0
    reading_s: float = 0.0
    """Part of ``elapsed_s`` in which the file was read and decoded."""

    @property
    def same(self) -> bool:
        """Whether nothing differs."""
        return not self.differences

    @property
    def span_s(self) -> float:
        """Recorded time, s."""
        return (self.t_last_ns - self.t_first_ns) / 1e9

    @property
    def speed(self) -> float:
        """Recorded time over the time that the replay took."""
        return self.span_s / max(self.elapsed_s, 1e-9)


@dataclass(slots=True)
class _Step:
    """An event with the commands that were recorded for it."""

    sequence: int
    t_ns: int
    event: ev.Event
    commands: list[cmd.Command] = field(default_factory=list)
    whole: bool = True
    """Whether the next event in the file is the next one that was recorded, with no damaged part between; else commands
    may be missing too."""
    crossed: int = 0
    """Damaged parts before it."""

    def active(self, before: str) -> str:
        """Request that is served after it, as recorded; empty when none."""
        told = next((told for told in reversed(self.commands) if isinstance(told, cmd.PublishStatus)), None)
        return before if told is None else told.active or ""


class Player:
    """Replays one file.

    Every request is compared up to its first other decision. From there on the recording does not fit it any more, so
    the core is set back to where the recorded one stood when that request was over.

    Parameters
    ----------
    reader : LogReader
        The file, open.
    rig, config
        Those of the file, or others to see what would have been.
    recorded : tuple of Rig and Config, optional
        Those of the file, when the replayed core may decide otherwise on purpose or because of new match results.
    matcher : callable, optional
        With it every match is run again on the recorded bytes, and the core is driven with the new results.
    tolerance : Tolerance
        What counts as equal.
    untouched : Tolerance, optional
        The same for decisions of a request before any of its matches was computed anew; without it, the same.
    advanced : callable
        Told of every event's time, for a progress bar.
    """

    def __init__(
        self,
        *,
        reader: LogReader,
        rig: Rig,
        config: Config,
        recorded: tuple[Rig, Config] | None = None,
        matcher: Matcher | None = None,
        tolerance: Tolerance = EXACT,
        untouched: Tolerance | None = None,
        advanced: Callable[[int], None] = lambda t_ns: None,
    ) -> None:
        self._reader = reader
        self._rig = rig
        self._config = config
        self._recorded = recorded
        self._matcher = matcher
        self._tolerance = tolerance
        self._untouched = tolerance if untouched is None else untouched
        self._touched: set[str] = set()
        self._advanced = advanced
        self._machine: Machine | None = None
        self._reference: Machine | None = None
        self._active = ""
        self._before: _Step | None = None
        self._differing: set[str] = set()
        self._parted: set[str] = set()
        self._jobs: dict[int, cmd.RunMatch] = {}
        self._replay = Replay()

    def run(self) -> Replay:
        """Replay the file from its snapshot to its end.

        Raises
        ------
        LogError
            When the file has no snapshot at its head or is damaged.
        """
        replay, started = self._replay, time.perf_counter()
        replay.passed_over = list(self._reader.passed_over)
        steps = _steps(self._reader)
        while True:
            before = time.perf_counter()
            step = next(steps, None)
            replay.reading_s += time.perf_counter() - before
            if step is None:
                break
            self._note_hole(step)
            if replay.holes:
                continue
            if isinstance(step.event, ev.Snapshot):
                if not replay.t_first_ns:
                    self._begin(step.event, step.t_ns)
            elif not replay.t_first_ns:
                raise LogError(
                    f"{self._reader.path}: the first event is no snapshot; the file cannot be replayed alone"
                )
            else:
                self._play(step)
        replay.elapsed_s = time.perf_counter() - started
        return replay

    def _begin(self, snapshot: ev.Snapshot, t_ns: int) -> None:
        self._replay.t_first_ns = self._replay.t_last_ns = t_ns
        self._machine = Machine.restored(self._rig, self._config, snapshot)
        if self._recorded is not None:
            self._reference = Machine.restored(*self._recorded, snapshot)
        task = msgspec.convert(snapshot.state, Memory, strict=False).task
        self._active = task.request.id if task is not None else ""

    def _note_hole(self, step: _Step) -> None:
        """Behind a hole the core would decide on what it was not told, so only further holes are looked for."""
        before, self._before = self._before, step
        if before is not None and step.sequence > before.sequence + 1:
            self._replay.holes.append(
                Hole(
                    first=before.sequence + 1,
                    last=step.sequence - 1,
                    t_before_ns=before.t_ns,
                    t_after_ns=step.t_ns,
                )
            )

    def _play(self, step: _Step) -> None:
        replay = self._replay
        replay.events += 1
        replay.commands += len(step.commands)
        replay.t_last_ns = step.t_ns
        self._advanced(step.t_ns)
        if self._machine is None and self._reference is not None and self._active not in self._parted - {""}:
            self._machine = Machine.restored(self._rig, self._config, self._reference.snapshot())
        if self._machine is not None:
            self._decide(self._machine, step)
        if self._reference is not None:
            with contextlib.suppress(ImpossibleEvent, PtzdError):  # another version of the core; the comparison tells
                self._reference.handle(step.event, step.t_ns)
        replay.recorded |= {told.id: told for told in step.commands if isinstance(told, cmd.PublishResult)}
        self._active = step.active(self._active)

    def _decide(self, machine: Machine, step: _Step) -> None:
        event = self._computed_anew(step)
        try:
            commands = machine.handle(event, step.t_ns)
        except (ImpossibleEvent, PtzdError) as error:
            self._differ(step, self._active, type(event).__name__, "handled", str(error), parts=True)
            return
        if self._config.shadow.enabled:
            note_wishes(self._replay.shadow, step.t_ns, event, commands, step.active(self._active))
        self._jobs |= {told.match_id: told for told in commands if isinstance(told, cmd.RunMatch)}
        self._replay.replayed |= {told.id: told for told in commands if isinstance(told, cmd.PublishResult)}
        self._compare(step, commands)

    def _computed_anew(self, step: _Step) -> ev.Event:
        event = step.event
        if self._matcher is None or not isinstance(event, ev.MatchFinished) or event.match_id not in self._jobs:
            return event
        job = self._jobs.pop(event.match_id)
        before = time.perf_counter()
        try:
            fisheye = self._reader.picture(FISHEYE_IMAGE, job.frame)
            view = self._reader.picture(PTZ_IMAGE, job.view.frame)
        except LogError as error:
            self._differ(step, job.request_id, "MatchFinished.result", "computed", str(error))
            return event
        finally:
            self._replay.reading_s += time.perf_counter() - before
        self._replay.matches += 1
        self._touched.add(job.request_id)
        try:
            result = self._matcher(job, fisheye, view)
        except PtzdError as error:
            self._differ(step, job.request_id, "MatchFinished.result", "computed", str(error))
            return ev.MatchFailed(match_id=event.match_id, reason=str(error))
        for found in differences("MatchFinished.result", event.result, result, self._tolerance)[:1]:
            self._differ(step, job.request_id, *found)
        return dataclasses.replace(event, result=dataclasses.replace(result, elapsed_ms=event.result.elapsed_ms))

    def _compare(self, step: _Step, replayed: list[cmd.Command]) -> None:
        if not step.whole:
            return
        recorded = step.commands
        for index in range(max(len(recorded), len(replayed))):
            one = recorded[index] if index < len(recorded) else None
            other = replayed[index] if index < len(replayed) else None
            request = self._request_of(one, step) or self._request_of(other, step)
            tolerance = self._tolerance if request in self._touched else self._untouched
            found = differences(type(one or other).__name__, one, other, tolerance)
            if kind(one) != kind(other):
                self._differ(step, request, found[0][0], kind(one), kind(other), parts=True)
                return
            if found:
                self._differ(step, request, *found[0])

    def _request_of(self, command: cmd.Command | None, step: _Step) -> str:
        """Whose decision it is: it says so itself, or the event does, or it is for the one that is being served."""
        if command is None:
            return ""
        named = getattr(command, "request_id", None) or getattr(command, "id", None) or getattr(step.event, "id", None)
        return named or self._active or step.active(self._active)

    def _differ(
        self, step: _Step, request: str, path: str, recorded: str, replayed: str, *, parts: bool = False
    ) -> None:
        """Tell a request's first difference and where it parts; what follows from these is no news."""
        if request not in self._parted and (parts or request not in self._differing):
            self._replay.differences.append(
                Difference(
                    sequence=step.sequence,
                    event=type(step.event).__name__,
                    request=request,
                    path=named_path(path, metric=self._rig.metric),
                    recorded=recorded,
                    replayed=replayed,
                    parts=parts,
                )
            )
        self._differing.add(request)
        if parts:
            self._parted.add(request)
            self._jobs.clear()
            if self._reference is not None:
                self._machine = None


def _steps(reader: LogReader) -> Iterator[_Step]:
    step: _Step | None = None
    before = reader.crossed
    for logged in reader.decisions():
        crossed = reader.crossed - before
        if step is not None and crossed > step.crossed:
            step.whole = False
        if isinstance(logged, LoggedEvent):
            if step is not None:
                step.whole = step.whole and logged.sequence <= step.sequence + 1
                yield step
            step = _Step(logged.sequence, logged.t_ns, logged.event, crossed=crossed)
        elif step is not None:
            step.commands.append(logged.command)
    if step is not None:
        step.whole = step.whole and reader.crossed - before == step.crossed
        yield step
