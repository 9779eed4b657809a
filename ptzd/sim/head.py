"""The moving head of a simulated camera: three axes, command latency, reports that lag. Pure, explicit time."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass

import numpy as np

from ptzd.sim.motion import HISTORY_S, Axis, AxisSpec
from ptzd.sim.optics import hfov_deg
from ptzd.sim.profile import Profile

REFERENCE_SIZE_PX = (1920, 1080)
"""Picture whose field of view sets the proportional speed."""


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
        self._zoom_jitter = [(t_s, 0)]
        self._pending: deque[tuple[float, Order, float]] = deque()
        self._last_start_s = -math.inf

    def submit(self, t_s: float, order: Order, speed_index: float = 100) -> float:
        """Accept an order at ``t_s``; returns when the motors take it up."""
        timing = self.profile.timing
        latency = float(self._random.normal(timing.latency_s, timing.latency_sigma_s))
        low, high = timing.latency_bounds_s
        start_s = max(t_s + min(max(latency, low), high), self._last_start_s + max(timing.serialise_s, 1e-6))
        self._last_start_s = start_s
        self._pending.append((start_s, order, speed_index))
        return start_s

    def advance(self, t_s: float) -> None:
        """Take up every order whose time has come."""
        while self._pending and self._pending[0][0] <= t_s:
            start_s, order, speed_index = self._pending.popleft()
            self._start(start_s, order, speed_index)

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
        return math.inf if self._pending else max(axis.rest_s(t_s) for axis in self.axes.values())

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
        if relative:
            plan = axis.turn_to(t_s, self.profile.quantise(axis.position(t_s) + value), v_max)
        else:
            plan = axis.move_to(t_s, self.profile.quantise(value), v_max)
        self._scatter[name].go(t_s, plan.end_s, float(self._random.normal(0.0, self.profile.repeat_sigma_deg)))

    def _turn(self, t_s: float, order: Turn) -> None:
        cap = math.inf
        if order.proportional:
            zoom = self.axes["zoom"].position(t_s)
            cap = order.proportional * hfov_deg(self.profile, zoom, REFERENCE_SIZE_PX)
        for name, percent in (("pan", order.pan_percent), ("tilt", order.tilt_percent)):
            axis = self.axes[name]
            axis.cruise(t_s, self.profile.continuous_share(percent) * min(axis.spec.v_max, cap))


def _since(axis: Axis, t_s: float) -> float:
    return max(t_s - axis.plan_at(t_s).end_s, 0.0)
