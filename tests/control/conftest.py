from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from ptzd.config import Config, FilesSource, Home, Lock, Ptz, Search
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import pan_tilt
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, Candidate, FrameRef, HeadLimits, HeadReading, MatchResult, ViewRef
from ptzd.presets import Place, Presets, Stay

PLACES = {
    "gate": Place(azimuth_deg=40.0, elevation_deg=-10.0, hfov_deg=20.0),
    "yard": Place(azimuth_deg=-35.0, elevation_deg=5.0, hfov_deg=50.0),
    "behind": Place(azimuth_deg=179.0, elevation_deg=0.0, hfov_deg=40.0),
}
"""The last one lies outside the head's limits."""
PATROLS = {
    "night": (Stay(place="gate", dwell_s=10.0), Stay(place="yard", dwell_s=6.0), Stay(place="gate", dwell_s=3.0)),
    "far": (Stay(place="behind", dwell_s=5.0), Stay(place="yard", dwell_s=5.0)),
    "nowhere": (Stay(place="behind", dwell_s=5.0),),
    "alone": (Stay(place="yard", dwell_s=5.0),),
}


@pytest.fixture(scope="session")
def rig() -> Rig:
    fisheye = UnifiedCamera(
        size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=1.2, max_angle_rad=math.radians(92)
    )
    entries = tuple(
        ZoomEntry(zoom=zoom, fx=554.0 * factor, fy=554.0 * factor, cx=319.5, cy=239.5)
        for zoom, factor in ((1, 1.0), (2500, 3.0), (5000, 8.0), (9999, 20.0))
    )
    return Rig(
        fisheye=fisheye,
        zoom=ZoomTable(size_px=(640, 480), entries=entries),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=np.eye(3),
        head_from_fisheye_translation=np.array([-0.5, -0.1, -0.05]),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=math.radians(0.1), translation=0.002, head_rad=math.radians(0.03)),
    )


@pytest.fixture(scope="session")
def config() -> Config:
    return Config(
        rig="test",
        calibration="rig.yaml",
        fisheye=FilesSource(path="pictures"),
        ptz=Ptz(url="http://127.0.0.1:1", user="operator"),
        home=Home(idle_s=5.0),
        search=Search(),
        lock=Lock(hold_s=4.0, verify_every_s=1.5),
        presets=Presets(places=PLACES, hold_s=8.0, quiet_s=20.0, patrols=PATROLS),
    )


