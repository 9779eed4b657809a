"""The project's own matchers as the daemon uses them: all views of a case, then one decision."""

from __future__ import annotations

import time

import numpy as np

from ptzd.control.planning.decision import Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.geometry.sphere import bearing
from ptzd.geometry.types import pixel_angle_rad
from ptzd.matching.job import MatchInputs, match
from ptzd.model import Matcher
from tests.bench.cases import Case


def inputs(case: Case, view: int) -> MatchInputs:
    reading, picture = case.views[view]
    return MatchInputs(
        fisheye_grey=case.fisheye,
        view_grey=picture,
        rig=case.rig,
        box=case.box,
        reading=reading,
        inverse_range=case.inverse_range,
        band_rad=np.radians(case.band_deg),
        seed=case.seed,
    )


def run(matcher: Matcher, case: Case) -> dict[str, object]:
    """Match all views of a case and decide."""
    start = time.process_time_ns()
    results = [(view, match(inputs(case, view), matcher)) for view in range(len(case.views))]
    spent = (time.process_time_ns() - start) / 1e6 / len(case.views)
    decision = decide(results, Thresholds())
    best = decision.best
    answer: dict[str, object] = {
        "found": decision.outcome is Verdict.FOUND,
        "outcome": str(decision.outcome),
        "probability": decision.probability,
        "ms": spent,
        "direction": None if best is None else bearing(best.pan_rad, best.tilt_rad),
    }
    if best is not None:
        answer |= {
            "score": best.score,
            "rival": decision.rivals[0].candidate.score if decision.rivals else 0.0,
            "sigma_deg": float(np.degrees(best.sigma_rad)),
            "told_sigma_deg": float(np.degrees(direction_sigma_rad(best, _pixel_rad(case)))),
            "sharpness": best.sharpness,
            "in_view": best.in_view,
            "texture": max(result.texture for _, result in results),
        }
    return answer


def _pixel_rad(case: Case) -> float:
    return pixel_angle_rad(case.rig.fisheye, case.box.centre)
