"""The scan: walk the views of the arc, match each as it comes, decide over all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ptzd.control.decision import Decision, Thresholds, Verdict, decide
from ptzd.control.memory import Active, ScanMemory, ViewMatch
from ptzd.control.scan import ScanPlan, plan_views
from ptzd.control.work import Work
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.types import pixel_angle_rad
from ptzd.model import Candidate, HeadReading, MatchResult, Outcome, ViewRef

CLOSER = 0.5
"""A further round looks with half the field of view: twice the pixels on the region."""
MAX_RIVALS = 3
"""Places a closer round looks at; with more the region is a repeated pattern and stays ambiguous."""
RIVAL_SHARE = 0.7
"""Places with less than this share of the best score need no closer look."""
NEIGHBOURHOOD_PX = 6.0
"""Half width, in fisheye pixels along the arc, of what a closer look at one place searches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Found:
    """The region was recognised."""

    decision: Decision
    place: Candidate


@dataclass(frozen=True, slots=True, kw_only=True)
class Ended:
    """The request is over."""

    outcome: Outcome
    reason: str
    probability: float | None = None


Progress = Found | Ended | None
"""None: still going on."""


def begin(work: Work, active: Active) -> Ended | None:
    """Plan the first round and send the head to its first view; Ended when nothing of the arc can be reached."""
    request = active.request
    wish = work.config.search.scan_hfov_deg
    plan = _plan(work, active, request.inverse_range, None if wish is None else math.radians(wish))
    if not plan.views:
        reason = "no part of the region's epipolar arc lies within the head's limits; check limits and range_m"
        return Ended(outcome=Outcome.UNREACHABLE, reason=reason)
    _set_out(work, active, ScanMemory(round=1, views=_poses(plan)), _missing(work, plan))
    return None


def on_view(work: Work, active: Active, view: ViewRef) -> Progress:
    """Match the picture while the head goes on to the next view."""
    scan, request = _scan(active), active.request
    scan.taken.append(view)
    active.views += 1
    pose = view.reading
    work.feedback("view", pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom, seq=view.frame.seq)
    work.match(
        request_id=request.id,
        frame=request.frame,
        box=request.box,
        view=view,
        view_index=len(scan.taken) - 1,
        inverse_range=request.inverse_range,
        band_rad=band_rad(work, active),
    )
    return _walk_on(work, active)


def on_skip(work: Work, active: Active, reason: str) -> Progress:
    """A view could not be taken: note it and go on."""
    scan = _scan(active)
    scan.notes.append(f"view {scan.next_view + 1} of {len(scan.views)}: {reason}")
    work.feedback("note", text=scan.notes[-1])
    return _walk_on(work, active)


def on_match(work: Work, active: Active, view: int, result: MatchResult) -> Progress:
    """Decide at once when the answer is certain, otherwise when all views are in."""
    scan = _scan(active)
    scan.matches.append(ViewMatch(view=view, result=result))
    best = result.candidates[0].score if result.candidates else 0.0
    work.feedback("match", view=view, score=round(best, 4), candidates=len(result.candidates))
    decision = _decide(work, scan)
    if decision.outcome is Verdict.NO_TEXTURE:
        return _refused(decision, scan)
    certain = decision.probability >= work.config.search.certain_probability
    if decision.best is not None and certain and decision.outcome is Verdict.FOUND:
        return Found(decision=decision, place=decision.best)
    return conclude(work, active)


def on_match_failed(work: Work, active: Active, reason: str) -> Progress:
    """A match that could not run counts as a view not taken."""
    _scan(active).notes.append(reason)
    work.feedback("note", text=reason)
    return conclude(work, active)


def all_views_taken(work: Work, active: Active) -> bool:
    """Whether the head has nothing left to do in this round."""
    scan = active.scan
    return scan is not None and scan.next_view >= len(scan.views) and work.memory.head is None


def conclude(work: Work, active: Active) -> Progress:
    """Decide over all views once nothing is outstanding."""
    if not all_views_taken(work, active) or work.memory.matches:
        return None
    scan = _scan(active)
    if not scan.matches:
        return Ended(outcome=Outcome.UNREACHABLE, reason=f"no view could be used: {'; '.join(scan.notes)}")
    decision = _decide(work, scan)
    if decision.best is not None and decision.outcome is Verdict.FOUND:
        return Found(decision=decision, place=decision.best)
    if decision.outcome is Verdict.AMBIGUOUS and scan.round < work.config.search.max_rounds:
        closer = _closer(work, active, decision)
        if closer:
            _set_out(work, active, ScanMemory(round=scan.round + 1, views=closer, notes=scan.notes))
            return None
    return _refused(decision, scan)