class World:
    """Answers a core's commands in virtual time: a head that takes time, a matcher that knows the truth."""

    def __init__(self, rig: Rig, config: Config, *, inverse_range: float = 0.25) -> None:
        self.rig = rig
        self.machine = Machine(rig, config)
        self.t_ns = 1_000_000_000_000
        self.inverse_range = inverse_range
        self.told: list[ev.Event] = []
        self.told_ns: list[int] = []
        self.done: list[cmd.Command] = []
        self.reading = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
        self.limits = HeadLimits(
            pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999), top_deg_s=(100, 90), focus=(770, 9999)
        )
        self.score = 0.95
        self.texture = 9.0
        self.silent: set[type[cmd.Command]] = set()
        self._answers: list[tuple[int, int, ev.Event]] = []
        self._head_answer: ev.Event | None = None
        self._matches: list[ev.Event] = []
        self._count = 0

    def tell(self, event: ev.Event) -> list[cmd.Command]:
        """Hand one event to the core and start what it wants."""
        commands = self.machine.handle(event, self.t_ns)
        self.told.append(event)
        self.told_ns.append(self.t_ns)
        self.done += commands
        for command in commands:
            self._perform(command)
        return commands

    def replayed(self, machine: Machine, since: int = 0) -> list[cmd.Command]:
        """What another core answers to what this one was told."""
        told = zip(self.told[since:], self.told_ns[since:], strict=True)
        return [command for event, t_ns in told for command in machine.handle(event, t_ns)]

    def start(self) -> None:
        """Both devices come up and a frame arrives."""
        self.tell(ev.HeadReady(limits=self.limits, reading=self.reading))
        self.tell(ev.DeviceWell(device=ev.Device.PTZ))
        self.tell(ev.DeviceWell(device=ev.Device.FISHEYE))
        self.frame(0)

    def frame(self, seq: int) -> None:
        self.tell(ev.FrameArrived(frame=FrameRef(seq=seq, t_capture_ns=self.t_ns - 1_000_000)))

    def request(self, name: str = "a", **fields: object) -> list[cmd.Command]:
        box = fields.pop("box", Box(x=330, y=230, w=40, h=32))
        token = fields.pop("token", 1)
        return self.tell(ev.RequestReceived(token=token, id=name, box=box, **fields))

    def run(self, seconds: float = 120.0, until: State | None = None) -> None:
        """Let time pass: answers and deadlines in their order."""
        end = self.t_ns + round(seconds * 1e9)
        while until is None or self.machine.state is not until:
            deadline = self.machine.deadline_ns()
            answer = self._answers[0][0] if self._answers else None
            soonest = min((t for t in (deadline, answer) if t is not None), default=None)
            if soonest is None or soonest > end:
                break
            self.t_ns = max(self.t_ns, soonest)
            if answer is not None and answer <= soonest:
                event = heapq.heappop(self._answers)[2]
                if event is self._head_answer or event in self._matches or isinstance(event, ev.HeadStopped):
                    self._arrive(event)
                    self.tell(event)
            else:
                self.tell(ev.DeadlinePassed())
        else:
            return
        self.t_ns = max(self.t_ns, end)

    def results(self) -> dict[str, list[cmd.PublishResult]]:
        found: dict[str, list[cmd.PublishResult]] = {}
        for command in self.done:
            if isinstance(command, cmd.PublishResult):
                found.setdefault(command.id, []).append(command)
        return found

    def of(self, kind: type) -> list:
        return [command for command in self.done if isinstance(command, kind)]

    def _arrive(self, event: ev.Event) -> None:
        if isinstance(event, ev.HeadArrived):
            self.reading = event.reading

    def _answer(self, delay_s: float, make: type[ev.Event], **fields: object) -> ev.Event:
        self._count += 1
        t_ns = self.t_ns + round(delay_s * 1e9)
        event = make(**fields)
        heapq.heappush(self._answers, (t_ns, self._count, event))
        return event

    def _perform(self, command: cmd.Command) -> None:
        if type(command) in self.silent:
            return
        match command:
            case cmd.MoveHead():
                assert self.limits.contains(command.target)
                self._head_answer = self._answer(0.8, ev.HeadArrived, move_id=command.move_id, reading=command.target)
            case cmd.SteerHead():
                lasts_s = (command.until_ns - self.t_ns) / 1e9
                reading, speed = self.reading, command.speed
                self.reading = HeadReading(
                    pan_deg=reading.pan_deg + lasts_s * speed.pan_deg_s,
                    tilt_deg=reading.tilt_deg + lasts_s * speed.tilt_deg_s,
                    zoom=reading.zoom + lasts_s * 3000 * speed.zoom_rate,
                )
                self._head_answer = self._answer(
                    lasts_s + 0.3, ev.HeadArrived, move_id=command.move_id, reading=self.reading
                )
            case cmd.StopHead():
                self._head_answer = None
                self._answer(0.1, ev.HeadStopped)
            case cmd.GrabView():
                frame = FrameRef(seq=self._count, t_capture_ns=self.t_ns)
                view = ViewRef(frame=frame, reading=self.reading, sigma_deg=0.01)
                self._head_answer = self._answer(0.2, ev.ViewTaken, grab_id=command.grab_id, view=view)
            case cmd.RunMatch():
                result = self.match(command)
                self._matches.append(self._answer(0.03, ev.MatchFinished, match_id=command.match_id, result=result))
            case cmd.AbandonMatches():
                self._matches.clear()

    def match(self, job: cmd.RunMatch) -> MatchResult:
        """What an ideal matcher says of the true place."""
        ray = self.rig.fisheye.lift(np.array(job.box.centre))[0]
        arc = EpipolarArc.of(self.rig, ray, 0.0, 1.0)
        direction = arc.bearing(self.inverse_range)
        pixel, valid = self.rig.project_to_view(direction, job.view.reading)
        inside = bool(valid) and 0 <= pixel[0] <= 639 and 0 <= pixel[1] <= 479
        pan, tilt = pan_tilt(direction)
        candidate = Candidate(
            pan_rad=float(pan),
            tilt_rad=float(tilt),
            inverse_range=self.inverse_range,
            offset_rad=0.0,
            score=self.score,
            sharpness=0.1,
            sigma_rad=1e-4,
            plane=(0.0, 0.0, self.inverse_range),
            box_px=((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)),
        )
        return MatchResult(
            matcher=job.matcher,
            texture=self.texture,
            candidates=(candidate,) if inside else (),
            coverage=job.inverse_range,
            seed=job.seed,
            elapsed_ms=5.0,
        )


@pytest.fixture(scope="session")
def new_world(rig: Rig, config: Config) -> Callable[[], World]:
    """Makes worlds whose devices are still away."""
    return lambda: World(rig, config)


@pytest.fixture
def world(rig: Rig, config: Config) -> World:
    made = World(rig, config)
    made.start()
    return made


@pytest.fixture
def make_world(rig: Rig, config: Config) -> Callable[..., World]:
    def make(**changes: object) -> World:
        return World(rig, msgspec.structs.replace(config, **changes))

    return make
