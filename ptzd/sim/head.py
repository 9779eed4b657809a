"""The moving head of a simulated camera: three axes, command latency, reports that lag. Pure, explicit time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from ptzd.sim.motion import HISTORY_S, Axis, AxisSpec
from ptzd.sim.optics import hfov_deg
from ptzd.sim.profile import Profile

REFERENCE_SIZE_PX = (1920, 1080)
"""Picture whose field of view sets the proportional speed."""
SCATTER_STEPS = 0.45
"""Repeatability scatters by no more of an encoder step: a step finer than the mechanics would tell nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveTo:
    """Absolute move; None leaves an axis alone. VAPIX units."""

    pan: float | None = None
    tilt: float | None = None
    zoom: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class MoveBy:
    """Relative move; None leaves an axis alone. VAPIX units."""

    pan: float | None = None
    tilt: float | None = None
    zoom: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Turn:
    """Continuous pan and tilt at signed percent of the top speed; 0, 0 stops both."""

    pan_percent: float
    tilt_percent: float
    proportional: float = 0.0
    """Fields of view per second at 100 % that cap the speed; 0 = no cap."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ZoomRun:
    """Continuous zoom at signed percent of the top speed; 0 stops it."""

    percent: float


Order = MoveTo | MoveBy | Turn | ZoomRun


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Pan and tilt in VAPIX degrees (pan wrapped when endless), zoom in VAPIX units."""

    pan_deg: float
    tilt_deg: float
    zoom: float


class _Offset:
    """A small angle that goes smoothly from value to value."""

    def __init__(self, t_s: float) -> None:
        self._blends = [(t_s, t_s, 0.0, 0.0)]

    def at(self, t_s: float) -> float:
        index = max(bisect_right(self._blends, t_s, key=lambda blend: blend[0]) - 1, 0)
        start_s, end_s, before, after = self._blends[index]
        u = min(max((t_s - start_s) / max(end_s - start_s, 1e-9), 0.0), 1.0)
        return before + (after - before) * u * u * (3 - 2 * u)

    def go(self, start_s: float, end_s: float, value: float) -> None:
        self._blends.append((start_s, end_s, self.at(start_s), value))
        while len(self._blends) > 1 and self._blends[1][0] < start_s - HISTORY_S:
            del self._blends[0]


