"""Asking for work: every move, picture and match gets an id and a deadline, and is remembered until answered."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from ptzd.config import Config, with_parts
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.head_state import Awaited, HeadState, HeadWork, LensWork, MatchWork
from ptzd.control.planning.by_hand import FORESIGHT_S
from ptzd.control.planning.ranges import RangeMap
from ptzd.control.planning.reach import Reach, reach_of
from ptzd.control.planning.span import Span
from ptzd.control.planning.zones import zones_of
from ptzd.errors import GeometryError
from ptzd.geometry.rig import Rig
from ptzd.geometry.zones import Zone
from ptzd.model import AUTOMATIC, Box, FrameRef, HeadReading, HeadSpeed, Lens, Motion, ViewRef

GRAB_GUARD_NS = 7_000_000_000
"""On top of the silence after which the stream counts as lost: to connect anew (5 s) and to prove rest (2 s)."""
NEAR_SHARE = 0.01
"""Of the field of view: half of what a lock takes for centred there."""
MOST_SPARED = 3
"""Moves in a row that one event may do without the motor: whoever goes round in circles is slowed by it."""
MATCH_GUARD_NS = 30_000_000_000
"""A match takes milliseconds; a worker silent for this long is stuck."""
MOVE_GUARD_NS = 5_000_000_000
"""On top of the head's own time-out, which answers first unless the adapter is stuck."""
REACTION_S = 0.44
"""How long a head that is steered may go on at the speed before: a report, an order and the brakes together."""
UNSURE_NS = 1_000_000_000
"""After an order, reports of rest may be of the rest before it."""


def seconds(value: float) -> int:
    """Convert seconds to ns."""
    return round(value * 1e9)


