"""The sheet: one picture of what a log holds, a row per request: fisheye with box and arc, the views, the lock."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.calibration.file import read_rig
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LoggedCommand, LogReader
from ptzd.model import Box, HeadReading, MatchResult

Pixels = NDArray[np.uint8]

TILE_PX = (400, 300)
HEADER_PX = 36
FOOTER_PX = 26
MAX_VIEWS = 3
MARGIN_PX = 6
GREEN_BGR = (80, 220, 80)
ORANGE_BGR = (40, 160, 250)
GREY_BGR = (60, 60, 60)
WHITE_BGR = (240, 240, 240)
STEP_RAD = math.radians(0.25)
"""Between the points of a drawn arc."""


@dataclass(slots=True)
class _Story:
    """One request as the log tells it."""

    box: Box
    matches: list[tuple[cmd.RunMatch, MatchResult | None]] = field(default_factory=list)
    result: cmd.PublishResult | None = None


def write_sheet(log: Path, out: Path) -> int:
    """Draw the requests of a log file.

    Returns
    -------
    int
        Rows drawn.
    """
    with LogReader(log) as reader:
        rig = read_rig(reader.run.calibration_text, f"{log}: rig.yaml")
        stories = _stories(reader)
        told = {name: story for name, story in stories.items() if story.matches}
        rows = [(_caption(name, story), _tiles(story, rig, reader)) for name, story in told.items()]
    if rows:
        columns = max(len(tiles) for _, tiles in rows)
        sheet = np.vstack([_row(caption, tiles, columns) for caption, tiles in rows])
        out.write_bytes(cv2.imencode(out.suffix, sheet)[1].tobytes())
    return len(rows)


def _stories(reader: LogReader) -> dict[str, _Story]:
    stories: dict[str, _Story] = {}
    jobs: dict[int, cmd.RunMatch] = {}
    results: dict[int, MatchResult] = {}
    for logged in reader.decisions():
        told = logged.command if isinstance(logged, LoggedCommand) else logged.event
        match told:
            case ev.RequestReceived():
                stories.setdefault(told.id, _Story(box=told.box))
            case cmd.RunMatch():
                jobs[told.match_id] = told
            case ev.MatchFinished():
                results[told.match_id] = told.result
            case cmd.PublishResult() if told.id in stories:
                stories[told.id].result = told
            case _:
                pass
    for number, job in jobs.items():
        if job.request_id in stories:
            stories[job.request_id].matches.append((job, results.get(number)))
    return stories


def _tiles(story: _Story, rig: Rig, reader: LogReader) -> list[Pixels]:
    """Fisheye, enlarged box, the views of the scan, the last look."""
    first, last = story.matches[0][0], story.matches[-1]
    fisheye = _decoded(reader.picture("/fisheye/image", first.frame))
    tiles = [_fisheye_tile(fisheye, first, rig), _crop_tile(fisheye, first.box)]
    scan = [match for match in story.matches if match[0].inverse_range == first.inverse_range]
    looks = [("scan", match) for match in scan[:MAX_VIEWS]]
    if last not in scan:
        looks.append(("last look", last))
    for what, (job, result) in looks:
        view = _decoded(reader.picture("/ptz/image", job.view.frame))
        tiles.append(_view_tile(view, job, result, rig, what))
    return tiles


def _row(caption: str, tiles: list[Pixels], columns: int) -> Pixels:
    """One request: a line of text above its tiles, filled up to the widest row."""
    filler = [_with_footer(_blank(), "")] * (columns - len(tiles))
    strip = np.hstack([_framed(tile) for tile in [*tiles, *filler]])
    header = np.full((HEADER_PX, strip.shape[1], 3), GREY_BGR, np.uint8)
    _write(header, caption, (10, 25), 0.62)
    return np.vstack([header, strip]).astype(np.uint8)


def _write(picture: Pixels, text: str, where: tuple[int, int], scale: float) -> None:
    cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, scale, WHITE_BGR, 1, cv2.LINE_AA)


def _caption(name: str, story: _Story) -> str:
    result = story.result
    if result is None:
        return f"{name}: not ended in this file"
    label = "" if result.label in {"", name} else f" ({result.label})"
    parts = [f"{name}{label}: {result.outcome}"]
    if result.pan_deg is not None and result.tilt_deg is not None:
        parts.append(f"pan {result.pan_deg:.2f} tilt {result.tilt_deg:.2f} deg")
    if result.range_m is not None:
        parts.append(f"range {result.range_m:.2f} m")
    if result.probability is not None:
        parts.append(f"probability {result.probability:.3f}")
    return ",  ".join(parts)


def _fisheye_tile(fisheye: Pixels, job: cmd.RunMatch, rig: Rig) -> Pixels:
    """Whole fisheye picture with the box; the arc is that of the found view's centre seen back from the head."""
    picture = fisheye.copy()
    corners = np.round(np.array(job.box.corners)).astype(np.int32)
    cv2.polylines(picture, [corners.reshape(-1, 1, 2)], isClosed=True, color=GREEN_BGR, thickness=2)
    # The head's optical axis, walked away from the head, draws the epipolar curve of this view in the fisheye.
    axis = rig.head_from_camera(job.view.reading) @ np.array([0.0, 0.0, 1.0])
    ranges = np.geomspace(0.3, 200.0, 200)[:, None] * np.linalg.norm(rig.head_from_fisheye_translation)
    points = (axis * ranges - rig.head_from_fisheye_translation) @ rig.head_from_fisheye_rotation
    pixels, valid = rig.fisheye.project(points / np.linalg.norm(points, axis=1, keepdims=True))
    _polyline(picture, pixels[valid], ORANGE_BGR)
    return _with_footer(_resized(picture), "fisheye: box (green), epipolar curve of the first view's axis (orange)")


