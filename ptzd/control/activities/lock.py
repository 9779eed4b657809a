"""The lock: centre, correct from the picture, zoom, verify, hold and follow, re-acquire once."""

from __future__ import annotations

import math
from enum import StrEnum
from typing import ClassVar

import numpy as np

from ptzd.control.activities.activity import Activity, Failure, Over, Step, out_of_time
from ptzd.control.head_state import Awaited
from ptzd.control.planning.decision import Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.control.planning.neighbourhood import arc_of, band_rad, neighbourhood
from ptzd.control.planning.reach import well_inside
from ptzd.control.planning.zoom import SAFE_SHARE, zoom_wanted
from ptzd.control.requests import Task
from ptzd.control.states import State
from ptzd.control.work import Work, seconds
from ptzd.geometry.sphere import angle_between, bearing, pan_tilt
from ptzd.geometry.types import Array, pixel_angle_rad
from ptzd.model import Candidate, HeadLimits, HeadReading, MatchResult, Outcome, ViewRef, ZoneKind

NARROW_PX = 4.0
"""Half width of the search around a known place, in fisheye pixels along the arc."""
WIDE_PX = 16.0
"""The same when the place was lost, or the target has moved."""
STANDING_PX = 1.0
"""A box that moved by less is where it was: the match knows the place better than the arc does."""
MAX_MISSES = 3
"""Looks in a row that may fail while newer boxes come; after them the target is lost."""
CONFIRMED_LOOKS = 3
"""The target counts as held for so many ``verify_every_s`` after a confirmation."""
ZOOMED_SHARE = 0.02
"""At the final zoom an offset under 2 % of the field of view is centred: nobody sees it."""


class Phase(StrEnum):
    """Steps inside a lock."""

    CENTRING = "centring"
    ZOOMING = "zooming"
    HOLDING = "holding"
    REACQUIRING = "reacquiring"