def _scan(active: Active) -> ScanMemory:
    if active.scan is None:
        raise AssertionError("a scan step without a scan")
    return active.scan


def _walk_on(work: Work, active: Active) -> Progress:
    scan = _scan(active)
    scan.next_view += 1
    if scan.next_view < len(scan.views):
        work.move(scan.views[scan.next_view])
        return None
    return conclude(work, active)


def _decide(work: Work, scan: ScanMemory) -> Decision:
    results = [(match.view, match.result) for match in scan.matches]
    return decide(results, Thresholds(accept_probability=work.config.search.accept_probability))


def _refused(decision: Decision, scan: ScanMemory) -> Ended:
    reason = "; ".join([decision.reason, *scan.notes])
    return Ended(outcome=Outcome(decision.outcome.value), reason=reason, probability=decision.probability)


def _set_out(work: Work, active: Active, scan: ScanMemory, missing: str = "") -> None:
    """Begin a round: tell what it shows and what no pose can show, and send the head to its first view."""
    active.scan = scan
    detail: dict[str, object] = {"unreachable": missing} if missing else {}
    if missing:
        scan.notes.append(f"no pose within the head's limits shows {missing}")
    work.feedback("plan", views=len(scan.views), round=scan.round, **detail)
    work.move(scan.views[0])


def _missing(work: Work, plan: ScanPlan) -> str:
    return plan.unreachable_in_words(metric=work.rig.metric)


def _poses(plan: ScanPlan) -> list[HeadReading]:
    return [view.reading for view in plan.views]


def _plan(work: Work, active: Active, inverse_range: tuple[float, float], hfov_rad: float | None) -> ScanPlan:
    limits, present = work.memory.limits, work.memory.reading
    if limits is None or present is None:
        raise AssertionError("a scan without limits or a position")
    return plan_views(work.rig, active.request.box, inverse_range, limits, present, hfov_rad=hfov_rad)


def _closer(work: Work, active: Active, decision: Decision) -> list[HeadReading]:
    """Views of a closer round: around each of the rival places, with half the field of view."""
    scan = _scan(active)
    places = [] if decision.best is None else [decision.best, *(rival.candidate for rival in decision.rivals)]
    alike = [place for place in places if place.score >= RIVAL_SHARE * places[0].score]
    if len(alike) > MAX_RIVALS:
        return []
    narrowest = work.rig.zoom.hfov_range_rad[0]
    hfov = max(work.rig.zoom.camera_at(scan.taken[0].reading.zoom).hfov_rad * CLOSER, narrowest)
    views: list[HeadReading] = []
    for place in alike:
        near = neighbourhood(work, active, place.inverse_range, NEIGHBOURHOOD_PX)
        views += _poses(_plan(work, active, near, hfov))
    return views


def arc_of(work: Work, active: Active) -> EpipolarArc:
    """The arc of the request's box centre over the range it asks for."""
    ray = work.rig.fisheye.lift(np.array(active.request.box.centre))[0]
    return EpipolarArc.of(work.rig, ray, *active.request.inverse_range)


def neighbourhood(work: Work, active: Active, inverse_range: float, half_width_px: float) -> tuple[float, float]:
    """Interval of inverse range around one place, ``half_width_px`` fisheye pixels to either side along the arc."""
    arc = arc_of(work, active)
    if arc.degenerate:
        return active.request.inverse_range
    half = half_width_px * pixel_angle_rad(work.rig.fisheye, active.request.box.centre)
    there, last = float(arc.angle_at(inverse_range)), float(arc.angle_at(2.0 * active.request.inverse_range[1]))
    low, high = max(there - half, 0.0), min(there + half, last)
    return (float(arc.inverse_range_at(low)), float(arc.inverse_range_at(max(high, low))))


def band_rad(work: Work, active: Active) -> float:
    """How far off the arc the target may lie, for the nearest range asked for."""
    arc = arc_of(work, active)
    return work.rig.band_rad(float(arc.head_inverse_range(np.array(active.request.inverse_range)).max()))
