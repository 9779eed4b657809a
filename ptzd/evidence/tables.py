"""Flat documents for people and plots, derived from events and commands; what is unknown is left out."""

from __future__ import annotations

import math
from dataclasses import fields

from ptzd.control.commands import PublishStatus, RunMatch
from ptzd.control.events import MatchFailed, MatchFinished, RequestReceived
from ptzd.model import Candidate, Result

Json = dict[str, object]


def _known(document: Json) -> Json:
    return {name: value for name, value in document.items() if value is not None}


def _points(corners: tuple[tuple[float, float], ...]) -> list[Json]:
    return [{"x": x, "y": y} for x, y in corners]


def state_document(status: PublishStatus) -> Json:
    """``ptzd.State``."""
    return {
        "state": status.state,
        "phase": status.phase,
        "active": status.active or "",
        "queue": list(status.queue),
        "queued": len(status.queue),
        "fisheye": status.fisheye,
        "ptz": status.ptz,
        "held": status.held,
        "shadow": status.shadow,
        "doubt": status.doubt,
    }


def request_document(request: RequestReceived) -> Json:
    """``ptzd.Request``."""
    near, far = request.range_m or (None, None)
    return _known(
        {
            "id": request.id,
            "label": request.label,
            "x": request.box.x,
            "y": request.box.y,
            "w": request.box.w,
            "h": request.box.h,
            "frame_seq": request.frame_seq,
            "range_near_m": near,
            "range_far_m": far if far is not None and math.isfinite(far) else None,
            "zoom": request.zoom.value,
            "hfov_deg": request.hfov_deg,
            "fill": request.fill,
            "hold_s": request.hold_s,
            "timeout_s": request.timeout_s,
            "priority": request.priority,
        }
    )


def result_document(result: Result) -> Json:
    """``ptzd.Result``."""
    values = {field.name: getattr(result, field.name) for field in fields(Result)}
    return _known({**values, "outcome": result.outcome.value, "box_ptz": _points(result.box_ptz)})


def match_document(match: MatchFinished | MatchFailed, job: RunMatch | None) -> Json:
    """``ptzd.Match``; ``job`` is the command that it answers, None when it lies in an older file."""
    document: Json = {"match_id": match.match_id}
    if job is not None:
        document |= {
            "request_id": job.request_id,
            "frame_seq": job.frame.seq,
            "view_seq": job.view.frame.seq,
            "matcher": job.matcher.value,
        }
    if isinstance(match, MatchFailed):
        return document | {"error": match.reason}
    result = match.result
    document |= {
        "matcher": result.matcher.value,
        "texture": result.texture,
        "elapsed_ms": result.elapsed_ms,
        "candidates": len(result.candidates),
    }
    if len(result.candidates) > 1:
        document["second_score"] = result.candidates[1].score
    if result.candidates:
        document |= _best(result.candidates[0])
    return document


def _best(candidate: Candidate) -> Json:
    return _known(
        {
            "score": candidate.score,
            "sharpness": candidate.sharpness,
            "inverse_range": candidate.inverse_range,
            "range_m": 1.0 / candidate.inverse_range if candidate.inverse_range > 0.0 else None,
            "offset_deg": math.degrees(candidate.offset_rad),
            "sigma_deg": math.degrees(candidate.sigma_rad),
            "pan_deg": math.degrees(candidate.pan_rad),
            "tilt_deg": math.degrees(candidate.tilt_rad),
            "inliers": candidate.inliers,
            "in_view": candidate.in_view,
            "box": _points(candidate.box_px),
        }
    )