class Head:
    """Takes orders, moves when the latency is over, tells the true and the reported pose at any time.

    Parameters
    ----------
    profile : Profile
    seed : int
        Of latencies and repeatability.
    t_s : float
        Now; the head rests at the profile's home.
    tilt_spec : AxisSpec, optional
        In place of the profile's, e.g. with E-flip.
    """

    def __init__(self, profile: Profile, *, seed: int, t_s: float, tilt_spec: AxisSpec | None = None) -> None:
        self.profile = profile
        self._random = np.random.default_rng(seed)
        pan, tilt, zoom = profile.home
        self.axes = {
            "pan": Axis(profile.pan, t_s=t_s, x=pan),
            "tilt": Axis(tilt_spec or profile.tilt, t_s=t_s, x=tilt),
            "zoom": Axis(profile.zoom, t_s=t_s, x=zoom),
        }
        self._scatter = {"pan": _Offset(t_s), "tilt": _Offset(t_s)}
        self._knocked = {"pan": _Offset(t_s), "tilt": _Offset(t_s)}
        self._knock = {"pan": 0.0, "tilt": 0.0}
        self._stuck: tuple[float, float, float] | None = None
        """From when on the optics stand, and where in pan and tilt."""
        self._zoom_jitter = [(t_s, 0)]
        self._pending: deque[tuple[float, Order, float]] = deque()
        self._last_start_s = -math.inf
        self.auto_flip = False
        """Whether a head with stops a whole turn apart goes on panning beyond one after a quick turn back."""
        self._flip: tuple[float, float] | None = None

    def submit(self, t_s: float, order: Order, speed_index: float = 100) -> float:
        """Accept an order at ``t_s``; returns when the motors take it up.

        An order that still waits is superseded in the axes that the new one names; the new one has its turn. Buffering
        drivers (``serialise_s``) carry out one after the other.
        """
        self.advance(t_s)
        timing = self.profile.timing
        latency = float(self._random.normal(timing.latency_s, timing.latency_sigma_s))
        low, high = timing.latency_bounds_s
        start_s = max(t_s + min(max(latency, low), high), self._last_start_s + max(timing.serialise_s, 1e-6))
        if not timing.serialise_s:
            start_s = self._supersede(order, start_s)
        self._last_start_s = max(start_s, self._last_start_s)
        waiting = sorted([*self._pending, (start_s, order, speed_index)], key=lambda entry: entry[0])
        self._pending = deque(waiting)
        return start_s

    def _supersede(self, order: Order, start_s: float) -> float:
        """Take what ``order`` names out of the orders that wait; returns when it starts: at the first one's turn."""
        kept = []
        for entry in self._pending:
            rest = _without(entry[1], order)
            start_s = start_s if rest == entry[1] else min(start_s, entry[0])
            kept += [] if rest is None else [(entry[0], rest, entry[2])]
        self._pending = deque(kept)
        return start_s

    def advance(self, t_s: float) -> None:
        """Take up every order whose time has come."""
        while True:
            order_s = self._pending[0][0] if self._pending else math.inf
            flip_s = math.inf if self._flip is None else self._flip[0]
            if min(order_s, flip_s) > t_s:
                return
            if flip_s < order_s:
                self._turn_round()
            else:
                self._start(*self._pending.popleft())

    def busy(self, t_s: float) -> bool:
        """Whether a motor turns or an order waits."""
        self.advance(t_s)
        return bool(self._pending) or self.moving(t_s)

    def moving(self, t_s: float) -> bool:
        """Whether a motor turns."""
        self.advance(t_s)
        return any(axis.moving(t_s) for axis in self.axes.values())

    def motion_start_s(self, t_s: float) -> float:
        """When the motion in progress at ``t_s`` began; ``t_s`` itself when no motor turns."""
        self.advance(t_s)
        starts = [axis.plan_at(t_s).start_s for axis in self.axes.values() if axis.moving(t_s)]
        return min(starts, default=t_s)

    def since_move_s(self, t_s: float) -> float:
        """Time since pan or tilt stopped; 0 while they turn."""
        self.advance(t_s)
        return min(_since(self.axes["pan"], t_s), _since(self.axes["tilt"], t_s))

    def since_zoom_s(self, t_s: float) -> float:
        """Time since the zoom stopped; 0 while it runs."""
        self.advance(t_s)
        return _since(self.axes["zoom"], t_s)

    def rest_s(self, t_s: float) -> float:
        """When motors and optics are at rest if nothing more is ordered; ``inf`` while that is unknown."""
        self.advance(t_s)
        return math.inf if self._pending or self._flip else max(axis.rest_s(t_s) for axis in self.axes.values())

    def encoder(self, t_s: float) -> Pose:
        """Where the motors stand."""
        self.advance(t_s)
        pan, tilt, zoom = (self.axes[name].position(t_s) for name in ("pan", "tilt", "zoom"))
        return Pose(pan_deg=self._wrapped(pan), tilt_deg=tilt, zoom=zoom)

    def optical(self, t_s: float) -> Pose:
        """Where the optics truly point, swing and repeatability included."""
        self.advance(t_s)
        pan = self.axes["pan"].optical(t_s) + self._error("pan", t_s)
        tilt = self.axes["tilt"].optical(t_s) + self._error("tilt", t_s)
        if self._stuck is not None and t_s >= self._stuck[0]:
            pan, tilt = self._stuck[1:]
        return Pose(pan_deg=self._wrapped(pan), tilt_deg=tilt, zoom=self.axes["zoom"].optical(t_s))

    def reported(self, t_s: float) -> Pose:
        """What ``query=position`` says at ``t_s``: encoder steps, renewed now and then, some time old."""
        timing = self.profile.timing
        renewed_s = math.floor(t_s / timing.report_refresh_s) * timing.report_refresh_s
        at_s = renewed_s - timing.report_lag_s
        self.advance(t_s)
        pose = self.encoder(at_s)
        return Pose(
            pan_deg=self._wrapped(self.profile.quantise(pose.pan_deg)),
            tilt_deg=self.profile.quantise(pose.tilt_deg),
            zoom=self.profile.zoom.clip(round(pose.zoom) + self._jitter(at_s)),
        )

    def shift_zero(self, t_s: float, pan_deg: float, tilt_deg: float) -> None:
        """Knock the head: from now on the optics point elsewhere than the encoders say."""
        for name, shift in (("pan", pan_deg), ("tilt", tilt_deg)):
            self._knock[name] += shift
            self._knocked[name].go(t_s, t_s + 0.05, self._knock[name])

    def stick(self, t_s: float) -> None:
        """From now on the motors turn and the optics stand."""
        pose = self.optical(t_s)
        self._stuck = (t_s, pose.pan_deg, pose.tilt_deg)

    def find_zero(self, t_s: float) -> None:
        """As at a start: the encoders say again where the optics point, and the gears grip."""
        self._stuck = None
        self.shift_zero(t_s, -self._knock["pan"], -self._knock["tilt"])

    def _wrapped(self, pan: float) -> float:
        return math.remainder(pan, 360.0) if self.profile.pan.endless else pan

    def _error(self, name: str, t_s: float) -> float:
        return self._scatter[name].at(t_s) + self._knocked[name].at(t_s)

    def _jitter(self, t_s: float) -> int:
        index = bisect_right(self._zoom_jitter, t_s, key=lambda entry: entry[0]) - 1
        return self._zoom_jitter[max(index, 0)][1]

    def _start(self, t_s: float, order: Order, speed_index: float) -> None:
        match order:
            case MoveTo():
                self._move(t_s, order, speed_index, relative=False)
            case MoveBy():
                self._move(t_s, order, speed_index, relative=True)
            case Turn():
                self._turn(t_s, order)
            case ZoomRun():
                self.axes["zoom"].cruise(t_s, order.percent / 100 * self.profile.zoom.v_max)

    def _move(self, t_s: float, order: MoveTo | MoveBy, speed_index: float, *, relative: bool) -> None:
        named = {"pan": order.pan, "tilt": order.tilt}
        if any(value is not None for value in named.values()):
            self._end_continuous(t_s, named)
        for name, value in named.items():
            if value is not None:
                self._move_angle(t_s, name, value, speed_index, relative=relative)
        if order.zoom is not None:
            axis = self.axes["zoom"]
            target = order.zoom + (axis.position(t_s) if relative else 0.0)
            axis.move_to(t_s, round(target))
            jitter = self.profile.zoom_jitter
            self._zoom_jitter.append((t_s, int(self._random.integers(-jitter, jitter + 1))))
            del self._zoom_jitter[:-64]

    def _end_continuous(self, t_s: float, named: dict[str, float | None]) -> None:
        for name, value in named.items():
            if value is None and self.axes[name].continuous:
                self.axes[name].brake(t_s)

    def _move_angle(self, t_s: float, name: str, value: float, speed_index: float, *, relative: bool) -> None:
        axis = self.axes[name]
        v_max = self.profile.move_speed(speed_index)
        if name == "pan":
            self._flip = None
        if relative:
            target = axis.position(t_s) + value
            if name == "pan" and self._flips:
                target = math.remainder(target, 360.0)
            plan = axis.turn_to(t_s, self.profile.quantise(target), v_max)
        else:
            plan = axis.move_to(t_s, self.profile.quantise(value), v_max)
        bound_deg = SCATTER_STEPS * self.profile.quantum_deg
        scatter_deg = float(self._random.normal(0.0, self.profile.repeat_sigma_deg))
        self._scatter[name].go(t_s, plan.end_s, min(max(scatter_deg, -bound_deg), bound_deg))

    def _turn(self, t_s: float, order: Turn) -> None:
        cap = math.inf
        if order.proportional:
            zoom = self.axes["zoom"].position(t_s)
            cap = order.proportional * hfov_deg(self.profile, zoom, REFERENCE_SIZE_PX)
        for name, percent in (("pan", order.pan_percent), ("tilt", order.tilt_percent)):
            axis = self.axes[name]
            velocity = self.profile.continuous_share(percent) * min(axis.spec.v_max, cap)
            plan = axis.cruise(t_s, velocity)
            if name == "pan":
                self._flip = (plan.end_s, velocity) if velocity and self._flips else None

    @property
    def _flips(self) -> bool:
        pan = self.profile.pan
        return self.auto_flip and not pan.endless and pan.high - pan.low >= 360.0

    def _turn_round(self) -> None:
        """A continuous pan is at a stop: back to the other one at full speed, and from there on as before."""
        if self._flip is None:
            return
        (t_s, velocity), axis = self._flip, self.axes["pan"]
        near, far = (axis.spec.high, axis.spec.low) if velocity > 0 else (axis.spec.low, axis.spec.high)
        plan = axis.move_to(t_s, far) if axis.position(t_s) == near else axis.cruise(t_s, velocity)
        axis.continuous = True
        self._flip = (plan.end_s, velocity)


def _without(waiting: Order, newer: Order) -> Order | None:
    """What is left of an order that waits when a newer one comes; None: nothing."""
    match newer:
        case MoveTo() | MoveBy():
            named = {name for name in ("pan", "tilt", "zoom") if getattr(newer, name) is not None}
        case Turn():
            named = {"pan", "tilt"}
        case ZoomRun():
            named = {"zoom"}
    match waiting:
        case Turn():
            return None if named & {"pan", "tilt"} else waiting
        case ZoomRun():
            return None if "zoom" in named else waiting
        case MoveTo() | MoveBy():
            left = replace(waiting, **dict.fromkeys(named, None))
            return None if left == type(waiting)() else left


def _since(axis: Axis, t_s: float) -> float:
    return max(t_s - axis.plan_at(t_s).end_s, 0.0)
