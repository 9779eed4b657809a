"""The lock: centre, correct from the picture, zoom, verify, hold and follow, re-acquire once."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control import search
from ptzd.control.decision import Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.control.events import ZoomWish
from ptzd.control.memory import Active, LockMemory, Phase
from ptzd.control.search import Ended, Found
from ptzd.control.work import Work, seconds
from ptzd.geometry.sphere import angle_between, bearing, pan_tilt
from ptzd.geometry.types import Array, pixel_angle_rad
from ptzd.model import Candidate, HeadLimits, HeadReading, MatchResult, Outcome, ViewRef

NARROW_PX = 4.0
"""Half width of the search around a known place, in fisheye pixels along the arc."""
WIDE_PX = 16.0
"""The same when the place was lost, or the target has moved."""
OFF_CENTRE_SHARE = 0.7
"""A target that the limits keep off the centre is held if it is within 70 % of the way to the picture's edge."""
SAFE_SHARE = 0.1
"""The zoom follows the first move at once when three sigma of the place are under a tenth of the final picture."""
STANDING_PX = 1.0
"""A box that moved by less is where it was: the match knows the place better than the arc does."""
MAX_MISSES = 3
"""Looks in a row that may fail while newer boxes come; after them the target is lost."""
CONFIRMED_LOOKS = 3
"""The target counts as held for so many ``verify_every_s`` after a confirmation."""
ZOOMED_SHARE = 0.02
"""At the final zoom an offset under 2 % of the field of view is centred: nobody sees it."""


def begin(work: Work, active: Active, found: Found) -> Ended | None:
    """Centre what the scan found."""
    scan = active.scan
    if scan is None or found.decision.view is None:
        raise AssertionError("a lock without the view it was found in")
    wide_zoom = scan.taken[found.decision.view].reading.zoom
    active.lock = LockMemory(
        phase=Phase.CENTRING,
        place=found.place,
        probability=found.decision.probability,
        sigma_deg=_sigma_deg(work, active, found.place),
        wide_zoom=wide_zoom,
        zoom=wide_zoom,
    )
    active.scan = None
    if _adopt_newest(work, active):
        active.lock.phase = Phase.REACQUIRING
    _zoom_at_once(work, active)
    work.feedback("found", probability=round(found.decision.probability, 4), score=round(found.place.score, 4))
    return _aim(work, active)


def on_view(work: Work, active: Active, view: ViewRef) -> None:
    """Match again, now knowing nearly where."""
    lock, request = _lock(active), active.request
    active.views += 1
    lock.view = view
    near = lock.phase is Phase.HOLDING or not lock.moved
    half = NARROW_PX if near and lock.phase is not Phase.REACQUIRING else WIDE_PX
    work.match(
        request_id=request.id,
        frame=request.frame,
        box=request.box,
        view=view,
        view_index=0,
        inverse_range=search.neighbourhood(work, active, lock.place.inverse_range, half),
        band_rad=search.band_rad(work, active),
    )


def on_match(work: Work, active: Active, result: MatchResult) -> Ended | None:
    """Verified or not; go to the next step, on the newest box that came meanwhile."""
    lock = _lock(active)
    view = lock.view
    if view is None:
        raise AssertionError("a match in a lock without its view")
    decision = decide([(0, result)], Thresholds(accept_probability=work.config.lock.verify_probability))
    if decision.best is None or decision.outcome is not Verdict.FOUND:
        return on_unverified(work, active, decision.reason)
    lock.place, lock.probability = decision.best, decision.probability
    lock.confirmed_ns, lock.misses, lock.moved, lock.overdue = work.t_ns, 0, False, False
    lock.sigma_deg = math.hypot(_sigma_deg(work, active, decision.best), view.sigma_deg)
    lock.box_ptz = decision.best.box_px
    offset = _offset_rad(work, decision.best, view.reading)
    work.feedback(
        "correction" if lock.phase is not Phase.HOLDING else "verify",
        offset_deg=round(math.degrees(offset), 4),
        probability=round(decision.probability, 4),
        score=round(decision.best.score, 4),
        zoom=view.reading.zoom,
        seq=view.frame.seq,
    )
    if lock.phase is Phase.REACQUIRING:
        lock.phase = Phase.CENTRING
    centred = lock.off_centre or offset <= _tolerance_rad(work, lock)
    if not centred and lock.corrections < work.config.lock.max_corrections:
        lock.corrections += 1
        _adopt_newest(work, active)
        return _aim(work, active)
    return _next_step(work, active)


