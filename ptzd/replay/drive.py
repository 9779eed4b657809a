"""Drive the core from a log: the recorded events in, the commands compared with the recorded ones."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import ImpossibleEvent
from ptzd.errors import LogError, PtzdError
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LoggedCommand, LoggedEvent, LogReader
from ptzd.model import MatchResult
from ptzd.replay.compare import EXACT, Difference, Tolerance, differences

Matcher = Callable[[cmd.RunMatch, bytes, bytes], MatchResult]
"""Runs one match on the bytes of a fisheye frame and a view."""


@dataclass(slots=True, kw_only=True)
class Replay:
    """What a replay found."""

    events: int = 0
    commands: int = 0
    matches: int = 0
    """Match results computed anew."""
    t_first_ns: int = 0
    t_last_ns: int = 0
    recorded: dict[str, cmd.PublishResult] = field(default_factory=dict)
    """Results by request, as recorded."""
    replayed: dict[str, cmd.PublishResult] = field(default_factory=dict)
    differences: list[Difference] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether nothing differs."""
        return not self.differences

    @property
    def span_s(self) -> float:
        """Recorded time, s."""
        return (self.t_last_ns - self.t_first_ns) / 1e9


@dataclass(slots=True)
class _Step:
    """An event with the commands that were recorded for it."""

    logged: LoggedEvent
    commands: list[cmd.Command] = field(default_factory=list)


class Player:
    """Replays one file.

    Parameters
    ----------
    reader : LogReader
        The file, open.
    rig, config
        Those of the file, or others to see what would have been.
    matcher : callable, optional
        With it every match is run again on the recorded bytes, and the core is driven with the new results.
    tolerance : Tolerance
        What counts as equal.
    advanced : callable
        Told of every event's time, for a progress bar.
    """

    def __init__(
        self,
        *,
        reader: LogReader,
        rig: Rig,
        config: Config,
        matcher: Matcher | None = None,
        tolerance: Tolerance = EXACT,
        advanced: Callable[[int], None] = lambda t_ns: None,
    ) -> None:
        self._reader = reader
        self._rig = rig
        self._config = config
        self._matcher = matcher
        self._tolerance = tolerance
        self._advanced = advanced
        self._jobs: dict[int, cmd.RunMatch] = {}
        self._replay = Replay()

    def run(self) -> Replay:
        """Replay the file from its snapshot to its end.

        Raises
        ------
        LogError
            When the file has no snapshot at its head or is damaged.
        """
        machine: Machine | None = None
        for step in _steps(self._reader):
            event = step.logged.event
            if isinstance(event, ev.Snapshot):
                machine = machine or Machine.restored(self._rig, self._config, event)
                self._replay.t_first_ns = self._replay.t_first_ns or event.t_ns
                continue
            if machine is None:
                raise LogError(
                    f"{self._reader.path}: the first event is no snapshot; the file cannot be replayed alone"
                )
            self._play(machine, step)
        return self._replay

    def _play(self, machine: Machine, step: _Step) -> None:
        replay, sequence = self._replay, step.logged.sequence
        event = self._computed_anew(sequence, step.logged.event)
        replay.events += 1
        replay.t_last_ns = event.t_ns
        self._advanced(event.t_ns)
        try:
            commands = machine.handle(event)
        except (ImpossibleEvent, PtzdError) as error:
            self._differ(sequence, type(event).__name__, "handled", str(error))
            return
        replay.commands += len(step.commands)
        self._compare(sequence, step.commands, commands)
        for command in commands:
            if isinstance(command, cmd.RunMatch):
                self._jobs[command.match_id] = command
            if isinstance(command, cmd.PublishResult):
                replay.replayed[command.id] = command
        for command in step.commands:
            if isinstance(command, cmd.PublishResult):
                replay.recorded[command.id] = command

    def _computed_anew(self, sequence: int, event: ev.Event) -> ev.Event:
        if self._matcher is None or not isinstance(event, ev.MatchFinished):
            return event
        job = self._jobs.pop(event.match_id, None)
        if job is None:
            return event
        fisheye = self._reader.picture("/fisheye/image", job.frame)
        view = self._reader.picture("/ptz/image", job.view.frame)
        result = self._matcher(job, fisheye, view)
        self._replay.matches += 1
        for found in differences("MatchFinished.result", event.result, result, self._tolerance):
            self._differ(sequence, *found)
        return dataclasses.replace(event, result=dataclasses.replace(result, elapsed_ms=event.result.elapsed_ms))

    def _compare(self, sequence: int, recorded: list[cmd.Command], replayed: list[cmd.Command]) -> None:
        for index in range(max(len(recorded), len(replayed))):
            one = recorded[index] if index < len(recorded) else None
            other = replayed[index] if index < len(replayed) else None
            name = type(one if one is not None else other).__name__
            for found in differences(name, one, other, self._tolerance):
                self._differ(sequence, *found)

    def _differ(self, sequence: int, path: str, recorded: str, replayed: str) -> None:
        self._replay.differences.append(Difference(sequence=sequence, path=path, recorded=recorded, replayed=replayed))


def _steps(reader: LogReader) -> Iterator[_Step]:
    step: _Step | None = None
    for logged in reader.decisions():
        if isinstance(logged, LoggedEvent):
            if step is not None:
                yield step
            step = _Step(logged)
        elif isinstance(logged, LoggedCommand) and step is not None:
            step.commands.append(logged.command)
    if step is not None:
        yield step


def time_span_ns(path: Path) -> tuple[int, int]:
    """First and last event time of a file, for a progress bar."""
    with LogReader(path) as reader:
        times = [entry.log_ns for entry in reader.entries(("/event",))]
    if not times:
        raise LogError(f"{path}: no events; nothing to replay")
    return times[0], times[-1]
