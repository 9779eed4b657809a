"""A core whose head is the simulator's: what it asks for moves real kinematics, and the truth is looked at."""

from __future__ import annotations

import dataclasses
import math
import random

import numpy as np

from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.planning.grid import axes_at
from ptzd.control.planning.zones import zones_of
from ptzd.geometry.rig import Rig
from ptzd.geometry.zones import covers
from ptzd.model import FrameRef, HeadLimits, HeadReading, Motion, ViewRef, ZoneKind
from ptzd.sim.head import Head, MoveTo, Turn
from ptzd.sim.profile import PROFILES
from tests.control.conftest import World

TICK_S = 0.05
REST_S = 0.3
"""Of standing still until a report says so."""


class TrueHead:
    """Feeds a core in virtual time and keeps every true direction of the optical axis.

    Parameters
    ----------
    rig, config
        What the core is given; its no-go zones are those that the truth is held against.
    profile : str
        Which camera the head is of.
    limits : HeadLimits
        Within the camera's own.
    seed : int
        Of the camera's latencies and of what happens.
    """

    def __init__(self, rig: Rig, config: Config, *, profile: str, limits: HeadLimits, seed: int) -> None:
        self.chance = random.Random(seed)
        self.machine = Machine(rig, config)
        self.oracle = World(rig, config, inverse_range=self.chance.choice([0.02, 0.2, 0.6]))
        self.limits = limits
        self.rig = rig
        self.no_go = [zone for zone in zones_of(config, rig) if zone.kind is ZoneKind.NO_GO]
        self.t_s = 1000.0
        camera = PROFILES[profile]
        place = (config.home.pan_deg, config.home.tilt_deg, config.home.zoom)
        self.head = Head(dataclasses.replace(camera, home=place), seed=seed, t_s=self.t_s)
        self.told_s = self.t_s - 1.0
        self.asked: cmd.MoveHead | cmd.SteerHead | cmd.GrabView | cmd.StopHead | None = None
        self.steered_until_ns: int | None = None
        self.jobs: list[cmd.RunMatch] = []
        self.done: list[cmd.Command] = []
        self.poses: list[HeadReading] = []
        self.seq = 0

    @property
    def t_ns(self) -> int:
        return round(self.t_s * 1e9)

    def tell(self, event: ev.Event) -> None:
        for command in self.machine.handle(event, self.t_ns):
            self.done.append(command)
            self._perform(command)

    def start(self) -> None:
        self.tell(ev.HeadReady(limits=self.limits, reading=self.reading()))
        self.tell(ev.DeviceWell(device=ev.Device.PTZ))
        self.tell(ev.DeviceWell(device=ev.Device.FISHEYE))

    def frame(self) -> FrameRef:
        """The newest fisheye frame."""
        self.seq += 1
        return FrameRef(seq=self.seq, t_capture_ns=self.t_ns)

    def reading(self) -> HeadReading:
        pose = self.head.reported(self.t_s)
        return HeadReading(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self._tick()

    def directions(self) -> np.ndarray:
        """Every true direction of the axis so far, ``(n, 3)``, in the head frame."""
        pans, tilts = (np.array([getattr(pose, name) for pose in self.poses]) for name in ("pan_deg", "tilt_deg"))
        return axes_at(self.rig.head, pans, tilts)

    def trespassed(self) -> list[str]:
        """Names of the no-go zones that the axis was in."""
        seen = self.directions()
        return [zone.name for zone in self.no_go if covers(zone.head_outlines, seen).any()]

    def _tick(self) -> None:
        for _ in range(5):
            self.t_s += TICK_S / 5
            true = self.head.optical(self.t_s)
            self.poses.append(HeadReading(pan_deg=true.pan_deg, tilt_deg=true.tilt_deg, zoom=max(true.zoom, 1.0)))
        if self.steered_until_ns is not None and self.t_ns >= self.steered_until_ns:
            self._turn(0.0, 0.0)  # the dead man
        rests = self.head.rest_s(self.t_s) <= self.t_s - REST_S and self.told_s <= self.t_s - REST_S
        motion = Motion.STABLE if rests else Motion.MOVING
        self.tell(ev.HeadPolled(reading=self.reading(), motion=motion))
        if rests and self.asked is not None:
            self._answer()
        while self.jobs:
            job = self.jobs.pop()
            self.tell(ev.MatchFinished(match_id=job.match_id, result=self.oracle.match(job)))
        deadline = self.machine.deadline_ns()
        if deadline is not None and self.t_ns >= deadline:
            self.tell(ev.DeadlinePassed())

    def _answer(self) -> None:
        asked, self.asked = self.asked, None
        match asked:
            case cmd.MoveHead() | cmd.SteerHead():
                self.tell(ev.HeadArrived(move_id=asked.move_id, reading=self.reading()))
            case cmd.GrabView():
                view = ViewRef(frame=self.frame(), reading=self.reading(), sigma_deg=0.01)
                self.tell(ev.ViewTaken(grab_id=asked.grab_id, view=view))
            case cmd.StopHead():
                self.tell(ev.HeadStopped())

    def _perform(self, command: cmd.Command) -> None:
        match command:
            case cmd.MoveHead():
                target = command.target
                self.asked, self.told_s, self.steered_until_ns = command, self.t_s, None
                self.head.submit(self.t_s, MoveTo(pan=target.pan_deg, tilt=target.tilt_deg, zoom=target.zoom))
            case cmd.SteerHead():
                self.asked = command
                self._turn(command.speed.pan_deg_s, command.speed.tilt_deg_s)
                self.steered_until_ns = command.until_ns
            case cmd.StopHead():
                self.asked = command
                self._turn(0.0, 0.0)
            case cmd.GrabView():
                self.asked = command
            case cmd.RunMatch():
                self.jobs.append(command)
            case cmd.AbandonMatches():
                self.jobs.clear()
            case _:
                pass

    def _turn(self, pan_deg_s: float, tilt_deg_s: float) -> None:
        self.told_s, self.steered_until_ns = self.t_s, None
        camera = self.head.profile

        def percent(speed: float, top: float) -> float:
            return math.copysign(100.0 * min(abs(speed) / top, 1.0) ** (1.0 / camera.continuous_exponent), speed)

        order = Turn(
            pan_percent=percent(pan_deg_s, camera.pan.v_max), tilt_percent=percent(tilt_deg_s, camera.tilt.v_max)
        )
        self.head.submit(self.t_s, order)