def on_unverified(work: Work, active: Active, reason: str) -> Ended | None:
    """The picture did not confirm: look again from where it was found, then give up (the machine may scan again)."""
    lock = _lock(active)
    lock.misses += 1
    newer = _adopt_newest(work, active) and lock.misses < MAX_MISSES
    if lock.phase in {Phase.CENTRING, Phase.REACQUIRING} and not newer:
        outcome = Outcome.LOST if lock.confirmed else Outcome.NOT_FOUND
        return Ended(outcome=outcome, reason=f"{lock.phase}: {reason}", probability=lock.probability)
    if lock.phase is Phase.ZOOMING and lock.confirmed:
        lock.may_zoom = False
        lock.note = f"held at the zoom of the scan, since at the asked zoom: {reason}"
    work.feedback("note", text=f"{lock.phase}: {reason}; looking again from zoom {lock.wide_zoom:g}")
    lock.phase, lock.zoom, lock.corrections, lock.verify_ns = Phase.REACQUIRING, lock.wide_zoom, 0, None
    return _aim(work, active)


def on_deadline(work: Work, active: Active) -> Ended | None:
    """Hold time over, or time to verify."""
    lock = _lock(active)
    end = hold_ends_ns(work, active)
    if end is not None and work.t_ns >= end:
        if _confirmed_lately(work, lock):
            return Ended(outcome=Outcome.LOCKED, reason=lock.note or "held as asked", probability=lock.probability)
        lock.overdue = True
        if not work.looking:
            lock.verify_ns = work.t_ns
    if lock.verify_ns is not None and work.t_ns >= lock.verify_ns:
        lock.verify_ns = None
        lock.corrections = 0
        work.grab(work.t_ns)
    return None


def on_update(work: Work, active: Active) -> Ended | None:
    """The target has a new box on a newer frame: follow it at its last known range, once the look under way is in."""
    return None if work.looking else _follow(work, active)


def hold_ends_ns(work: Work, active: Active) -> int | None:
    """When the hold is over; None before the lock, while an operator holds, and once only a look can end it."""
    lock = active.lock
    if lock is None or lock.locked_ns is None or lock.overdue or work.memory.held:
        return None
    return lock.locked_ns + active.request.hold_ns


def was_locked(active: Active) -> bool:
    """Whether the client has had its lock: from then on its time-out is kept."""
    return active.lock is not None and active.lock.locked_ns is not None


def may_rescan(active: Active, ended: Ended) -> bool:
    """Whether a lost target is worth another scan: not when the hold is over, and only its confirmation was missing."""
    return ended.outcome in {Outcome.LOST, Outcome.NOT_FOUND} and not _lock(active).overdue


def _lock(active: Active) -> LockMemory:
    if active.lock is None:
        raise AssertionError("a lock step without a lock")
    return active.lock


def _zoom_at_once(work: Work, active: Active) -> None:
    """Centre and zoom in one move where the place is known well enough; it is verified there all the same."""
    lock = _lock(active)
    if lock.phase is not Phase.CENTRING or lock.probability < work.config.search.certain_probability:
        return
    target = _zoom_wanted(work, active)
    hfov = work.rig.zoom.camera_at(target).hfov_rad
    if work.config.lock.sigma_limit * math.radians(lock.sigma_deg) <= SAFE_SHARE * hfov and target != lock.zoom:
        lock.phase, lock.zoom = Phase.ZOOMING, target


def _next_step(work: Work, active: Active) -> Ended | None:
    lock = _lock(active)
    lock.confirmed = True
    if lock.phase is Phase.CENTRING and lock.may_zoom:
        target = _zoom_wanted(work, active)
        if abs(target - lock.zoom) > work.config.ptz.zoom_tolerance:
            _adopt_newest(work, active)
            lock.phase, lock.zoom, lock.corrections = Phase.ZOOMING, _zoom_wanted(work, active), 0
            return _aim(work, active)
    lock.phase = Phase.HOLDING
    lock.verify_ns = work.t_ns + seconds(work.config.lock.verify_every_s)
    if lock.locked_ns is None:
        lock.locked_ns = work.t_ns
        elapsed_ms = (work.t_ns - active.request.accepted_ns) // 1_000_000
        work.feedback("locked", elapsed_ms=elapsed_ms, range_m=range_of(lock.place))
    return on_deadline(work, active) or _follow(work, active)


def _confirmed_lately(work: Work, lock: LockMemory) -> bool:
    """Whether the target was seen in its place so lately that it counts as held."""
    oldest = work.t_ns - CONFIRMED_LOOKS * seconds(work.config.lock.verify_every_s)
    return lock.misses == 0 and lock.confirmed_ns >= oldest


def _follow(work: Work, active: Active) -> Ended | None:
    """Look for the newest box, if one waits."""
    if active.request.newer_box is None:
        return None
    lock = _lock(active)
    _adopt_newest(work, active)
    lock.corrections, lock.verify_ns = 0, None
    return _aim(work, active)


