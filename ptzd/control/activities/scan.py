"""The scan: walk the views of the arc, match each as it comes, decide over all of them."""

from __future__ import annotations

import math

from msgspec import Struct, field

from ptzd.control.activities.activity import Activity, Failure, Next, Over, Step, out_of_time
from ptzd.control.activities.lock import Lock
from ptzd.control.events import ZoomWish
from ptzd.control.head_state import Awaited
from ptzd.control.planning.decision import Decision, Prior, Thresholds, Verdict, decide
from ptzd.control.planning.first_look import likeliest_first
from ptzd.control.planning.neighbourhood import band_rad, neighbourhood
from ptzd.control.planning.prior import expected_on_arc
from ptzd.control.planning.views import ScanPlan, plan_views
from ptzd.control.requests import Request, Task
from ptzd.control.states import State
from ptzd.control.work import Work
from ptzd.model import HeadReading, MatchResult, Outcome, ViewRef

CLOSER = 0.5
"""A further round looks with half the field of view: twice the pixels on the region."""
MAX_RIVALS = 3
"""Places a closer round looks at; with more the region is a repeated pattern and stays ambiguous."""
RIVAL_SHARE = 0.7
"""Places with less than this share of the best score need no closer look."""
NEIGHBOURHOOD_PX = 6.0
"""Half width, in fisheye pixels along the arc, of what a closer look at one place searches."""


class Looked(Struct, kw_only=True):
    """A match that came in."""

    view: int
    """Index into `Scan.taken`."""
    result: MatchResult


