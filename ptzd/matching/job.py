"""One match: run the matcher that was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable

from ptzd.jpeg.pixels import decode_grey
from ptzd.matching.harris import harris
from ptzd.matching.inputs import MatchInputs
from ptzd.matching.sweep import sweep
from ptzd.model import Candidate, Matcher, MatchResult

__all__ = ["MATCHERS", "MatchInputs", "decode_grey", "match"]

Answer = tuple[float, tuple[Candidate, ...], tuple[float, float]]
"""Texture, candidates best first, interval of inverse range in view."""

MATCHERS: dict[Matcher, Callable[[MatchInputs], Answer]] = {Matcher.SWEEP: sweep, Matcher.HARRIS: harris}


def match(inputs: MatchInputs, matcher: Matcher) -> MatchResult:
    """Look for a region of a fisheye picture in a PTZ view.

    The same inputs and seed give the same result, its time apart.

    Raises
    ------
    GeometryError
        When the reading's zoom is outside the calibration.
    MatchError
        When the search is more work than its budget.
    """
    start = time.perf_counter_ns()
    texture, candidates, coverage = MATCHERS[matcher](inputs)
    return MatchResult(
        matcher=matcher,
        texture=texture,
        candidates=candidates,
        coverage=coverage,
        seed=inputs.seed,
        elapsed_ms=(time.perf_counter_ns() - start) / 1e6,
    )
