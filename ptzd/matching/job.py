"""One match: decode the pictures, run the matcher that was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable

import cv2
import numpy as np

from ptzd.errors import DeviceGarbled
from ptzd.matching.arrays import Grey
from ptzd.matching.harris import harris
from ptzd.matching.inputs import MatchInputs
from ptzd.matching.sweep import sweep
from ptzd.model import Candidate, Matcher, MatchResult

__all__ = ["MATCHERS", "MatchInputs", "decode_grey", "match"]

Answer = tuple[float, tuple[Candidate, ...], tuple[float, float]]
"""Texture, candidates best first, interval of inverse range in view."""

MATCHERS: dict[Matcher, Callable[[MatchInputs], Answer]] = {Matcher.SWEEP: sweep, Matcher.HARRIS: harris}


def decode_grey(jpeg: bytes) -> Grey:
    """Decode a JPEG to grey values, (h, w).

    Raises
    ------
    DeviceGarbled
        When the bytes are not a whole JPEG. The markers are checked here because decoders fill up what is missing of a
        truncated picture with grey and say nothing.
    """
    if not jpeg.startswith(b"\xff\xd8"):
        raise DeviceGarbled(f"picture: {len(jpeg)} bytes do not start with a JPEG's marker ff d8")
    if not jpeg.rstrip(b"\x00").endswith(b"\xff\xd9"):
        raise DeviceGarbled(f"picture: the JPEG of {len(jpeg)} bytes is cut off, its end marker ff d9 is missing")
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    if picture is None:
        raise DeviceGarbled(f"picture: the JPEG of {len(jpeg)} bytes cannot be decoded")
    return np.asarray(picture, dtype=np.uint8)


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
