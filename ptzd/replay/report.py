"""What a replay found, as lines for a person, as a document and as a JUnit report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree as Xml

import msgspec

from ptzd.replay.compare import Difference
from ptzd.replay.drive import Replay

RIG = "rig"
"""Name of what happens outside of any request."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """One file: what its replay found, or why it cannot be replayed."""

    path: Path
    replay: Replay | None = None
    error: str = ""

    @property
    def same(self) -> bool:
        """Replayed without any difference."""
        return self.replay is not None and self.replay.same


@dataclass(frozen=True, slots=True, kw_only=True)
class Story:
    """One request of a replay."""

    name: str
    ended: str
    """As recorded; empty when the file ends before."""
    would_end: str
    """As replayed; empty when nobody can know."""
    differences: tuple[Difference, ...]

    def __str__(self) -> str:
        ended = self.ended or "not ended in this file"
        if not self.differences:
            return f"{self.name}: {ended}"
        if self.would_end == self.ended:
            way = "by another way" if any(found.parts for found in self.differences) else "with other values"
            return f"{self.name}: {ended} all the same, {way}"
        if not self.would_end:
            return f"{self.name}: {ended}, replayed otherwise; to what end, the recording cannot tell"
        return f"{self.name}: {ended}, replayed {self.would_end}"

    def details(self) -> Iterator[str]:
        """Lines that say where the decisions differ."""
        for found in self.differences:
            yield str(found)
            if found.parts:
                yield "from there on the recording no longer fits; not compared further"


def stories(replay: Replay) -> list[Story]:
    """Every request that is recorded, replayed or differs, in this order; the rig itself last when it differs."""
    names = dict.fromkeys(
        [*replay.recorded, *replay.replayed, *(found.request for found in replay.differences if found.request)]
    )
    if any(not found.request for found in replay.differences):
        names[""] = None
    return [
        Story(
            name=name or RIG,
            ended=str(replay.recorded[name].outcome) if name in replay.recorded else "",
            would_end=str(replay.replayed[name].outcome) if name in replay.replayed else "",
            differences=tuple(found for found in replay.differences if found.request == name),
        )
        for name in names
    ]


def lines(report: Report) -> Iterator[str]:
    """Tell it to a person."""
    replay = report.replay
    if replay is None:
        yield report.error
        return
    told = stories(replay)
    differing = sum(bool(story.differences) for story in told)
    found = f"differences: {len(replay.differences)}, in {differing} of {len(told)} requests"
    verdict = found if differing else "no difference"
    gaps = len(replay.passed_over) or len(replay.holes)
    verdict += f", but {gaps} hole{'s' if gaps > 1 else ''} in the recording" if gaps else ""
    computed = f", {replay.matches} matches computed anew" if replay.matches else ""
    yield f"{report.path}: {verdict}: {replay.events} events, {replay.commands} commands{computed}"
    share = replay.reading_s / max(replay.elapsed_s, 1e-9)
    yield f"  {replay.regime}; {replay.speed:.0f}× real time, {share:.0%} of it reading"
    for hole in _holes(replay):
        yield f"  hole: {hole}"
    for story in told:
        yield f"  {story}"
        for line in story.details():
            yield f"    {line}"
    if replay.shadow:
        yield "  a shadow, nothing moved; it would have:"
        for wish in replay.shadow:
            yield f"    {wish}"


def _holes(replay: Replay) -> Iterator[str]:
    """What is missing in the recording, a phrase each."""
    for start in replay.passed_over:
        yield f"a damaged part at byte {start} was passed over by a recovery"
    yield from map(str, replay.holes)


def document(report: Report) -> dict[str, object]:
    """Tell it to a program."""
    replay = report.replay
    if replay is None:
        return {"file": str(report.path), "same": False, "error": report.error}
    return {
        "file": str(report.path),
        "same": replay.same,
        "regime": replay.regime,
        "events": replay.events,
        "commands": replay.commands,
        "matches": replay.matches,
        "requests": {name: result.outcome.value for name, result in replay.recorded.items()},
        "replayed": {name: result.outcome.value for name, result in replay.replayed.items()},
        "shadow": [msgspec.to_builtins(wish) for wish in replay.shadow],
        "holes": [msgspec.to_builtins(hole) for hole in replay.holes],
        "passed_over": list(replay.passed_over),
        "differences": [msgspec.to_builtins(found) for found in replay.differences],
        "speed_over_real_time": round(replay.speed, 1),
        "reading_share": round(replay.reading_s / max(replay.elapsed_s, 1e-9), 3),
    }


def junit(reports: Sequence[Report]) -> str:
    """Render JUnit XML: a suite per file, a case per request, and one for the file as a whole."""
    root = Xml.Element("testsuites", name="ptzd replay")
    for report in reports:
        told = stories(report.replay) if report.replay is not None else []
        cases = [story for story in told if story.name != RIG]
        suite = Xml.SubElement(
            root,
            "testsuite",
            name=report.path.name,
            tests=str(len(cases) + 1),
            failures=str(sum(bool(story.differences) for story in told)),
            errors=str(int(report.replay is None)),
        )
        elapsed_s = report.replay.elapsed_s if report.replay is not None else 0.0
        whole = Xml.SubElement(suite, "testcase", classname=report.path.stem, name=RIG, time=f"{elapsed_s:.3f}")
        if report.error:
            Xml.SubElement(whole, "error", message=report.error)
        if report.replay is not None and (holes := list(_holes(report.replay))):
            Xml.SubElement(whole, "system-out").text = "\n".join(holes)
        for story in told:
            case = whole
            if story.name != RIG:
                case = Xml.SubElement(suite, "testcase", classname=report.path.stem, name=story.name, time="0")
            if story.differences:
                failure = Xml.SubElement(case, "failure", message=str(story))
                failure.text = "\n".join(story.details())
    Xml.indent(root)
    return Xml.tostring(root, encoding="unicode", xml_declaration=True) + "\n"
