"""Position reports over time: what the head does, since when it rests, where it was. Pure, time is an argument.

A camera reports positions late and renews them more slowly than it is asked, so two equal reports prove nothing. The
unit of rest is a **run**: consecutive reports within a small span of each other. A run is proven when it has at least
three reports over at least ``rest_s``. After a command reports count only when the head was seen to leave, or when it
had time enough to start.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ptzd.model import HeadReading, Motion

KEPT_NS = 10_000_000_000
MIN_REPORTS = 3
SPAN_SHARE = 0.95
"""Of the time asked for is enough: four reports at 10 Hz span 0.3 s give or take the jitter of the network."""
WITNESS_SHARE = 0.5
"""Of the settle time that must pass between the camera's own word and the report that confirms it."""
SIGMA_FLOOR_DEG = 0.005
"""Repeatability and encoder step of the finest heads (V5915 reports steps of 1/256°)."""
EXTRAPOLATED_NS = 200_000_000
"""How far beyond the latest report a moving head is believed to go on as before."""

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Stillness:
    """When reports count as equal, and how many seconds of them as rest."""

    span_deg: float
    """Equal reports differ by no more, deg."""
    span_zoom: float
    """The same for zoom, VAPIX units."""
    rest_s: float
    """A run shorter than this proves nothing."""
    start_s: float
    """From a command to the first report that shows its motion, at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """One report: the head was there at ``t_ns ± half_round_trip_ns``."""

    t_ns: int
    half_round_trip_ns: int
    reading: HeadReading
    motion: Motion
    foreign: bool


class Run:
    """Consecutive reports within a small span: sums for their mean and spread."""

    __slots__ = (
        "_begin_ns",
        "_first",
        "_highest",
        "_leading",
        "_lowest",
        "_squares",
        "_sums",
        "count",
        "first_ns",
        "last_ns",
        "span_ns",
        "witnessed",
    )

    def __init__(self, t_ns: int, half_round_trip_ns: int, reading: HeadReading) -> None:
        self._first = reading
        self._lowest = self._highest = self._sums = self._squares = (0.0, 0.0, 0.0)
        self._begin_ns = t_ns
        self._leading = 1
        self.count = 1
        self.witnessed = False
        """Whether the camera itself said that the motion ended, and a report after that agreed."""
        self.span_ns = 0
        """From the first report to the last."""
        self.first_ns = t_ns + half_round_trip_ns
        """From here on the head was there for certain."""
        self.last_ns = t_ns - half_round_trip_ns
        """Until here."""

    def extend(self, t_ns: int, half_round_trip_ns: int, reading: HeadReading, stillness: Stillness) -> bool:
        """Take a report that continues the run; returns False when it does not."""
        offset = offset_of(reading, self._first)
        lowest = _each(min, self._lowest, offset)
        highest = _each(max, self._highest, offset)
        spans = (stillness.span_deg, stillness.span_deg, stillness.span_zoom)
        if any(high - low > span for low, high, span in zip(lowest, highest, spans, strict=True)):
            return False
        self._lowest, self._highest = lowest, highest
        self._sums = _each(lambda a, b: a + b, self._sums, offset)
        self._squares = _each(lambda a, b: a + b * b, self._squares, offset)
        self._leading += self._leading == self.count and offset == (0.0, 0.0, 0.0)
        self.count += 1
        self.span_ns = t_ns - self._begin_ns
        self.last_ns = max(self.last_ns, t_ns - half_round_trip_ns)
        return True

    def proven(self, rest_s: float) -> bool:
        """Whether the run is long enough to be called rest, or the camera called it so."""
        return self.witnessed or (self.count >= MIN_REPORTS and self.span_ns >= rest_s * SPAN_SHARE * 1e9)

    @property
    def _counted(self) -> int:
        """Reports that count: those that repeat the first one, which may still show the end of the motion, do not."""
        return max(1, self.count - self._leading)

    @property
    def mean(self) -> HeadReading:
        """Mean of the reports, pan within (−180, 180]; the first and its repetitions only when no others follow."""
        pan, tilt, zoom = (total / self._counted for total in self._sums)
        first = self._first
        return HeadReading(
            pan_deg=wrapped_deg(first.pan_deg + pan) if pan else first.pan_deg,
            tilt_deg=first.tilt_deg + tilt,
            zoom=first.zoom + zoom,
        )

    @property
    def sigma_deg(self) -> float:
        """One sigma of the pose on the sphere: spread of the reports and :data:`SIGMA_FLOOR_DEG`, deg."""
        pan, tilt, _ = (
            math.sqrt(max(0.0, square / self._counted - (total / self._counted) ** 2))
            for square, total in zip(self._squares, self._sums, strict=True)
        )
        return math.hypot(pan * math.cos(math.radians(self._first.tilt_deg)), tilt, SIGMA_FLOOR_DEG)


class PoseRing:
    """Reports of the last ten seconds with their interpretation.

    Parameters
    ----------
    stillness : Stillness
    settle_ns : int
        Rest before the pose at a time counts as stable.
    """

    def __init__(self, stillness: Stillness, settle_ns: int) -> None:
        self._stillness = stillness
        self._settle_ns = settle_ns
        self._witness_ns = round(WITNESS_SHARE * settle_ns)
        self._poses: deque[Pose] = deque()
        self._runs: deque[Run] = deque()
        self._run: Run | None = None
        self._commanded = False
        self._waiting: tuple[int, HeadReading | None] | None = None
        self._foreign = False
        self._stopped_ns: int | None = None

    @property
    def latest(self) -> Pose | None:
        """The newest report."""
        return self._poses[-1] if self._poses else None

    @property
    def rest(self) -> Run | None:
        """The present run when it is proven."""
        run = self._run
        return run if run is not None and run.proven(self._stillness.rest_s) else None

    def reset(self) -> None:
        """Forget everything, as after a loss."""
        self._poses.clear()
        self._runs.clear()
        self._run = self._waiting = self._stopped_ns = None
        self._commanded = self._foreign = False

    def commanded(self, t_ns: int) -> None:
        """The head was told to move or stop at ``t_ns``: what it reported before proves nothing any more."""
        start_ns = round(self._stillness.start_s * 1e9)
        # Only a head that rested can be seen to leave; one in motion may still finish the motion before.
        rest = self.rest
        self._waiting = (t_ns + start_ns, None if rest is None else rest.mean)
        self._commanded = True
        self._foreign = False
        self._run = self._stopped_ns = None

    def started(self) -> None:
        """The camera said that the head moves: nobody needs to wait for that any more."""
        self._waiting = self._stopped_ns = None

    def stopped(self, t_ns: int) -> None:
        """The camera said at ``t_ns`` that the head does not move any more."""
        self._stopped_ns = t_ns

    @property
    def confirmed_at_ns(self) -> int | None:
        """From when on a report can confirm the camera's own word that the head stands; None when nothing waits for it.

        On the scale of the reports' times, so a report of that age is asked for later by its lag.
        """
        waits = self._stopped_ns is not None and self._run is not None and not self._run.witnessed
        return self._stopped_ns + self._witness_ns if waits and self._stopped_ns is not None else None

    def add(self, t_ns: int, half_round_trip_ns: int, reading: HeadReading) -> Pose:
        """Take a report.

        Parameters
        ----------
        t_ns : int
            When the head was there: middle of the round trip minus the report's age.
        half_round_trip_ns : int
            How uncertain that is.
        reading : HeadReading
            The report.
        """
        if self._still_waiting(t_ns, reading):
            motion = Motion.MOVING
        else:
            motion = self._continue_run(t_ns, half_round_trip_ns, reading)
        pose = Pose(
            t_ns=t_ns, half_round_trip_ns=half_round_trip_ns, reading=reading, motion=motion, foreign=self._foreign
        )
        self._poses.append(pose)
        while self._poses[0].t_ns < t_ns - KEPT_NS:
            self._poses.popleft()
        while self._runs and self._runs[0].last_ns < t_ns - KEPT_NS:
            self._runs.popleft()
        return pose

    def _still_waiting(self, t_ns: int, reading: HeadReading) -> bool:
        if self._waiting is None:
            return False
        until_ns, before = self._waiting
        left = before is not None and not self.equal(reading, before)
        if left or t_ns >= until_ns:
            self._waiting = None
        return self._waiting is not None

    def _continue_run(self, t_ns: int, half_round_trip_ns: int, reading: HeadReading) -> Motion:
        run = self._run
        if run is not None and run.extend(t_ns, half_round_trip_ns, reading, self._stillness):
            run.witnessed |= self._stopped_ns is not None and t_ns - self._stopped_ns >= self._witness_ns
            if not run.proven(self._stillness.rest_s):
                return Motion.SETTLING
            self._foreign = False
            # A shorter rest may lie between two commands, before the second one has started.
            self._commanded = self._commanded and run.span_ns < self._stillness.start_s * 1e9
            return Motion.STABLE if run.witnessed or run.span_ns >= self._settle_ns else Motion.SETTLING
        known = bool(self._poses)
        if run is not None and not self._commanded:
            self._foreign = True
        self._run = Run(t_ns, half_round_trip_ns, reading)
        self._runs.append(self._run)
        return Motion.MOVING if known else Motion.UNKNOWN

    def equal(self, a: HeadReading, b: HeadReading) -> bool:
        """Whether two reports differ by no more than those of a head at rest."""
        pan, tilt, zoom = offset_of(a, b)
        still = self._stillness
        return abs(pan) <= still.span_deg and abs(tilt) <= still.span_deg and abs(zoom) <= still.span_zoom

    def rest_over(self, start_ns: int, end_ns: int) -> Run | None:
        """The run during which the head rested all the time from ``start_ns`` to ``end_ns``, if there is one."""
        for run in reversed(self._runs):
            if run.first_ns <= start_ns and end_ns <= run.last_ns:
                return run if run.proven(self._stillness.rest_s) else None
        return None

    def at(self, t_ns: int) -> tuple[HeadReading, Motion] | None:
        """Where the head is believed to have been at ``t_ns``, and what it did; None without any report.

        Between two reports by interpolation; up to 0.2 s beyond the latest one a moving head goes on as before.
        """
        if not self._poses:
            return None
        after = None
        for pose in reversed(self._poses):
            if pose.t_ns <= t_ns:
                if after is None:
                    return self._beyond(pose, t_ns)
                share = (t_ns - pose.t_ns) / (after.t_ns - pose.t_ns)
                return _between(pose.reading, after.reading, share), self._labelled(after.motion, t_ns)
            after = pose
        return self._poses[0].reading, Motion.UNKNOWN

    def _labelled(self, motion: Motion, t_ns: int) -> Motion:
        """Stable only when the head had rested for the settle time by then: before that it may still swing."""
        if motion is not Motion.STABLE:
            return motion
        since_ns, run = t_ns - self._settle_ns, self._run
        settled = (run is not None and run.first_ns <= since_ns) or self.rest_over(since_ns, t_ns) is not None
        return Motion.STABLE if settled else Motion.SETTLING

    def _beyond(self, latest: Pose, t_ns: int) -> tuple[HeadReading, Motion]:
        ahead_ns = t_ns - latest.t_ns
        if ahead_ns > KEPT_NS:
            return latest.reading, Motion.UNKNOWN
        if latest.motion is not Motion.MOVING or len(self._poses) < 2:
            return latest.reading, self._labelled(latest.motion, t_ns)
        before = self._poses[-2]
        share = 1 + min(ahead_ns, EXTRAPOLATED_NS) / max(1, latest.t_ns - before.t_ns)
        return _between(before.reading, latest.reading, share), latest.motion


def wrapped_deg(angle_deg: float) -> float:
    """The same direction within (−180, 180]."""
    wrapped = math.remainder(angle_deg, 360.0)
    return 180.0 if wrapped == -180.0 else wrapped


def offset_of(reading: HeadReading, reference: HeadReading) -> Triple:
    """Difference in pan (the short way round), tilt and zoom."""
    return (
        math.remainder(reading.pan_deg - reference.pan_deg, 360.0),
        reading.tilt_deg - reference.tilt_deg,
        reading.zoom - reference.zoom,
    )


def _each(function: Callable[[float, float], float], a: Triple, b: Triple) -> Triple:
    return (function(a[0], b[0]), function(a[1], b[1]), function(a[2], b[2]))


def _between(a: HeadReading, b: HeadReading, share: float) -> HeadReading:
    pan, tilt, zoom = offset_of(b, a)
    return HeadReading(
        pan_deg=wrapped_deg(a.pan_deg + share * pan), tilt_deg=a.tilt_deg + share * tilt, zoom=a.zoom + share * zoom
    )
