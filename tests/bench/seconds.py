"""Where the seconds from a request to its lock go, from a log of the simulated rig: make demo, then

python -m tests.bench.seconds [LOG.mcap ...]

Ideal is what the head alone needs: its latency, its slew from where it was to where it locked, its swing, one picture.
"""

from __future__ import annotations

import statistics
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.log.reader import LoggedCommand, LogReader
from ptzd.model import HeadReading
from ptzd.sim.motion import Axis, AxisSpec
from ptzd.sim.profile import Profile, profile
from ptzd.sim.settings import SimSettings

STEPS = {
    cmd.MoveHead: "moves, until rest is proven",
    cmd.GrabView: "pictures, until one is taken at rest",
    cmd.RunMatch: "matches",
}
ENDS = {ev.HeadArrived: cmd.MoveHead, ev.ViewTaken: cmd.GrabView, ev.MatchFinished: cmd.RunMatch}
FRAME_S = 1.0 / 15.0
"""Of the PTZ stream in the demo."""


def ideal_s(kind: Profile, start: HeadReading, end: HeadReading) -> float:
    """Time until the head stands at another pose, and one picture."""
    ways = (
        (kind.pan, start.pan_deg, end.pan_deg),
        (kind.tilt, start.tilt_deg, end.tilt_deg),
        (kind.zoom, start.zoom, end.zoom),
    )
    return kind.timing.latency_s + max(slew_s(*way) for way in ways) + FRAME_S


def slew_s(spec: AxisSpec, start: float, end: float) -> float:
    axis = Axis(spec, t_s=0.0, x=start)
    axis.move_to(0.0, end)
    return axis.rest_s(0.0)


@dataclass(slots=True)
class Spent:
    """One request on its way to the lock."""

    start_ns: int
    start: HeadReading
    begun_ns: dict[type, int] = field(default_factory=dict)
    steps_s: Counter[str] = field(default_factory=Counter)
    matches: int = 0
    total_s: float = 0.0
    ideal_s: float = 0.0

    def command(self, command: cmd.Command, t_ns: int) -> None:
        self.begun_ns[type(command)] = t_ns
        self.matches += isinstance(command, cmd.RunMatch)

    def event(self, event: ev.Event, t_ns: int) -> None:
        begin = ENDS.get(type(event))
        if begin is not None and begin in self.begun_ns:
            self.steps_s[STEPS[begin]] += (t_ns - self.begun_ns.pop(begin)) / 1e9


def locked(log: Path) -> Iterator[Spent]:
    """Every request of a log that was locked."""
    kind = profile(SimSettings().profile)
    reading = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    request: Spent | None = None
    with LogReader(log) as reader:
        for told in reader.decisions():
            if isinstance(told, LoggedCommand):
                command = told.command
                if request is None:
                    continue
                request.command(command, told.t_ns)
                if isinstance(command, cmd.PublishFeedback) and command.step == "locked":
                    request.total_s = (told.t_ns - request.start_ns) / 1e9
                    request.ideal_s = ideal_s(kind, request.start, reading)
                    yield request
                    request = None
                continue
            event = told.event
            if isinstance(event, ev.RequestReceived):
                request = Spent(start_ns=told.t_ns, start=reading)
            elif request is not None:
                request.event(event, told.t_ns)
            if isinstance(event, ev.HeadPolled | ev.HeadArrived):
                reading = event.reading


def medians_s(logs: Sequence[Path]) -> dict[str, float]:
    """Medians over the requests of one view and one look that confirms."""
    found = [request for log in logs for request in locked(log) if request.matches == 2]
    told = {step: statistics.median(request.steps_s[step] for request in found) for step in STEPS.values()}
    told["request to lock"] = statistics.median(request.total_s for request in found)
    told["the head alone"] = statistics.median(request.ideal_s for request in found)
    told["ratio"] = statistics.median(request.total_s / request.ideal_s for request in found)
    return told


def main(logs: list[Path]) -> None:
    print("| requests of one view and one look that confirms, median | s |\n|---|---|")
    for what, seconds in medians_s(logs).items():
        print(f"| {what} | {seconds:.2f} |")


if __name__ == "__main__":
    main([Path(name) for name in sys.argv[1:]] or [max(Path("demo/log").glob("*.mcap"))])
