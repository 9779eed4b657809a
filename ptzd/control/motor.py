"""Sparing the motor: what it has gone in its life and in the last hour, and whose wish still finds a share of that."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ptzd.config import Motor
from ptzd.control.ranks import PRIORITIES, Rank
from ptzd.model import HeadReading

MINUTE_NS = 60_000_000_000
MINUTES = 60
"""A budget is of the last hour, counted by the minute."""
STEP_DEG = 0.05
STEP_ZOOM = 8.0
"""Reports that differ by less are the same place: encoders tremble, and trembling is no way."""


@dataclass(slots=True, kw_only=True)
class Minute:
    """What was done in one minute of the clock."""

    number: int
    """Minutes since the epoch."""
    moves: int = 0
    degrees: float = 0.0
    """Pan and tilt together."""


@dataclass(slots=True, kw_only=True)
class Travel:
    """What the motors have gone, whoever moved them."""

    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    zoom_steps: float = 0.0
    moves: int = 0
    """Asked for here."""
    spared: int = 0
    """Not driven, since the head stood near enough."""
    minutes: list[Minute] = field(default_factory=list)
    """Of the last hour, those in which something was done."""
    counted: HeadReading | None = None
    """Up to where it is counted."""

    def report(self, reading: HeadReading, t_ns: int) -> None:
        """Take in where the head is."""
        if self.counted is None:
            self.counted = reading
            return
        before = self.counted
        # the short way round: a head that passes ±180° has not gone back a whole turn
        pan = abs(math.remainder(reading.pan_deg - before.pan_deg, 360.0))
        tilt, zoom = abs(reading.tilt_deg - before.tilt_deg), abs(reading.zoom - before.zoom)
        if pan < STEP_DEG and tilt < STEP_DEG and zoom < STEP_ZOOM:
            return
        self.pan_deg += pan
        self.tilt_deg += tilt
        self.zoom_steps += zoom
        self._minute(t_ns).degrees += pan + tilt
        self.counted = reading

    def move(self, t_ns: int) -> None:
        """A move is asked for."""
        self.moves += 1
        self._minute(t_ns).moves += 1

    def _minute(self, t_ns: int) -> Minute:
        number = t_ns // MINUTE_NS
        self.minutes[:] = [minute for minute in self.minutes if minute.number > number - MINUTES]
        if not self.minutes or self.minutes[-1].number != number:
            self.minutes.append(Minute(number=number))
        return self.minutes[-1]

    def hour(self, t_ns: int) -> tuple[int, float]:
        """Moves, and degrees of pan and tilt together, of the last hour."""
        lately = [minute for minute in self.minutes if minute.number > t_ns // MINUTE_NS - MINUTES]
        return sum(minute.moves for minute in lately), sum(minute.degrees for minute in lately)


@dataclass(frozen=True, slots=True, kw_only=True)
class Spent:
    """A budget that has no share left for a rank."""

    words: str
    """Which, how much of it there is, how much is used."""
    frees_ns: int
    """When there is some again, if nothing more is used."""


def share_of(rank: int, motor: Motor) -> float:
    """How much of a budget a rank may find used and still begin; infinite for people, a stop and the way home.

    Requests of priority 9 may use all of it, those of priority 0 leave ``motor.reserve`` to the higher ones, and what
    ranks below every request leaves twice that.
    """
    if rank >= Rank.GOTO or rank <= Rank.HOME:
        return math.inf
    if rank < Rank.REQUEST:
        return max(1.0 - 2 * motor.reserve, 0.0)
    return 1.0 - motor.reserve * max(Rank.REQUEST + PRIORITIES - rank, 0) / PRIORITIES


def spent(travel: Travel, motor: Motor, rank: int, t_ns: int) -> Spent | None:
    """The budget that keeps a rank from moving now, the one that lasts longest; None: it may."""
    share = share_of(rank, motor)
    found = []
    for name, budget, uses in (
        ("moves", motor.moves_per_hour, [(minute.number, float(minute.moves)) for minute in travel.minutes]),
        ("degrees", motor.degrees_per_hour, [(minute.number, minute.degrees) for minute in travel.minutes]),
    ):
        if budget is None or math.isinf(share):
            continue
        lately = [(number, used) for number, used in uses if number > t_ns // MINUTE_NS - MINUTES]
        left = sum(used for _, used in lately)
        if left < share * budget:
            continue
        words = (
            f"motor.{name}_per_hour: {left:.0f} {name} in the last hour, of {budget:g} this rank may use {share:.0%}"
        )
        found.append(Spent(words=words, frees_ns=_frees_ns(lately, left, share * budget)))
    return max(found, key=lambda spent: spent.frees_ns, default=None)


def _frees_ns(lately: list[tuple[int, float]], used: float, most: float) -> int:
    """When so many of the oldest minutes are over that less than ``most`` is left."""
    for number, gone in lately:
        used -= gone
        if used < most:
            return (number + MINUTES) * MINUTE_NS
    return (lately[-1][0] + MINUTES) * MINUTE_NS