def _crop_tile(fisheye: Pixels, box: Box) -> Pixels:
    """What the other app saw: the box and as much again around it, enlarged without smoothing."""
    half_w, half_h = box.w, box.h
    (x, y), (height, width) = box.centre, fisheye.shape[:2]
    left, right = max(round(x - half_w), 0), min(round(x + half_w), width)
    top, bottom = max(round(y - half_h), 0), min(round(y + half_h), height)
    crop = fisheye[top:bottom, left:right]
    scale = min(TILE_PX[0] / crop.shape[1], TILE_PX[1] / crop.shape[0])
    large = cv2.resize(crop, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    corners = (np.array(box.corners) - (left, top) + 0.5) * scale
    cv2.polylines(large, [np.round(corners).astype(np.int32).reshape(-1, 1, 2)], True, GREEN_BGR, 2)
    return _with_footer(_resized(np.asarray(large, np.uint8)), f"the box, {box.w:g} x {box.h:g} px, enlarged")


def _view_tile(view: Pixels, job: cmd.RunMatch, result: MatchResult | None, rig: Rig, what: str) -> Pixels:
    """A PTZ picture with the arc, the best candidate's box, and a cross at the optical axis."""
    picture, reading = view.copy(), job.view.reading
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(job.box.centre))[0], *job.inverse_range)
    pixels, valid = rig.project_to_view(arc.bearing(arc.steps(STEP_RAD)), reading)
    _polyline(picture, pixels[valid], ORANGE_BGR)
    score = ""
    if result is not None and result.candidates:
        best = result.candidates[0]
        outline = np.round(np.array(best.box_px)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [outline], isClosed=True, color=GREEN_BGR, thickness=2)
        score = f", score {best.score:.2f}"
    text = f"{what}: pan {reading.pan_deg:.1f}, tilt {reading.tilt_deg:.1f}, zoom {reading.zoom:.0f}{score}"
    cv2.drawMarker(picture, _centre(rig, reading), WHITE_BGR, cv2.MARKER_CROSS, 18, 1)
    return _with_footer(_resized(picture), text)


def _centre(rig: Rig, reading: HeadReading) -> tuple[int, int]:
    camera = rig.zoom.camera_at(reading.zoom)
    return round(camera.cx), round(camera.cy)


def _polyline(picture: Pixels, pixels: NDArray[np.float64], colour: tuple[int, int, int]) -> None:
    if len(pixels) > 1:
        bounded = np.clip(pixels, -1e4, 1e4)
        cv2.polylines(picture, [np.round(bounded).astype(np.int32).reshape(-1, 1, 2)], False, colour, 2, cv2.LINE_AA)


def _decoded(jpeg: bytes) -> Pixels:
    return np.asarray(cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def _resized(picture: Pixels) -> Pixels:
    """Fit into a tile, the rest dark."""
    scale = min(TILE_PX[0] / picture.shape[1], TILE_PX[1] / picture.shape[0])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    tile = _blank()
    top, left = (TILE_PX[1] - small.shape[0]) // 2, (TILE_PX[0] - small.shape[1]) // 2
    tile[top : top + small.shape[0], left : left + small.shape[1]] = small
    return tile


def _blank() -> Pixels:
    return np.full((TILE_PX[1], TILE_PX[0], 3), 30, np.uint8)


def _with_footer(tile: Pixels, text: str) -> Pixels:
    footer = np.full((FOOTER_PX, tile.shape[1], 3), GREY_BGR, np.uint8)
    _write(footer, text, (4, 18), 0.42)
    return np.vstack([tile, footer]).astype(np.uint8)


def _framed(tile: Pixels) -> Pixels:
    framed = cv2.copyMakeBorder(tile, MARGIN_PX, MARGIN_PX, MARGIN_PX, MARGIN_PX, cv2.BORDER_CONSTANT, value=GREY_BGR)
    return np.asarray(framed, np.uint8)