class Scan(Activity, kw_only=True, tag="scan"):
    """The region is looked for along its whole arc."""

    task: Task
    round: int = 0
    """0 before the first one is planned."""
    views: list[HeadReading] = field(default_factory=list)
    next_view: int = 0
    taken: list[ViewRef] = field(default_factory=list)
    matches: list[Looked] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    """What went wrong with single views, and what no view can show."""
    plain_hfov_rad: float | None = None
    """Where a map has zoomed the first round in: its field of view without. What is closer than that, is the same."""
    doubt: str = ""
    """Why the round before could not decide; empty in the first one."""
    doubt_probability: float = 0.0
    """What it gave its best place."""

    def state_now(self) -> State:
        """Only the matcher is waited for once every view was taken."""
        return State.MATCH if self.next_view >= len(self.views) else State.SCAN

    def begin(self, work: Work) -> Step:
        """Plan the first round and send the head to its first view; over when nothing of the arc can be reached."""
        wish = work.config.search.scan_hfov_deg
        wish_rad = None if wish is None else math.radians(wish)
        plan = _plan_by_map(work, self.task.request, wish_rad)
        if not plan.views:
            where = "limits and outside the zones; check limits, zones" if work.zones else "limits; check limits"
            reason = f"no part of the region's epipolar arc lies within the head's {where} and range_m"
            return Over(outcome=Outcome.UNREACHABLE, reason=reason)
        self.plain_hfov_rad = plan.plain_hfov_rad
        self._set_out(work, _poses(plan), plan.unreachable_in_words(metric=work.rig.metric), plan.expected)
        return None

    def on_arrived(self, work: Work) -> Step:
        """Take the picture."""
        work.grab(work.head.moved_ns)
        return None

    def on_picture(self, work: Work, view: ViewRef) -> Step:
        """Match it while the head goes on to the next view."""
        request = self.task.request
        self.taken.append(view)
        self.task.views += 1
        pose = view.reading
        work.feedback(
            request.id, "view", pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom, seq=view.frame.seq
        )
        work.match(
            request_id=request.id,
            frame=request.frame,
            box=request.box,
            view=view,
            view_index=len(self.taken) - 1,
            inverse_range=request.inverse_range,
            band_rad=band_rad(work.rig, request),
        )
        return self._walk_on(work)

    def on_match(self, work: Work, view: int, result: MatchResult) -> Step:
        """Decide at once when the answer is certain, otherwise when all views are in.

        A closer round compares places that look alike, so that it is never certain before each of them was looked at.
        """
        self.matches.append(Looked(view=view, result=result))
        best = result.candidates[0].score if result.candidates else 0.0
        work.feedback(self.task.request.id, "match", view=view, score=round(best, 4), candidates=len(result.candidates))
        decision = self._decide(work)
        if decision.outcome is Verdict.NO_TEXTURE:
            return self._refused(decision)
        certain = not self.doubt and decision.probability >= work.config.search.certain_probability
        return (self._found(decision) if certain else None) or self._conclude(work)

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """A view that could not be taken or matched is noted, and the walk goes on."""
        matching = failure.what is Awaited.MATCH
        place = "" if matching else f"view {self.next_view + 1} of {len(self.views)}: "
        self.notes.append(f"{place}{failure.reason}")
        work.feedback(self.task.request.id, "note", text=self.notes[-1])
        return self._conclude(work) if matching else self._walk_on(work)

    def on_time(self, work: Work) -> Step:
        """The client's time is kept."""
        return out_of_time(work, self.task.request.expires_ns)

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        del work
        return self.task.request.expires_ns

    def _set_out(self, work: Work, views: list[HeadReading], missing: str = "", expected: float | None = None) -> None:
        """Begin a round: tell what it shows and what no pose can show, and send the head to its first view."""
        self.round, self.views, self.next_view, self.taken, self.matches = self.round + 1, views, 0, [], []
        detail: dict[str, object] = {"unreachable": missing} if missing else {}
        if missing:
            within = "within the head's limits and outside the zones" if work.zones else "within the head's limits"
            self.notes.append(f"no pose {within} shows {missing}")
        if expected is not None and expected > 0.0:
            detail["range_expected_m"] = round(1.0 / expected, 3)
        work.feedback(self.task.request.id, "plan", views=len(views), round=self.round, **detail)
        work.move(views[0])

    def _walk_on(self, work: Work) -> Step:
        self.next_view += 1
        if self.next_view < len(self.views):
            work.move(self.views[self.next_view])
            return None
        return self._conclude(work)

    def _conclude(self, work: Work) -> Step:
        """Decide over all views once nothing is outstanding."""
        if self.next_view < len(self.views) or work.looking:
            return None
        if not self.matches:
            return self._still_in_doubt() or Over(
                outcome=Outcome.UNREACHABLE, reason=f"no view could be used: {'; '.join(self.notes)}"
            )
        decision = self._decide(work)
        if decision.outcome is Verdict.FOUND and (doubt := self._still_in_doubt()) is not None:
            return doubt
        if (found := self._found(decision)) is not None:
            return found
        if decision.outcome is Verdict.AMBIGUOUS:
            self.task.alike |= not decision.against_the_map
            closer = self._closer(work, decision) if self.round < work.config.search.max_rounds else []
            if closer:
                self.doubt, self.doubt_probability = decision.reason, decision.probability
                self._set_out(work, closer)
                return None
        last_word = self._decide(work, last=True) if decision.against_the_map else decision
        return self._found(last_word) or self._refused(last_word)

    def _decide(self, work: Work, *, last: bool = False) -> Decision:
        """What the pictures say, and the map against them.

        A place where nothing was expected is doubted until it was looked at closely, or nobody can. Of two that look
        alike, the map's must be behind clearly.
        """
        results = [(match.view, match.result) for match in self.matches]
        thresholds = Thresholds(accept_probability=work.config.search.accept_probability)
        expected = expected_on_arc(work, self.task.request)
        if expected is None:
            return decide(results, thresholds)
        return decide(results, thresholds, Prior(density=expected.density, of_place=self.round == 1 and not last))

    def _found(self, decision: Decision) -> Next | None:
        """Go on to the lock, if the region was recognised."""
        if decision.outcome is not Verdict.FOUND or decision.best is None or decision.view is None:
            return None
        zoom = self.taken[decision.view].reading.zoom
        place, probability = decision.best, decision.probability
        return Next(activity=Lock(task=self.task, place=place, probability=probability, wide_zoom=zoom, zoom=zoom))

    def _still_in_doubt(self) -> Over | None:
        """The end of a closer round that did not see all it was to compare: it proves nothing of what it saw."""
        if not self.doubt or len(self.matches) == len(self.views):
            return None
        seen = f"{len(self.matches)} of {len(self.views)} closer views could be used"
        reason = "; ".join([self.doubt, seen, *self.notes])
        return Over(outcome=Outcome.AMBIGUOUS, reason=reason, probability=self.doubt_probability)

    def _refused(self, decision: Decision) -> Over:
        reason = "; ".join([decision.reason, *self.notes])
        return Over(outcome=Outcome(decision.outcome.value), reason=reason, probability=decision.probability)

    def _closer(self, work: Work, decision: Decision) -> list[HeadReading]:
        """Views of a closer round: around each of the rival places, with half the field of view.

        Empty when one of them cannot be shown so: without it the others would win for want of a rival.
        """
        request = self.task.request
        places = [] if decision.best is None else [decision.best, *(rival.candidate for rival in decision.rivals)]
        alike = [place for place in places if place.score >= RIVAL_SHARE * places[0].score]
        self.task.alike |= len(alike) > 1
        if len(alike) > MAX_RIVALS:
            return []
        narrowest = work.rig.zoom.hfov_range_rad[0]
        seen = work.rig.zoom.camera_at(self.taken[0].reading.zoom).hfov_rad
        wide = self.plain_hfov_rad if self.round == 1 and self.plain_hfov_rad is not None else seen
        hfov = max(wide * CLOSER, narrowest)
        views: list[HeadReading] = []
        for place in alike:
            near = neighbourhood(work.rig, request, place.inverse_range, NEIGHBOURHOOD_PX)
            plan = _plan(work, request, near, hfov)
            if not plan.views or any(first <= place.inverse_range <= last for first, last in plan.unreachable):
                pose = f"pan {math.degrees(place.pan_rad):.2f}°, tilt {math.degrees(place.tilt_rad):.2f}°"
                self.notes.append(f"no pose within the head's limits gives a closer look at the place at {pose}")
                return []
            views += _poses(plan)
        return views