@dataclass(slots=True, kw_only=True)
class Work:
    """What one event sets going: the commands so far, on top of what the head was asked for before."""

    rig: Rig
    config: Config
    head: HeadState
    ranges: RangeMap
    zones: tuple[Zone, ...] = field(init=False)
    t_ns: int = 0
    out: list[cmd.Command] = field(default_factory=list)
    spared: list[int] = field(default_factory=list)
    """Moves that this event asked for and that are done without the motor."""

    refusal: str | None = None
    """Why the move asked for last was not made; whoever asked is told once his step is over."""

    def __post_init__(self) -> None:
        self.zones = zones_of(self.config, self.rig)

    def begin(self, t_ns: int) -> None:
        """Be about the next event."""
        self.t_ns, self.out, self.spared, self.refusal = t_ns, [], [], None

    def on_settings(self, event: ev.SettingsChanged) -> None:
        """Other settings hold from now on; another ``home.idle_s`` is newer than what somebody said before."""
        before, self.config = self.config, with_parts(self.config, event.parts)
        if before.home.idle_s != self.config.home.idle_s:
            self.head.home_after = None

    @property
    def home_after_s(self) -> float | None:
        """How long the head is left where it is before it goes home; None: it does not by itself."""
        told = self.head.home_after
        return self.config.home.idle_s if told is None else told.after_s

    @property
    def reach(self) -> Reach:
        """Where the head may go."""
        if self.head.limits is None:
            raise AssertionError("a reach without limits")
        return reach_of(self.head.limits, self.rig, self.zones)

    def _new_id(self) -> int:
        number = self.head.next_id
        self.head.next_id += 1
        return number

    def move(self, target: HeadReading) -> None:
        """Move the head, unless it rests there already; replaces whatever it was asked before.

        A zone in between is gone around. Where none of the ways leads there, or the target lies in a zone, nothing
        moves: whoever has the head is told by `Activity.on_failed`, and everybody by a `RefuseMove`.

        Raises
        ------
        GeometryError
            When the target is outside the limits: planning must not ask for that.
        """
        limits = self.head.limits
        if limits is None or not limits.contains(target):
            raise GeometryError(
                f"move to pan {target.pan_deg:.3f}°, tilt {target.tilt_deg:.3f}°, zoom {target.zoom:.0f} "
                f"is outside the limits {limits}"
            )
        way = self.way_to(target)
        if isinstance(way, str):
            self.head.asked, self.refusal = None, way
            self.out.append(cmd.RefuseMove(target=target, reason=way))
        else:
            self._leg(way)

    def way_to(self, target: HeadReading) -> list[HeadReading] | str:
        """Set points that lead to a target within the limits, or why the head does not go there."""
        reach, head = self.reach, self.head
        pose = f"pan {target.pan_deg:.2f}°, tilt {target.tilt_deg:.2f}°"
        objection = reach.objection(target)
        if objection is not None:
            return f"{pose} is {objection}"
        if not reach.has_ways or head.reading is None:
            return [target]
        here, first = head.span or Span.at(head.reading), []
        if not here.is_point and head.bound_for is not None and not reach.leg_free(here, target):
            # under way, and nobody knows how far: it goes on to where it was sent, and from there
            first, here = [head.bound_for], Span.at(head.bound_for)
        way = reach.way(here, target, zoom=(first[0] if first else head.reading).zoom)
        if way is None:
            names = ", ".join(zone.name for zone in reach.no_go)
            return f"no way leads around the no_go zones ({names}) to {pose}"
        return [*first, *way]

    def _leg(self, way: list[HeadReading]) -> None:
        target, number = way[0], self._new_id()
        until = self.t_ns + seconds(self.config.ptz.move_timeout_s) + MOVE_GUARD_NS
        self.head.asked = HeadWork(kind=Awaited.MOVE, id=number, until_ns=until, way=way[1:])
        self.head.moved_ns = self.t_ns
        if len(way) == 1 and self._rests_near(target) and len(self.spared) < MOST_SPARED:
            self.spared.append(number)
            self.head.travel.spared += 1
            self.out.append(cmd.SpareMove(move_id=number, target=target))
            return
        rested = self.head.going is None and self.head.motion is Motion.STABLE
        self.head.left, self.head.headed = (self.head.reading if rested else None), target
        self.head.going = number
        self.head.travel.move(self.t_ns)
        self._note_order(target)
        self.out.append(cmd.MoveHead(move_id=number, target=target))

    def steer(self, speed: HeadSpeed, until_ns: int) -> None:
        """Turn and zoom at this speed until then; replaces whatever the head was asked before."""
        number = self._new_id()
        answered_ns = until_ns + seconds(self.config.ptz.stall_s) + MOVE_GUARD_NS
        self.head.asked = HeadWork(kind=Awaited.MOVE, id=number, until_ns=answered_ns)
        if self.head.going is None:
            self.head.travel.move(self.t_ns)  # however many words it takes to go on
        self.head.going = number
        self.head.moved_ns = self.t_ns
        if self.reach.has_ways and self.head.reading is not None:
            here = self.head.reading
            self.head.span = self.drifting().drifted(speed, FORESIGHT_S)
            self.head.bound_for, self.head.unsure_ns = here, until_ns + UNSURE_NS
            self.head.steered = speed
        self.out.append(cmd.SteerHead(move_id=number, speed=speed, until_ns=until_ns))

    def dead_zone_deg(self, zoom: float) -> float:
        """How near to a set point the head may rest: no more than half of what a lock corrects at this zoom."""
        config, (low, high) = self.config, self.rig.zoom.zoom_range
        hfov = math.degrees(self.rig.zoom.camera_at(min(max(zoom, low), high)).hfov_rad)
        return min(config.motor.dead_zone_deg, config.lock.tolerance_deg / 2, NEAR_SHARE * hfov)

    def _rests_near(self, target: HeadReading) -> bool:
        head, near_deg = self.head, self.dead_zone_deg(target.zoom)
        if head.reading is None or head.going is not None or head.motion is not Motion.STABLE:
            return False
        pan = math.remainder(target.pan_deg - head.reading.pan_deg, 360.0)
        return (
            math.hypot(pan, target.tilt_deg - head.reading.tilt_deg) <= near_deg
            and abs(target.zoom - head.reading.zoom) <= self.config.ptz.zoom_tolerance
            and near_deg > 0
        )

    def came_to_rest(self, move_id: int | None, rests: HeadReading | None = None) -> None:
        """It is known where the move led, or the head was told to stand."""
        head = self.head
        if move_id is None or move_id == head.going:
            if head.left is not None and head.headed is not None and rests is not None:
                head.doubts.came(head.left, head.headed, rests)
            head.going = head.left = head.headed = None

    def drifting(self) -> Span:
        """Where a head that is steered may be by now: it goes on for a while at the speed that it was told."""
        head = self.head
        if head.reading is None:
            raise AssertionError("a head that nobody has seen cannot be steered")
        here = head.span if head.span is not None and head.steered is None else Span.at(head.reading)
        return here if head.steered is None else here.drifted(head.steered, REACTION_S)

    def _note_order(self, target: HeadReading) -> None:
        """Keep where the head may be from now on."""
        head, reach = self.head, self.reach
        if reach.has_ways and head.reading is not None:
            head.span = (head.span or Span.at(head.reading)).to(target, endless_pan=reach.limits.endless_pan)
            head.bound_for, head.unsure_ns = target, self.t_ns + UNSURE_NS
        head.steered = None

    def arrived(self, number: int, reading: HeadReading) -> bool:
        """Whether the head is where it was sent; at the end of one leg of a way the next one begins."""
        self.head.reading = reading
        asked = self.head.asked
        if asked is None or not self.answers_head(Awaited.MOVE, number):
            return False
        self.rests(reading)
        if asked.way:
            self._leg(asked.way)
        return not asked.way

    def reported_rest(self, reading: HeadReading) -> None:
        """A report says that the head rests: where it is, unless that may be of before the last order."""
        moving = self.head.asked is not None and self.head.asked.kind is Awaited.MOVE
        if not moving and self.t_ns >= self.head.unsure_ns:
            self.rests(reading)

    def rests(self, reading: HeadReading) -> None:
        """It is known where the head is."""
        self.head.steered = None
        if self.head.span is not None:
            self.head.span = Span.at(reading)

    def set_lens(self, lens: Lens, token: int | None) -> None:
        """Set focus and iris; whoever asked hears what came of it."""
        number = self._new_id()
        until_ns = self.t_ns + seconds(self.config.ptz.stall_s) + MOVE_GUARD_NS
        self.head.lenses.append(LensWork(id=number, token=token, lens=lens, until_ns=until_ns))
        self.out.append(cmd.SetLens(lens_id=number, lens=lens))

    def leave_lens(self) -> None:
        """What somebody set by hand, the camera sets for itself again."""
        by_hand, self.head.by_hand = self.head.by_hand, Lens()
        if by_hand != Lens():
            focus = None if by_hand.focus is None else AUTOMATIC
            self.set_lens(Lens(focus=focus, iris=None if by_hand.iris is None else AUTOMATIC), None)

    def lens_over(self, number: int, refused: str = "") -> None:
        """The camera took it, or with a reason: did not."""
        work = next((work for work in self.head.lenses if work.id == number), None)
        if work is None:
            return
        self.head.lenses.remove(work)
        if not refused:
            self.head.by_hand = _by_hand(self.head.by_hand, work.lens)
        if work.token is None:
            return
        if refused:
            self.out.append(cmd.ReplyRefused(token=work.token, code="refused", message=refused, field="$.lens"))
        else:
            self.out.append(cmd.ReplyMove(token=work.token, lens=work.lens))

    def grab(self, not_before_ns: int) -> None:
        """Ask for a picture taken at rest at or after this time; after a move, rest before it never counts."""
        number = self._new_id()
        until = self.t_ns + seconds(self.config.ptz.stall_s) + GRAB_GUARD_NS
        self.head.asked = HeadWork(kind=Awaited.GRAB, id=number, until_ns=until)
        self.out.append(cmd.GrabView(grab_id=number, not_before_ns=not_before_ns))

    def match(
        self,
        *,
        request_id: str,
        frame: FrameRef,
        box: Box,
        view: ViewRef,
        view_index: int,
        inverse_range: tuple[float, float],
        band_rad: float,
    ) -> None:
        """Ask for a match of a region in a view."""
        number = self._new_id()
        self.head.matches.append(MatchWork(id=number, view=view_index, until_ns=self.t_ns + MATCH_GUARD_NS))
        search = self.config.search
        self.out.append(
            cmd.RunMatch(
                match_id=number,
                request_id=request_id,
                frame=frame,
                box=box,
                view=view,
                inverse_range=inverse_range,
                band_rad=band_rad,
                matcher=search.matcher,
                seed=search.seed,
                budget_s=search.match_budget_s,
            )
        )

    def stop(self) -> None:
        """Stop the head; it is asked for nothing more."""
        self.head.asked = None
        self.head.unsure_ns = self.t_ns + UNSURE_NS
        self.out.append(cmd.StopHead())

    def abandon(self) -> None:
        """Forget what is under way; late answers are ignored by their id."""
        self.head.asked = None
        if self.head.matches:
            self.head.matches.clear()
            self.out.append(cmd.AbandonMatches())

    @property
    def looking(self) -> bool:
        """Whether a look is under way: a move, a picture or a match that will be answered."""
        return self.head.asked is not None or bool(self.head.matches)

    def answers_head(self, kind: Awaited, number: int) -> bool:
        """Whether this is the answer the core waits for; if so, it waits no more."""
        asked = self.head.asked
        if asked is None or asked.kind is not kind or asked.id != number:
            return False
        self.head.asked = None
        return True

    def answers_match(self, number: int) -> MatchWork | None:
        """Take the match of this id off the list, None when it was abandoned."""
        for work in self.head.matches:
            if work.id == number:
                self.head.matches.remove(work)
                return work
        return None

    def feedback(self, request_id: str, step: str, **detail: object) -> None:
        """Tell whoever follows a request about one step."""
        self.out.append(cmd.PublishFeedback(id=request_id, step=step, detail=detail))


def _by_hand(before: Lens, taken: Lens) -> Lens:
    """What is set by hand after the camera took something."""
    focus = before.focus if taken.focus is None else taken.focus or None
    return Lens(focus=focus, iris=before.iris if taken.iris is None else taken.iris or None)
