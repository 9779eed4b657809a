"""What a log holds, told per request."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import msgspec

from ptzd.errors import LogError
from ptzd.evidence.story import Stories, Story
from ptzd.log.protobuf import NS
from ptzd.log.reader import LoggedEvent, LogReader
from ptzd.log.records import Torn
from ptzd.log.run_info import RunInfo
from ptzd.log.times import clock_time
from ptzd.log.topics import COMMAND, EVENT

_MESSAGES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class LogSummary:
    """One file."""

    path: Path
    size: int
    """Bytes."""
    run: RunInfo
    t_first_ns: int
    t_last_ns: int
    counts: dict[str, int]
    """Messages by topic."""
    stories: tuple[Story, ...]
    warnings: tuple[str, ...]
    """Messages of level warning and above."""
    torn: str
    """Why the file is not whole; empty when it is."""
    holes: tuple[str, ...]
    """What a recovery passed over and which events are missing, one phrase each."""

    @property
    def span_s(self) -> float:
        """From the first to the last message, s."""
        return (self.t_last_ns - self.t_first_ns) / NS


class _Message(msgspec.Struct):
    """The part of ``foxglove.Log`` that is shown."""

    level: int
    message: str


def describe(path: Path) -> LogSummary:
    """Read one file, whole or torn.

    Raises
    ------
    LogError
        Not a log of ptzd, or damaged.
    """
    counts: Counter[str] = Counter()
    warnings: list[str] = []
    times: list[int] = []
    torn, last = "", -1
    with LogReader(path) as log:
        run = log.run
        stories = Stories(metric=run.metric)
        holes = [f"a damaged part at byte {start} was passed over by a recovery" for start in log.passed_over]
        try:
            for entry in log.entries():
                counts[entry.topic] += 1
                times = [min([entry.log_ns, *times[:1]]), max([entry.log_ns, *times[1:]])]
                if entry.topic in {EVENT, COMMAND}:
                    told = log.decision(entry)
                    stories.tell(told)
                    if isinstance(told, LoggedEvent):
                        if last >= 0 and told.sequence > last + 1:
                            holes.append(f"events {last + 1} to {told.sequence - 1} are missing")
                        last = told.sequence
                elif entry.topic == "/log":
                    warnings += _warning(path, entry.data)
        except Torn as error:
            torn = str(error)
    return LogSummary(
        path=path,
        size=path.stat().st_size,
        run=run,
        t_first_ns=times[0] if times else 0,
        t_last_ns=times[-1] if times else 0,
        counts=dict(counts),
        stories=tuple(stories.all),
        warnings=tuple(warnings),
        torn=torn,
        holes=tuple(holes),
    )


def _warning(path: Path, data: bytes) -> list[str]:
    try:
        said = msgspec.json.decode(data, type=_Message)
    except msgspec.DecodeError as error:
        raise LogError(f"{path}: /log: {error}") from None
    return [said.message] if said.level >= 3 else []


def lines(summary: LogSummary) -> Iterator[str]:
    """The summary for a person."""
    run = summary.run
    yield f"{summary.path.name}: rig {run.rig}, file {run.file_index}, {summary.size / 1e6:.1f} MB"
    written = f"ptzd {run.versions.get('ptzd', '?')} ({run.versions.get('commit', 'commit not told')})"
    yield f"from {clock_time(summary.t_first_ns)} for {summary.span_s:.1f} s, written by {written}"
    if summary.torn:
        yield f"not whole: {summary.torn}"
    for hole in summary.holes:
        yield f"hole: {hole}"
    yield ", ".join(f"{topic} {count}" for topic, count in sorted(summary.counts.items()))
    for said in summary.warnings[:_MESSAGES]:
        yield f"warning: {said}"
    if len(summary.warnings) > _MESSAGES:
        yield f"… and {len(summary.warnings) - _MESSAGES} warnings more"
    for story in summary.stories:
        yield from story_lines(story)


def story_lines(story: Story) -> Iterator[str]:
    """One request's timeline for a person; times count from its arrival."""
    yield ""
    yield f"{story.id} {story.label}".rstrip() + f": {story.outcome}: {story.reason}".rstrip(": ")
    for step in story.steps:
        yield f"  {(step.t_ns - story.t_ns) / NS:8.3f} s  #{step.sequence:<7} {step.what:<10} {step.text}".rstrip()


def document(summary: LogSummary) -> dict[str, object]:
    """The summary for ``--json``."""
    return {
        "file": str(summary.path),
        "bytes": summary.size,
        "rig": summary.run.rig,
        "file_index": summary.run.file_index,
        "versions": dict(summary.run.versions),
        "t_first_ns": summary.t_first_ns,
        "t_last_ns": summary.t_last_ns,
        "counts": summary.counts,
        "warnings": list(summary.warnings),
        "torn": summary.torn,
        "holes": list(summary.holes),
        "requests": [_request(story) for story in summary.stories],
    }


def _request(story: Story) -> dict[str, object]:
    return {
        "id": story.id,
        "label": story.label,
        "t_ns": story.t_ns,
        "outcome": story.outcome,
        "reason": story.reason,
        "views": len({look.job.view.frame for look in story.looks}),
        "steps": [
            {"t_ns": step.t_ns, "sequence": step.sequence, "what": step.what, "text": step.text} for step in story.steps
        ],
    }