def _plan_by_map(work: Work, request: Request, hfov_rad: float | None) -> ScanPlan:
    """The plan of the first round: where the scene's ranges are known, the likeliest place first."""
    expected = expected_on_arc(work, request)
    if expected is None:
        return _plan(work, request, request.inverse_range, hfov_rad)

    def plan(interval: tuple[float, float], other_rad: float | None, towards: float | None) -> ScanPlan:
        return _plan(work, request, interval, hfov_rad if other_rad is None else other_rad, towards)

    return likeliest_first(plan, request.inverse_range, expected, _closest_rad(work, request, hfov_rad))


def _closest_rad(work: Work, request: Request, hfov_rad: float | None) -> float:
    """Narrowest field of view that a look may have: never narrower than what was asked for."""
    if request.zoom is ZoomWish.KEEP or hfov_rad is not None or work.head.limits is None:
        return math.inf
    narrowest = min(work.rig.zoom.zoom_range[1], work.head.limits.zoom[1])
    asked = math.radians(request.hfov_deg or 0.0)
    return max(work.rig.zoom.camera_at(narrowest).hfov_rad, asked)


def _plan(
    work: Work,
    request: Request,
    inverse_range: tuple[float, float],
    hfov_rad: float | None,
    towards: float | None = None,
) -> ScanPlan:
    limits, present = work.head.limits, work.head.reading
    if limits is None or present is None:
        raise AssertionError("a scan without limits or a position")
    reach = work.reach if work.zones else None

    def plan(other_rad: float | None) -> ScanPlan:
        region, rig = request.region, work.rig
        return plan_views(
            rig, region.box, inverse_range, limits, present, hfov_rad=other_rad, towards=towards, reach=reach
        )

    found = plan(hfov_rad)
    if reach is None or not reach.privacy or not found.unreachable:
        return found
    # beside a privacy zone only the widest pictures are taken
    wide = plan(work.rig.zoom.camera_at(reach.widest).hfov_rad)
    return wide if wide.unreachable_share < found.unreachable_share else found


def _poses(plan: ScanPlan) -> list[HeadReading]:
    return [view.reading for view in plan.views]
