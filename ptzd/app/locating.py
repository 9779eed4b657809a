"""`ptzd locate` and `ptzd plan`: the geometry and the matching step on files, without a camera."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from ptzd.calibration.file import load_rig
from ptzd.config import Config, Limits, Search
from ptzd.control.admission import check_box
from ptzd.control.planning.decision import Decision, Thresholds, Verdict, decide, direction_sigma_rad
from ptzd.control.planning.reach import reach_of
from ptzd.control.planning.views import ScanPlan, plan_views
from ptzd.control.planning.zones import zones_of
from ptzd.control.wording import range_in_words, scaled
from ptzd.documents import DocumentError, parse_json, read_regular, read_text
from ptzd.errors import DeviceGarbled, PtzdError, RequestRefused
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.geometry.types import pixel_angle_rad
from ptzd.geometry.zones import Zone
from ptzd.jpeg.pixels import decode_file
from ptzd.matching.job import MatchInputs, match
from ptzd.model import Box, HeadLimits, HeadReading, Matcher, MatchResult


class DataError(PtzdError):
    """A file given on the command line cannot be used."""

    exit_code = 65


class View(Struct, frozen=True, forbid_unknown_fields=True):
    """One entry of VIEWS.json: a picture and the angles the camera reported for it."""

    image: str
    pan_deg: float
    tilt_deg: float
    zoom: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Located:
    """What `locate` found, with the pictures for drawing."""

    rig: Rig
    box: Box
    decision: Decision
    results: tuple[MatchResult, ...]
    views: tuple[View, ...]
    fisheye_grey: NDArray[np.uint8]
    view_greys: tuple[NDArray[np.uint8], ...]
    inverse_range: tuple[float, float]
    elapsed_ms: float


def inverse_interval(range_m: tuple[float, float]) -> tuple[float, float]:
    """Interval of inverse range, far end first, of an interval of range; the far end may be infinite."""
    near, far = range_m
    if not 0 < near < far:
        raise DataError(f"--range {near:g},{far:g}: the first value must be above 0 and below the second")
    return (0.0 if math.isinf(far) else 1 / far, 1 / near)


def locate(
    *, calibration: Path, fisheye: Path, box: Box, views: Path, matcher: Matcher, range_m: tuple[float, float]
) -> Located:
    """Find a region of a fisheye picture in PTZ pictures.

    Raises
    ------
    PtzdError
        When a file cannot be read, sizes do not fit the calibration, or the box is outside.
    """
    rig = load_rig(calibration)
    _checked(box, rig)
    fisheye_grey = _read_grey(fisheye, rig.fisheye.size_px, "fisheye")
    entries = _read_views(views)
    greys = tuple(_read_grey(views.parent / view.image, rig.zoom.size_px, "ptz") for view in entries)
    interval = inverse_interval(range_m)
    ray = rig.fisheye.lift(np.array(box.centre))[0]
    arc = EpipolarArc.of(rig, ray, *interval)
    band_rad = rig.band_rad(float(arc.head_inverse_range(np.array(interval)).max()))
    start = time.perf_counter_ns()
    results = tuple(
        match(
            MatchInputs(
                fisheye_grey=fisheye_grey,
                view_grey=grey,
                rig=rig,
                box=box,
                reading=HeadReading(pan_deg=view.pan_deg, tilt_deg=view.tilt_deg, zoom=view.zoom),
                inverse_range=interval,
                band_rad=band_rad,
                seed=Search().seed,
            ),
            matcher,
        )
        for view, grey in zip(entries, greys, strict=True)
    )
    decision = decide(list(enumerate(results)), Thresholds(accept_probability=Search().accept_probability))
    return Located(
        rig=rig,
        box=box,
        decision=decision,
        results=results,
        views=entries,
        fisheye_grey=fisheye_grey,
        view_greys=greys,
        inverse_range=interval,
        elapsed_ms=(time.perf_counter_ns() - start) / 1e6,
    )


def document(located: Located) -> dict[str, object]:
    """The JSON object of `ptzd locate --json`."""
    decision = located.decision
    candidates = [
        {
            "view": view,
            "pan_deg": round(math.degrees(candidate.pan_rad), 4),
            "tilt_deg": round(math.degrees(candidate.tilt_rad), 4),
            "score": round(candidate.score, 4),
            **_range(located, candidate.inverse_range),
        }
        for view, result in enumerate(located.results)
        for candidate in result.candidates
    ]
    found: dict[str, object] = {"outcome": decision.outcome.value, "reason": decision.reason}
    best = decision.best
    if best is not None and decision.view is not None:
        pixel_rad = pixel_angle_rad(located.rig.fisheye, located.box.centre)
        aim = located.rig.aim(bearing(best.pan_rad, best.tilt_rad), located.views[decision.view].zoom)
        found |= {
            "pan_deg": math.degrees(best.pan_rad),
            "tilt_deg": math.degrees(best.tilt_rad),
            "vapix": {"pan": round(aim.pan_deg, 4), "tilt": round(aim.tilt_deg, 4)},
            **_range(located, best.inverse_range),
            "box_px": [list(corner) for corner in best.box_px],
            "view": decision.view,
            "score": best.score,
            "sigma_deg": math.degrees(direction_sigma_rad(best, pixel_rad)),
        }
    return found | {
        "probability": decision.probability,
        "elapsed_ms": round(located.elapsed_ms, 2),
        "candidates": candidates,
    }


def found(located: Located) -> bool:
    """Whether the region was recognised."""
    return located.decision.outcome is Verdict.FOUND


def plan(
    *, calibration: Path, box: Box, zoom: float, range_m: tuple[float, float], config: Config | None = None
) -> tuple[ScanPlan, Rig]:
    """Views that show the whole arc of a box at one zoom, for a head that looks straight ahead, and the rig.

    Without settings the head turns without end; with them it stays within their limits and outside their zones.
    """
    rig = load_rig(calibration)
    zones = () if config is None else zones_of(config, rig)
    _checked(box, rig, zones)
    limits = None if config is None else config.limits
    if limits is not None and not limits.zoom[0] <= zoom <= limits.zoom[1]:
        raise DataError(f"--zoom {zoom:g}: limits.zoom allows {limits.zoom[0]:g} to {limits.zoom[1]:g}")
    within = limits or Limits()
    head = HeadLimits(pan_deg=within.pan_deg, tilt_deg=within.tilt_deg, zoom=(zoom, zoom), endless_pan=limits is None)
    reach = reach_of(head, rig, zones) if zones else None
    present = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=zoom)
    hfov_rad = rig.zoom.camera_at(zoom).hfov_rad
    return plan_views(rig, box, inverse_interval(range_m), head, present, hfov_rad=hfov_rad, reach=reach), rig


def draw(located: Located) -> NDArray[np.uint8]:
    """Fisheye with box and arc beside the view with the found box, BGR."""
    rig, box = located.rig, located.box
    left = cv2.cvtColor(located.fisheye_grey, cv2.COLOR_GRAY2BGR)
    corners = [tuple(round(value) for value in corner) for corner in box.corners]
    cv2.rectangle(left, corners[0], corners[2], (80, 220, 80), 2)
    index = located.decision.view or 0
    view = located.views[index]
    right = cv2.cvtColor(located.view_greys[index], cv2.COLOR_GRAY2BGR)
    reading = HeadReading(pan_deg=view.pan_deg, tilt_deg=view.tilt_deg, zoom=view.zoom)
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], *located.inverse_range)
    pixels, valid = rig.project_to_view(arc.bearing(arc.steps(math.radians(0.5))), reading)
    cv2.polylines(right, [np.round(pixels[valid]).astype(np.int32).reshape(-1, 1, 2)], False, (60, 180, 250), 1)
    if located.decision.best is not None:
        outline = np.round(np.array(located.decision.best.box_px)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(right, [outline], True, (80, 220, 80), 2)
    height = max(left.shape[0], right.shape[0])
    padded = [cv2.copyMakeBorder(one, 0, height - one.shape[0], 0, 0, cv2.BORDER_CONSTANT) for one in (left, right)]
    return np.hstack(padded).astype(np.uint8)


def _checked(box: Box, rig: Rig, zones: tuple[Zone, ...] = ()) -> None:
    try:
        check_box(box, rig, zones)
    except RequestRefused as refused:
        raise DataError(f"--box: {refused.message}") from None


def _range(located: Located, inverse_range: float) -> dict[str, object]:
    return scaled({"range_m": _range_m(inverse_range)}, metric=located.rig.metric)


def range_of(located: Located) -> str:
    """Range of what was found, with its unit."""
    best = located.decision.best
    range_ = None if best is None else _range_m(best.inverse_range)
    return "unknown or infinite" if range_ is None else range_in_words(range_, metric=located.rig.metric)


def _range_m(inverse_range: float) -> float | None:
    return round(1 / inverse_range, 4) if inverse_range > 1e-6 else None


def _read_grey(path: Path, size_px: tuple[int, int], what: str) -> NDArray[np.uint8]:
    try:
        pixels = decode_file(read_regular(path))
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from None
    except DeviceGarbled as error:
        raise DataError(f"{path}: {error}") from None
    height, width = pixels.shape[:2]
    if (width, height) != size_px:
        raise DataError(f"{path}: {width}×{height} px, the calibration's {what} has {size_px[0]}×{size_px[1]} px")
    return pixels


def _read_views(path: Path) -> tuple[View, ...]:
    try:
        views = msgspec.convert(parse_json(read_text(path)), tuple[View, ...])
    except OSError as error:
        raise DataError(f"{path}: {error.strerror}") from None
    except (DocumentError, msgspec.ValidationError) as error:
        raise DataError(f"{path}: {error}; expected a list of image, pan_deg, tilt_deg, zoom") from None
    if not views:
        raise DataError(f"{path}: no views; give at least one")
    return views