class Lock(Activity, kw_only=True, tag="lock"):
    """The region was found; now it is centred, shown as asked, verified and held."""

    state: ClassVar[State] = State.LOCK

    task: Task
    place: Candidate
    probability: float
    wide_zoom: float
    """Zoom at which the region was found; re-acquisition goes back to it."""
    zoom: float
    """Zoom of the present step."""
    phase: Phase = Phase.CENTRING
    sigma_deg: float = 0.0
    corrections: int = 0
    may_zoom: bool = True
    """False after a verification at the asked zoom failed, and for a target that cannot be centred."""
    off_centre: bool = False
    """The head's limits keep the target off the picture's centre."""
    confirmed: bool = False
    confirmed_ns: int = 0
    """When a picture confirmed the place last; 0 before the first one."""
    misses: int = 0
    """Looks without a confirmation since the last one."""
    moved: bool = False
    """The box has moved since the place was confirmed."""
    locked_ns: int | None = None
    """From then on the client has its lock, and its time-out is kept."""
    overdue: bool = False
    """The hold is over, but the last confirmation is too old to say so: the next look decides."""
    verify_ns: int | None = None
    view: ViewRef | None = None
    """The picture matched last."""
    box_ptz: tuple[tuple[float, float], ...] = ()
    note: str = ""

    def phase_now(self) -> str:
        """See `Activity`."""
        return self.phase

    def begin(self, work: Work) -> Step:
        """Centre what the scan found."""
        found = self.place
        self.sigma_deg = self._sigma_of(work, found)
        if self._adopt_newest(work):
            self.phase = Phase.REACQUIRING
        self._zoom_at_once(work)
        self._tell(work, "found", probability=round(self.probability, 4), score=round(found.score, 4))
        return self._aim(work)

    def on_arrived(self, work: Work) -> Step:
        """Take the picture."""
        work.grab(work.head.moved_ns)
        return None

    def on_picture(self, work: Work, view: ViewRef) -> Step:
        """Match again, now knowing nearly where."""
        request = self.task.request
        self.task.views += 1
        self.view = view
        near = self.phase is Phase.HOLDING or not self.moved
        half = NARROW_PX if near and self.phase is not Phase.REACQUIRING else WIDE_PX
        work.match(
            request_id=request.id,
            frame=request.frame,
            box=request.box,
            view=view,
            view_index=0,
            inverse_range=neighbourhood(work.rig, request, self.place.inverse_range, half),
            band_rad=band_rad(work.rig, request),
        )
        return None

    def on_match(self, work: Work, view: int, result: MatchResult) -> Step:
        """Verified or not; go to the next step, on the newest box that came meanwhile."""
        del view
        if self.view is None:
            raise AssertionError("a match in a lock without its view")
        decision = decide([(0, result)], Thresholds(accept_probability=work.config.lock.verify_probability))
        if decision.best is None or decision.outcome is not Verdict.FOUND:
            return self._unverified(work, decision.reason)
        self._confirm(work, decision.best, decision.probability, self.view)
        offset = _offset_rad(work, decision.best, self.view.reading)
        self._tell(
            work,
            "correction" if self.phase is not Phase.HOLDING else "verify",
            offset_deg=round(math.degrees(offset), 4),
            probability=round(decision.probability, 4),
            score=round(decision.best.score, 4),
            zoom=self.view.reading.zoom,
            seq=self.view.frame.seq,
        )
        if self.phase is Phase.REACQUIRING:
            self.phase = Phase.CENTRING
        centred = self.off_centre or offset <= self._tolerance_rad(work)
        if not centred and self.corrections < work.config.lock.max_corrections:
            self.corrections += 1
            self._adopt_newest(work)
            return self._aim(work)
        return self._next_step(work)

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """A match that could not run confirms nothing; a head that does not come ends the lock."""
        if failure.what is Awaited.MATCH:
            return self._unverified(work, failure.reason)
        return Over(outcome=Outcome.LOST if self.confirmed else Outcome.UNREACHABLE, reason=failure.reason)

    def on_update(self, work: Work) -> Step:
        """The target has a newer box: follow it at its last known range, once the look under way is in."""
        return None if work.looking else self._follow(work)

    def on_time(self, work: Work) -> Step:
        """Out of time before the lock, the hold is over, or it is time to verify."""
        if self.locked_ns is None:
            return out_of_time(work, self.task.request.expires_ns)
        end = self._hold_ends_ns(work)
        if end is not None and work.t_ns >= end:
            if self._confirmed_lately(work):
                reason = self.note or "held as asked"
                return Over(outcome=Outcome.LOCKED, reason=reason, probability=self.probability)
            self.overdue = True
            if not work.looking:
                self.verify_ns = work.t_ns
        if self.verify_ns is not None and work.t_ns >= self.verify_ns:
            self.verify_ns, self.corrections = None, 0
            work.grab(work.t_ns)
        return None

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        end = self.task.request.expires_ns if self.locked_ns is None else self._hold_ends_ns(work)
        return min((at for at in (end, self.verify_ns) if at is not None), default=None)

    def _hold_ends_ns(self, work: Work) -> int | None:
        """When the hold is over; None before the lock, while an operator holds, and once only a look can end it."""
        if self.locked_ns is None or self.overdue or work.head.held:
            return None
        return self.locked_ns + self.task.request.hold_ns

    def _confirm(self, work: Work, place: Candidate, probability: float, view: ViewRef) -> None:
        self.place, self.probability = place, probability
        self.confirmed_ns, self.misses, self.moved, self.overdue = work.t_ns, 0, False, False
        self.sigma_deg = math.hypot(self._sigma_of(work, place), view.sigma_deg)
        self.box_ptz = place.box_px

    def _confirmed_lately(self, work: Work) -> bool:
        """Whether the target was seen in its place so lately that it counts as held."""
        oldest = work.t_ns - CONFIRMED_LOOKS * seconds(work.config.lock.verify_every_s)
        return self.misses == 0 and self.confirmed_ns >= oldest

    def _unverified(self, work: Work, reason: str) -> Step:
        """The picture did not confirm: look again from where it was found, then give up."""
        self.misses += 1
        newer = self._adopt_newest(work) and self.misses < MAX_MISSES
        if self.phase in {Phase.CENTRING, Phase.REACQUIRING} and not newer:
            outcome = Outcome.LOST if self.confirmed else Outcome.NOT_FOUND
            told = f"{self.phase}: {reason}"
            return Over(outcome=outcome, reason=told, probability=self.probability, again=not self.overdue)
        if self.phase is Phase.ZOOMING and self.confirmed:
            self.may_zoom = False
            self.note = f"held at the zoom of the scan, since at the asked zoom: {reason}"
        self._tell(work, "note", text=f"{self.phase}: {reason}; looking again from zoom {self.wide_zoom:g}")
        self.phase, self.zoom, self.corrections, self.verify_ns = Phase.REACQUIRING, self.wide_zoom, 0, None
        return self._aim(work)

    def _zoom_at_once(self, work: Work) -> None:
        """Centre and zoom in one move where the place is known well enough; it is verified there all the same."""
        if self.phase is not Phase.CENTRING or self.probability < work.config.search.certain_probability:
            return
        target = self._zoom_wanted(work)
        hfov = work.rig.zoom.camera_at(target).hfov_rad
        if self._error_rad(work) <= SAFE_SHARE * hfov and target != self.zoom:
            self.phase, self.zoom = Phase.ZOOMING, target

    def _next_step(self, work: Work) -> Step:
        self.confirmed = True
        if self.locked_ns is None and (late := out_of_time(work, self.task.request.expires_ns)) is not None:
            return late
        if self.phase is Phase.CENTRING and self.may_zoom:
            target = self._zoom_wanted(work)
            if abs(target - self.zoom) > work.config.ptz.zoom_tolerance:
                self._adopt_newest(work)
                self.phase, self.zoom, self.corrections = Phase.ZOOMING, self._zoom_wanted(work), 0
                return self._aim(work)
        self.phase = Phase.HOLDING
        self.verify_ns = work.t_ns + seconds(work.config.lock.verify_every_s)
        if self.locked_ns is None:
            self.locked_ns = work.t_ns
            elapsed_ms = (work.t_ns - self.task.request.accepted_ns) // 1_000_000
            self._tell(work, "locked", elapsed_ms=elapsed_ms, range_m=range_of(self.place))
        return self.on_time(work) or self._follow(work)

    def _follow(self, work: Work) -> Step:
        """Look for the newest box, if one waits."""
        if self.task.request.newer is None:
            return None
        self._adopt_newest(work)
        self.corrections, self.verify_ns = 0, None
        return self._aim(work)

    def _aim(self, work: Work) -> Step:
        """Point at the place, or as near as limits and zones let the head, if it is well inside the picture there."""
        direction = bearing(self.place.pan_rad, self.place.tilt_rad)
        zone = work.reach.holds(direction)
        if zone is not None and zone.kind is ZoneKind.PRIVACY:
            reason = f"the target lies in the privacy zone {zone.name}"
            return Over(outcome=Outcome.UNREACHABLE, reason=reason, probability=self.probability)
        target = work.rig.aim(direction, self.zoom)
        self.off_centre = False
        if not work.reach.contains(target):
            self.zoom, self.may_zoom = self.wide_zoom, False
            self.phase = Phase.CENTRING if self.phase is Phase.ZOOMING else self.phase
            allowed = work.reach.nearest(work.rig.aim(direction, self.zoom))
            over = self._past_limits(work, direction, target, allowed)
            if over is not None:
                return over
            target, self.zoom = allowed, allowed.zoom
        work.move(target)
        return None

    def _past_limits(self, work: Work, direction: Array, target: HeadReading, allowed: HeadReading) -> Over | None:
        """Say why the head looks from elsewhere, or less closely, than it would; the end when it is too far off."""
        objection = work.reach.objection(target)
        self.off_centre = (allowed.pan_deg, allowed.tilt_deg) != (target.pan_deg, target.tilt_deg)
        outside = "outside the head's limits" if objection is None else objection
        if not well_inside(work.rig, direction, allowed):
            reason = f"the target at pan {target.pan_deg:.2f}°, tilt {target.tilt_deg:.2f}° is {outside}"
            return Over(outcome=Outcome.UNREACHABLE, reason=reason, probability=self.probability)
        why = "past a limit" if objection is None else objection
        pose = f"tilt {target.tilt_deg:.2f}°, pan {target.pan_deg:.2f}°"
        self.note = f"held off the picture's centre: {pose} is {why}" if self.off_centre else f"shown no closer: {why}"
        return None

    def _adopt_newest(self, work: Work) -> bool:
        """Take over the box that waits and predict its place; whether there was one, and it is elsewhere."""
        request = self.task.request
        old = request.box
        if not request.adopt_newest():
            return False
        moved = max(math.dist(here, there) for here, there in zip(old.corners, request.box.corners, strict=True))
        if moved >= STANDING_PX:
            self.place, self.moved = self._predicted(work), True
        return moved >= STANDING_PX

    def _predicted(self, work: Work) -> Candidate:
        """Where the new box's centre is seen from the head if the range has not changed."""
        place = self.place
        pan, tilt = pan_tilt(arc_of(work.rig, self.task.request).bearing(place.inverse_range))
        return Candidate(
            pan_rad=float(pan),
            tilt_rad=float(tilt),
            inverse_range=place.inverse_range,
            offset_rad=place.offset_rad,
            score=place.score,
            sharpness=place.sharpness,
            sigma_rad=place.sigma_rad,
            plane=place.plane,
            box_px=(),
        )

    def _zoom_wanted(self, work: Work) -> float:
        return zoom_wanted(
            work.rig,
            self.task.request,
            _limits(work),
            self.place,
            present=self.zoom,
            error_rad=self._error_rad(work),
        )

    def _error_rad(self, work: Work) -> float:
        """How far off the place may be."""
        return work.config.lock.sigma_limit * math.radians(self.sigma_deg)

    def _sigma_of(self, work: Work, place: Candidate) -> float:
        pixel_rad = pixel_angle_rad(work.rig.fisheye, self.task.request.box.centre)
        return math.degrees(direction_sigma_rad(place, pixel_rad))

    def _tolerance_rad(self, work: Work) -> float:
        hfov = work.rig.zoom.camera_at(self.zoom).hfov_rad
        return min(math.radians(work.config.lock.tolerance_deg), ZOOMED_SHARE * hfov)

    def _tell(self, work: Work, step: str, **detail: object) -> None:
        work.feedback(self.task.request.id, step, **detail)


def range_of(place: Candidate) -> float | None:
    """Range in m (baselines when not metric); None when the target is too far to tell."""
    if place.inverse_range <= 1e-6:
        return None
    return round(1.0 / place.inverse_range, 4)


def _limits(work: Work) -> HeadLimits:
    if work.head.limits is None:
        raise AssertionError("a lock without limits")
    return work.head.limits


def _offset_rad(work: Work, place: Candidate, reading: HeadReading) -> float:
    axis = work.rig.head_from_camera(reading) @ np.array([0.0, 0.0, 1.0])
    return float(angle_between(axis, bearing(place.pan_rad, place.tilt_rad)))
