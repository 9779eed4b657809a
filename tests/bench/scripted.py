"""A rig without waiting: the real core and the real matcher on rendered pictures, the head's time by its kinematics.

What moves and pictures take is counted, not waited for, so that thousands of requests take minutes.
"""

from __future__ import annotations

import copy
import heapq
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.memory import Memory
from ptzd.control.planning.ranges import RangeMap
from ptzd.geometry.rig import Rig
from ptzd.matching.inputs import MatchInputs
from ptzd.matching.job import match
from ptzd.model import Box, FrameRef, HeadLimits, HeadReading, ViewRef
from ptzd.sim.motion import AxisSpec, plan_move
from ptzd.sim.profile import V5915

REST_PROVEN_S = 0.55
"""After the motors rest: settle time, stable position reports and their lag."""
PICTURE_S = 0.2
MATCH_S = 0.03
START_NS = 1_800_000_000_000_000_000
SECOND_NS = 1_000_000_000
LONGEST_S = 120.0
HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
LIMITS = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))

View = Callable[[HeadReading], np.ndarray]
"""Draws the grey picture at a pose."""


def move_s(start: HeadReading, end: HeadReading) -> float:
    """How long the slowest axis takes."""

    def axis_s(spec: AxisSpec, x: float, target: float) -> float:
        return plan_move(0.0, x, 0.0, target, spec.v_max, spec.a_max).end_s

    return max(
        axis_s(V5915.pan, start.pan_deg, end.pan_deg),
        axis_s(V5915.tilt, start.tilt_deg, end.tilt_deg),
        axis_s(V5915.zoom, start.zoom, end.zoom),
    )


@dataclass(kw_only=True)
class Request:
    """One request from the head's home to its end."""

    rig: Rig
    config: Config
    fisheye: np.ndarray
    view: View
    box: Box
    ranges: RangeMap
    """Copied: what this request teaches is in the copy."""
    taken: list[HeadReading] = field(default_factory=list)
    result: cmd.PublishResult | None = None
    locked_s: float | None = None

    def __post_init__(self) -> None:
        self.machine = Machine(self.rig, self.config, Memory(ranges=copy.deepcopy(self.ranges)))
        self._t_ns = START_NS
        self._reading = HOME
        self._pictures: dict[int, np.ndarray] = {}
        self._answers: list[tuple[int, int, ev.Event]] = []
        self._count = 0

    def run(self) -> Request:
        """Serve it; what came of it is in the fields."""
        frame = FrameRef(seq=0, t_capture_ns=START_NS)
        opening = (
            ev.HeadReady(limits=LIMITS, reading=HOME),
            ev.DeviceWell(device=ev.Device.PTZ),
            ev.DeviceWell(device=ev.Device.FISHEYE),
            ev.FrameArrived(frame=frame),
            ev.RequestReceived(token=None, id="asked", box=self.box, hold_s=0.0),
        )
        for event in opening:
            self._tell(event)
        while self.result is None and self._t_ns < START_NS + LONGEST_S * SECOND_NS:
            deadline = self.machine.deadline_ns()
            if self._answers and (deadline is None or self._answers[0][0] <= deadline):
                self._t_ns, _, event = heapq.heappop(self._answers)
                self._reading = event.reading if isinstance(event, ev.HeadArrived) else self._reading
                self._tell(event)
            elif deadline is not None:
                self._t_ns = max(self._t_ns, deadline)
                self._tell(ev.DeadlinePassed())
        return self

    def _tell(self, event: ev.Event) -> None:
        for command in self.machine.handle(event, self._t_ns):
            self._perform(command)

    def _answer(self, delay_s: float, event: ev.Event) -> None:
        self._count += 1
        heapq.heappush(self._answers, (self._t_ns + round(delay_s * 1e9), self._count, event))

    def _perform(self, command: cmd.Command) -> None:
        match command:
            case cmd.MoveHead():
                self._answers = [entry for entry in self._answers if not isinstance(entry[2], ev.HeadArrived)]
                heapq.heapify(self._answers)
                after_s = move_s(self._reading, command.target) + REST_PROVEN_S
                self._answer(after_s, ev.HeadArrived(move_id=command.move_id, reading=command.target))
            case cmd.GrabView():
                self.taken.append(self._reading)
                seq = len(self.taken)
                self._pictures[seq] = self.view(self._reading)
                frame = FrameRef(seq=seq, t_capture_ns=self._t_ns)
                view = ViewRef(frame=frame, reading=self._reading, sigma_deg=0.01)
                self._answer(PICTURE_S, ev.ViewTaken(grab_id=command.grab_id, view=view))
            case cmd.RunMatch():
                self._answer(MATCH_S, ev.MatchFinished(match_id=command.match_id, result=self._match(command)))
            case cmd.AbandonMatches():
                self._answers = [entry for entry in self._answers if not isinstance(entry[2], ev.MatchFinished)]
                heapq.heapify(self._answers)
            case cmd.PublishFeedback(step="locked"):
                self.locked_s = (self._t_ns - START_NS) / SECOND_NS
            case cmd.PublishResult():
                self.result = command
            case _:
                pass

    def _match(self, job: cmd.RunMatch):
        inputs = MatchInputs(
            fisheye_grey=self.fisheye,
            view_grey=self._pictures[job.view.frame.seq],
            rig=self.rig,
            box=job.box,
            reading=job.view.reading,
            inverse_range=job.inverse_range,
            band_rad=job.band_rad,
            seed=job.seed,
        )
        return match(inputs, job.matcher)
