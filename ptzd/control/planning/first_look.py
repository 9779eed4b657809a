"""The scan plan of a scene whose ranges are partly known: the likeliest place is looked at first.

What is known never narrows what is looked at: the views together show as much as without it, and no view shows less
than one of the plain plan where that is more than one. So a copy of the region elsewhere on the arc is seen just as
before, and an answer rests on the pictures alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ptzd.control.planning.expected import ExpectedOnArc
from ptzd.control.planning.views import PlannedView, ScanPlan
from ptzd.geometry.arc import EpipolarArc

Interval = tuple[float, float]
Plan = Callable[[Interval, float | None, float | None], ScanPlan]
"""Plans an interval of inverse range with a field of view, rad (None: as without a map), aimed towards a range."""

LEAST_KNOWN = 0.3
"""Share of the arc's possibilities below which the map has no say in the plan."""
CLOSER_VIEWS = (0.5, 0.6, 0.7, 0.85)
"""Fields of view tried for a single view, in those of the plain plan, closest first."""
TRIED_SHARES = (1.0, 0.95, 0.85)
"""How much a view aimed elsewhere shows, in what the plain plan's best view shows of the arc."""
WORTH_A_VIEW = 0.15
"""So much more of the expectation in the first view is worth one view more in all."""


def likeliest_first(plan: Plan, interval: Interval, expected: ExpectedOnArc, closest_rad: float) -> ScanPlan:
    """Return the plan of an interval with the view first that most probably shows the target.

    Parameters
    ----------
    plan : callable
        Makes the plain plan of any interval; see `Plan`.
    interval : (float, float)
        Inverse ranges to look at.
    expected : ExpectedOnArc
        What is expected along the arc of that interval.
    closest_rad : float
        Narrowest field of view that may be chosen, rad.
    """
    plain = plan(interval, None, None)
    there = expected.likeliest()
    if there is None or expected.expected.known < LEAST_KNOWN or not plain.views:
        return plain
    plain = replace(plain, expected=there)
    if len(plain.views) == 1:
        closer = plain if plain.unreachable else _single(plan, interval, plain, there, closest_rad)
        return replace(closer, expected=there, plain_hfov_rad=plain.views[0].hfov_rad)
    ordered = replace(plain, views=tuple(sorted(plain.views, key=lambda view: -expected.mass(*view.s_interval))))
    aimed = _aimed(plan, plain, expected, there)
    if aimed is None:
        return ordered
    gain = expected.mass(*aimed[0].s_interval) - expected.mass(*ordered.views[0].s_interval)
    more = len(aimed) - len(ordered.views)
    if more > 1 or gain < (WORTH_A_VIEW if more == 1 else 1e-6):
        return ordered
    rest = sorted(aimed[1:], key=lambda view: -expected.mass(*view.s_interval))
    return replace(plain, views=(aimed[0], *rest))


def _single(plan: Plan, interval: Interval, plain: ScanPlan, there: float, closest_rad: float) -> ScanPlan:
    """One view that shows it all, aimed as near to the place and zoomed in as far as it still does."""
    for hfov_rad in (share * plain.views[0].hfov_rad for share in CLOSER_VIEWS):
        if hfov_rad < closest_rad:
            continue
        closer = plan(interval, hfov_rad, there)
        if len(closer.views) == 1 and not closer.unreachable:
            return closer
    return plan(interval, plain.views[0].hfov_rad, there)


def _aimed(plan: Plan, plain: ScanPlan, expected: ExpectedOnArc, there: float) -> list[PlannedView] | None:
    """A view aimed at the place, then those of the rest; None where limits or zones keep the head from some of it."""
    arc, hfov_rad = expected.arc, plain.views[0].hfov_rad
    start, end = arc.angle_at([arc.s_min, arc.s_max]).tolist()
    widest = max(float(high - low) for low, high in (arc.angle_at(view.s_interval) for view in plain.views))
    for share in TRIED_SHARES:
        half = 0.5 * share * widest
        middle = min(max(float(arc.angle_at(there)), start + half), end - half)
        low, high = max(middle - half, start), min(middle + half, end)
        around = (_inverse_range(arc, low, start, arc.s_min), _inverse_range(arc, high, end, arc.s_max))
        first = plan(around, hfov_rad, None)
        if len(first.views) == 1 and not first.unreachable:
            break
    else:
        return None
    rest = [(arc.s_min, around[0])] if low > start else []
    rest += [(around[1], arc.s_max)] if high < end else []
    others = [plan(piece, hfov_rad, None) for piece in rest]
    if any(other.unreachable for other in others):
        return None
    return [first.views[0], *(view for other in others for view in other.views)]


def _inverse_range(arc: EpipolarArc, angle: float, end: float, at_end: float) -> float:
    return at_end if angle == end else float(arc.inverse_range_at(angle))