def _aim(work: Work, active: Active) -> Ended | None:
    """Point at the place; one just outside the limits is looked at from the limit if it is well inside the picture."""
    lock, limits = _lock(active), work.memory.limits
    if limits is None:
        raise AssertionError("a lock without limits")
    direction = bearing(lock.place.pan_rad, lock.place.tilt_rad)
    target = work.rig.aim(direction, lock.zoom)
    lock.off_centre = not limits.contains(target)
    if lock.off_centre:
        lock.zoom, lock.may_zoom = lock.wide_zoom, False
        lock.phase = Phase.CENTRING if lock.phase is Phase.ZOOMING else lock.phase
        nearest = _nearest(work.rig.aim(direction, lock.zoom), limits)
        if not _well_inside(work, direction, nearest):
            reason = (
                f"the target at pan {target.pan_deg:.2f}°, tilt {target.tilt_deg:.2f}° is outside the head's limits"
            )
            return Ended(outcome=Outcome.UNREACHABLE, reason=reason, probability=lock.probability)
        lock.note = (
            f"held off the picture's centre: tilt {target.tilt_deg:.2f}°, pan {target.pan_deg:.2f}° is past a limit"
        )
        target = nearest
    work.move(target)
    return None


def _nearest(target: HeadReading, limits: HeadLimits) -> HeadReading:
    pan = target.pan_deg if limits.endless_pan else min(max(target.pan_deg, limits.pan_deg[0]), limits.pan_deg[1])
    tilt = min(max(target.tilt_deg, limits.tilt_deg[0]), limits.tilt_deg[1])
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=target.zoom)


def _well_inside(work: Work, direction: Array, reading: HeadReading) -> bool:
    pixel, valid = work.rig.project_to_view(direction, reading)
    half = np.array(work.rig.zoom.size_px) / 2
    return bool(valid) and bool((np.abs(pixel - half) < OFF_CENTRE_SHARE * half).all())


def range_of(place: Candidate) -> float | None:
    """Range in m (baselines when not metric); None when the target is too far to tell."""
    if place.inverse_range <= 1e-6:
        return None
    return round(1.0 / place.inverse_range, 4)


def _offset_rad(work: Work, place: Candidate, reading: HeadReading) -> float:
    axis = work.rig.head_from_camera(reading) @ np.array([0.0, 0.0, 1.0])
    return float(angle_between(axis, bearing(place.pan_rad, place.tilt_rad)))


def _tolerance_rad(work: Work, lock: LockMemory) -> float:
    hfov = work.rig.zoom.camera_at(lock.zoom).hfov_rad
    return min(math.radians(work.config.lock.tolerance_deg), ZOOMED_SHARE * hfov)


def _zoom_wanted(work: Work, active: Active) -> float:
    """Zoom that fills the asked share of the frame, never past the pointing error's sigma limit."""
    request, lock, limits = active.request, _lock(active), work.memory.limits
    if limits is None or request.zoom is ZoomWish.KEEP:
        return lock.zoom
    narrow, wide = work.rig.zoom.hfov_range_rad
    if request.zoom is ZoomWish.HFOV and request.hfov_deg is not None:
        hfov = math.radians(request.hfov_deg)
    else:
        hfov = _filling_hfov(work, active)
    width, height = work.rig.zoom.size_px
    least = 2 * work.config.lock.sigma_limit * math.radians(lock.sigma_deg) * width / height
    zoom = work.rig.zoom.zoom_for_hfov(min(max(hfov, least, narrow), wide))
    return float(round(min(max(zoom, limits.zoom[0]), limits.zoom[1])))


def _filling_hfov(work: Work, active: Active) -> float:
    """Field of view in which the region's corners span the asked share of the narrower side, by their directions."""
    request, lock, rig = active.request, _lock(active), work.rig
    rays, valid = rig.fisheye.lift(np.array(request.box.corners))
    rotated = rays[valid] @ rig.head_from_fisheye_rotation.T
    directions: Array = rotated + lock.place.inverse_range * rig.head_from_fisheye_translation
    target = rig.aim(bearing(lock.place.pan_rad, lock.place.tilt_rad), lock.zoom)
    in_camera = directions @ rig.head_from_camera(target)
    slopes = np.abs(in_camera[:, :2] / in_camera[:, 2:])
    width, height = rig.zoom.size_px
    half = max(float(slopes[:, 0].max()), float(slopes[:, 1].max()) * width / height)
    return 2 * math.atan(half / request.fill)


def _adopt_newest(work: Work, active: Active) -> bool:
    """Take over the box that waits and predict its place; whether there was one, and it is elsewhere."""
    request, lock = active.request, _lock(active)
    old = request.box
    if not request.adopt_newest():
        return False
    moved = max(math.dist(here, there) for here, there in zip(old.corners, request.box.corners, strict=True))
    if moved >= STANDING_PX:
        lock.place, lock.moved = _predicted(work, active, lock.place), True
    return moved >= STANDING_PX


def _sigma_deg(work: Work, active: Active, place: Candidate) -> float:
    pixel_rad = pixel_angle_rad(work.rig.fisheye, active.request.box.centre)
    return math.degrees(direction_sigma_rad(place, pixel_rad))


def _predicted(work: Work, active: Active, place: Candidate) -> Candidate:
    """Where the new box's centre is seen from the head if the range has not changed."""
    pan, tilt = pan_tilt(search.arc_of(work, active).bearing(place.inverse_range))
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
