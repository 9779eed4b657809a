"""Kinematics of one motor axis with explicit time: trapezoids, stops, wrap, settle ring. No clock, no IO.

Positions are in the axis' own unit (degrees or zoom units), times in seconds on any steady scale.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

HISTORY_S = 120.0
"""How far back an axis can be asked for its position."""
RING_MEMORY_S = 3.0
"""How long a swing is remembered through later plans; it has decayed long before."""
RING_FLOOR = 1e-4
"""Ring amplitude (axis unit) under which it counts as decayed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSpec:
    """What the mechanics of one axis can do."""

    low: float
    """Lower mechanical stop."""
    high: float
    """Upper mechanical stop."""
    v_max: float
    """Top speed, units/s."""
    a_max: float
    """Acceleration and braking, units/s²."""
    endless: bool = False
    """Turns on and on; positions are wrapped at ±180 when reported and the shortest way is taken."""
    ring_s: float = 0.0
    """Amplitude of the settle ring per speed at the start of braking, s (units per unit/s)."""
    ring_tau_s: float = 0.06
    """Decay time of the ring."""
    ring_hz: float = 9.0
    """Frequency of the ring."""

    def __post_init__(self) -> None:
        if not self.low < self.high:
            raise ValueError(f"axis stops are in the wrong order: {self.low} to {self.high}")
        if self.v_max <= 0 or self.a_max <= 0:
            raise ValueError(f"axis needs positive speed and acceleration, got {self.v_max}, {self.a_max}")

    def clip(self, value: float) -> float:
        """Nearest reachable position: a motor at its stop goes no further."""
        return value if self.endless else min(max(value, self.low), self.high)


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """Constant acceleration from ``t_s`` on: ``x + v·τ + a·τ²/2``."""

    t_s: float
    x: float
    v: float
    a: float

    def at(self, t_s: float) -> tuple[float, float]:
        """Position and velocity at ``t_s``."""
        dt = t_s - self.t_s
        return self.x + (self.v + self.a * dt / 2) * dt, self.v + self.a * dt


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A trajectory from ``start_s`` on: segments, then rest at ``target`` from ``end_s`` on (``inf``: never rests)."""

    segments: tuple[Segment, ...]
    end_s: float
    target: float
    brake_speed: float = 0.0
    """Signed speed at which the final braking starts."""

    @property
    def start_s(self) -> float:
        """When the plan begins."""
        return self.segments[0].t_s

    def at(self, t_s: float) -> tuple[float, float]:
        """Position and velocity at ``t_s`` ≥ ``start_s``."""
        if t_s >= self.end_s:
            return self.target, 0.0
        index = bisect_right(self.segments, t_s, key=lambda segment: segment.t_s) - 1
        return self.segments[max(index, 0)].at(t_s)


def plan_move(t_s: float, x: float, v: float, target: float, v_max: float, a_max: float) -> Plan:
    """Fastest way to rest at ``target`` from position ``x`` and velocity ``v`` within speed and acceleration.

    Parameters
    ----------
    t_s, x, v : float
        Time, position and velocity at the start; ``|v| > v_max`` is braked down first.
    target : float
        Where to rest.
    v_max, a_max : float
        Limits, > 0.

    Returns
    -------
    Plan
        At most four segments; position and velocity are continuous.
    """
    stop_x = x + v * abs(v) / (2 * a_max)
    sign = 1.0 if target >= stop_x else -1.0
    distance, speed = sign * (target - x), sign * v
    peak = min(v_max, math.sqrt(max(a_max * distance + speed * speed / 2, 0.0)))
    ramp = a_max if peak >= speed else -a_max
    ramp_s = (peak - speed) / ramp
    cruise = distance - (peak * peak - speed * speed) / (2 * ramp) - peak * peak / (2 * a_max)
    cruise_s = max(cruise, 0.0) / peak if peak > 0 else 0.0
    pieces = ((ramp_s, ramp), (cruise_s, 0.0), (peak / a_max, -a_max))
    segments, now, where, velocity = [], t_s, x, v
    for duration, acceleration in pieces:
        segment = Segment(t_s=now, x=where, v=velocity, a=sign * acceleration)
        segments.append(segment)
        now += duration
        where, velocity = segment.at(now)
    return Plan(segments=tuple(segments), end_s=now, target=target, brake_speed=sign * peak)


def plan_cruise(t_s: float, x: float, v: float, velocity: float, a_max: float) -> Plan:
    """Reach ``velocity`` and keep it for ever (an endless axis)."""
    acceleration = math.copysign(a_max, velocity - v)
    first = Segment(t_s=t_s, x=x, v=v, a=acceleration)
    reached_s = t_s + abs(velocity - v) / a_max
    second = Segment(t_s=reached_s, x=first.at(reached_s)[0], v=velocity, a=0.0)
    return Plan(segments=(first, second), end_s=math.inf, target=math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """A decaying swing after braking; starts at zero, so the position stays continuous."""

    start_s: float
    amplitude: float
    tau_s: float
    hz: float

    def at(self, t_s: float) -> float:
        """Excursion at ``t_s``."""
        dt = t_s - self.start_s
        if dt <= 0:
            return 0.0
        return self.amplitude * math.exp(-dt / self.tau_s) * math.sin(2 * math.pi * self.hz * dt)

    @property
    def quiet_s(self) -> float:
        """When the swing has decayed below :data:`RING_FLOOR`."""
        return self.start_s + self.tau_s * math.log(max(abs(self.amplitude) / RING_FLOOR, 1.0))


class Axis:
    """One motor: takes orders at rising times, answers for any time of the last two minutes.

    Parameters
    ----------
    spec : AxisSpec
    t_s, x : float
        Time from which the axis exists, and where it rests then.
    """

    def __init__(self, spec: AxisSpec, *, t_s: float, x: float) -> None:
        self.spec = spec
        rest = Segment(t_s=t_s, x=x, v=0.0, a=0.0)
        self._plans = [Plan(segments=(rest,), end_s=t_s, target=x)]
        self.continuous = False

    def move_to(self, t_s: float, target: float, v_max: float | None = None) -> Plan:
        """Replace the motion in progress; the target is clipped at the stops, endless axes turn the shorter way."""
        x, v = self.plan_at(t_s).at(t_s)
        if self.spec.endless:
            target = x + math.remainder(target - x, 360.0)
        self.continuous = False
        return self._go(t_s, x, v, self.spec.clip(target), v_max)

    def turn_to(self, t_s: float, target: float, v_max: float | None = None) -> Plan:
        """Like :meth:`move_to`, in unwrapped positions: a relative move of 300° is 300° long."""
        x, v = self.plan_at(t_s).at(t_s)
        self.continuous = False
        return self._go(t_s, x, v, self.spec.clip(target), v_max)

    def cruise(self, t_s: float, velocity: float) -> Plan:
        """Move at ``velocity`` until told otherwise or a stop is reached; 0 brakes."""
        if velocity == 0:
            return self.brake(t_s)
        x, v = self.plan_at(t_s).at(t_s)
        self.continuous = True
        velocity = max(-self.spec.v_max, min(self.spec.v_max, velocity))
        if self.spec.endless:
            return self._add(plan_cruise(t_s, x, v, velocity, self.spec.a_max))
        end = self.spec.high if velocity > 0 else self.spec.low
        return self._go(t_s, x, v, end, abs(velocity))

    def brake(self, t_s: float) -> Plan:
        """Come to rest as soon as the brakes allow."""
        x, v = self.plan_at(t_s).at(t_s)
        self.continuous = False
        return self._go(t_s, x, v, self.spec.clip(x + v * abs(v) / (2 * self.spec.a_max)), None)

    def _go(self, t_s: float, x: float, v: float, target: float, v_max: float | None) -> Plan:
        speed = self.spec.v_max if v_max is None else min(v_max, self.spec.v_max)
        return self._add(plan_move(t_s, x, v, target, speed, self.spec.a_max))

    def _add(self, plan: Plan) -> Plan:
        while len(self._plans) > 1 and self._plans[1].start_s < plan.start_s - HISTORY_S:
            del self._plans[0]
        self._plans.append(plan)
        return plan

    def plan_at(self, t_s: float) -> Plan:
        """The plan in force at ``t_s``; the first known one for earlier times."""
        return self._plans[self._index_at(t_s)]

    def _index_at(self, t_s: float) -> int:
        return max(bisect_right(self._plans, t_s, key=lambda plan: plan.start_s) - 1, 0)

    def position(self, t_s: float) -> float:
        """What the motor's encoder stands at, unwrapped."""
        return self.plan_at(t_s).at(t_s)[0]

    def velocity(self, t_s: float) -> float:
        """Speed of the motor, units/s."""
        return self.plan_at(t_s).at(t_s)[1]

    def optical(self, t_s: float) -> float:
        """Where the optics point: the motor plus the swing of the mechanics."""
        index = self._index_at(t_s)
        swing = sum(ring.at(t_s) for ring in self._rings(index))
        return self.spec.clip(self._plans[index].at(t_s)[0] + swing)

    def moving(self, t_s: float) -> bool:
        """Whether the motor turns (the swing afterwards not counted)."""
        plan = self.plan_at(t_s)
        return plan.start_s <= t_s < plan.end_s

    def rest_s(self, t_s: float) -> float:
        """When the optics are at rest by the plan in force at ``t_s``, swing included; ``inf`` while cruising."""
        index = self._index_at(t_s)
        return max([self._plans[index].end_s, *(ring.quiet_s for ring in self._rings(index))])

    def _rings(self, index: int) -> list[Ring]:
        """Swings of the plan at ``index`` and of those before it that came to rest first."""
        rings = []
        following_s = math.inf
        for plan in reversed(self._plans[: index + 1]):
            amplitude = plan.brake_speed * self.spec.ring_s
            if amplitude and plan.end_s <= following_s:
                tau_s, hz = self.spec.ring_tau_s, self.spec.ring_hz
                rings.append(Ring(start_s=plan.end_s, amplitude=amplitude, tau_s=tau_s, hz=hz))
            following_s = plan.start_s
            if following_s < self._plans[index].start_s - RING_MEMORY_S:
                break
        return rings
