"""The HTML report of a calibration: one file, pictures and drawings inside."""

from __future__ import annotations

import base64
import html
import math
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.calibrate.parts import Outcome, camera_to_edge, read_shots
from ptzd.calibration.intrinsics import LensFit, in_camera
from ptzd.calibration.pictures import Boards, read_grey
from ptzd.calibration.reach import Reach, reach_of
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array, CameraModel, in_picture

MAGNIFIED = 60.0
"""Residuals are drawn so many times as long as they are."""
SHOWN_PICTURES = 6
SHOWN_ARCS = 8
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;margin:2em auto;max-width:70em;padding:0 1em;color:#1b1f24}"
    "pre{background:#f4f5f7;padding:1em;overflow:auto}img,svg{max-width:100%;height:auto;border:1px solid #ccd}"
    ".verdict{font-size:1.15em;background:#eef6ee;padding:.8em 1em;border-left:4px solid #2a7d3f}"
    "figure{margin:1.5em 0}figcaption{color:#555}"
)


def page(title: str, outcome: Outcome, figures: list[tuple[str, str]]) -> str:
    """The whole file; figures are (caption, HTML)."""
    verdicts = [line for line in outcome.lines if line.startswith("verdict: ")]
    other = "\n".join(line for line in outcome.lines if not line.startswith("verdict: "))
    parts = [f"<p class=verdict>{html.escape(line.removeprefix('verdict: ').capitalize())}</p>" for line in verdicts]
    parts.append(f"<pre>{html.escape(other)}</pre>")
    parts += [f"<figure>{body}<figcaption>{html.escape(caption)}</figcaption></figure>" for caption, body in figures]
    head = f"<meta charset=utf-8><title>{html.escape(title)}</title><style>{_STYLE}</style>"
    body = f"<h1>{html.escape(title)}</h1>{''.join(parts)}"
    return f"<!doctype html><html lang=en><head>{head}</head><body>{body}</body></html>\n"


def residual_figure(size_px: tuple[int, int], pixels: Array, residuals: Array) -> str:
    """Residual vectors where they are, magnified, over the coverage of the picture."""
    width, height = size_px
    scale = MAGNIFIED * width / 640.0
    cells = []
    count: Array
    count, _, _ = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=(12, 12), range=((0, width), (0, height)))
    for column, row in np.ndindex(count.shape):
        shade = 0.0 if count[column, row] == 0 else 0.15 + 0.35 * min(1.0, float(count[column, row]) / 12)
        x, y = column * width / 12, row * height / 12
        cells.append(
            f'<rect x="{x:.0f}" y="{y:.0f}" width="{width / 12:.1f}" height="{height / 12:.1f}" '
            f'fill="#3b7dd8" fill-opacity="{shade:.2f}"/>'
        )
    ends = pixels + residuals * scale
    lines = [
        f'<path d="M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" stroke="#b3261e" stroke-width="{width / 640:.2f}"/>'
        for (x, y), (u, v) in zip(pixels.tolist(), ends.tolist(), strict=True)
    ]
    body = "".join(cells) + "".join(lines)
    return (
        f'<svg viewBox="0 0 {width} {height}" width="{min(width, 900)}" xmlns="http://www.w3.org/2000/svg">{body}</svg>'
    )


def picture(image: NDArray[np.uint8]) -> str:
    """A picture inside the file."""
    share = min(1.0, 900.0 / image.shape[1])
    small = cv2.resize(image, None, fx=share, fy=share, interpolation=cv2.INTER_AREA) if share < 1.0 else image
    data = base64.b64encode(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()).decode()
    return f'<img alt="" src="data:image/jpeg;base64,{data}">'


def fisheye_report(outcome: Outcome, fit: LensFit, boards: Boards) -> str:
    """Report of `ptzd calibrate fisheye`."""
    pixels = np.concatenate([view.pixels for view in fit.views])
    drawn = residual_figure(fit.size_px, pixels, np.concatenate(fit.residuals))
    figures = [(f"Residuals, {MAGNIFIED:g} times as long; blue where boards were: cover what is white.", drawn)]
    camera = camera_to_edge(fit)
    figures.append(reach_figure(fit.size_px, reach_of(camera)))
    worst = np.argsort([-float(np.abs(part).mean()) for part in fit.residuals])[:SHOWN_PICTURES]
    for index in worst.tolist():
        view = fit.views[index]
        grey = read_grey(boards.paths[view.name]) if view.name in boards.paths else None
        if grey is None:
            continue
        image = np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
        predicted, valid = camera.project(in_camera(view.points_m, fit.poses[index]))
        _marks(image, view.pixels, (40, 160, 250), cv2.MARKER_TILTED_CROSS)
        _marks(image, predicted[valid], (80, 220, 80), cv2.MARKER_CROSS)
        figures.append((f"{view.name}: found (orange), predicted (green).", picture(image)))
    quality = fit.ray_sigma_rad()
    told = (
        f"verdict: rays of the fisheye are known to {math.degrees(quality):.3f}° (one sigma), the same at every range; "
    )
    told += "pictures with the board where the field is white would improve it." if quality > 0 else ""
    lines = (*outcome.lines, told)
    return page("Fisheye", Outcome(lines=lines, document=outcome.document, written=()), figures)


def import_report(outcome: Outcome, camera: CameraModel, reach: Reach) -> str:
    """Report of `ptzd calibrate fisheye --from`."""
    return page("Fisheye", outcome, [reach_figure(camera.size_px, reach)])


def reach_figure(size_px: tuple[int, int], reach: Reach) -> tuple[str, str]:
    """Caption and drawing of the picture's parts with and without rays."""
    width, height = size_px
    rows, columns = reach.covered.shape
    across, down = width / columns, height / rows
    strokes = []
    for row, line in enumerate(reach.covered):
        edges = np.flatnonzero(np.diff(np.concatenate([[True], line, [True]])))
        strokes += [
            f"M{first * across:.1f} {row * down:.1f}H{last * across:.1f}v{down:.1f}H{first * across:.1f}z"
            for first, last in edges.reshape(-1, 2).tolist()
        ]
    drawn = (
        f'<svg viewBox="0 0 {width} {height}" width="{min(width, 900)}" xmlns="http://www.w3.org/2000/svg">'
        f'<rect width="{width}" height="{height}" fill="#eef6ee"/><path d="{"".join(strokes)}" fill="#b3261e"/></svg>'
    )
    return f"The picture, red where it has no rays: {reach.told()}.", drawn


def _marks(image: NDArray[np.uint8], pixels: Array, colour: tuple[int, int, int], kind: int) -> None:
    for x, y in np.round(pixels).astype(int).tolist():
        cv2.drawMarker(image, (x, y), colour, kind, 9, 1)


def rig_report(outcome: Outcome, rig: Rig, fisheye: Path, shots: Path, pixels: Array, residuals: Array) -> str:
    """Report of `ptzd calibrate rig`: residuals in the fisheye, and arcs drawn over a pair of pictures."""
    drawn = residual_figure(rig.fisheye.size_px, pixels, residuals)
    figures = [(f"Residuals in the fisheye, {MAGNIFIED:g} times as long; blue where the rig was measured.", drawn)]
    grey = read_grey(fisheye)
    listed = [shot for shot in read_shots(shots) if shot.zoom == min(one.zoom for one in read_shots(shots))]
    if grey is None:
        return page("Rig", outcome, figures)
    best, chosen = -1, np.zeros((0, 2))
    shot = listed[0]
    for candidate in listed:
        inside = _seen_from(rig, pixels, candidate.reading)
        if inside.sum() > best:
            best, shot, chosen = int(inside.sum()), candidate, pixels[inside]
    other = read_grey(shots.parent / shot.image)
    if other is None or len(chosen) == 0:
        return page("Rig", outcome, figures)
    picks = chosen[np.linspace(0, len(chosen) - 1, min(SHOWN_ARCS, len(chosen))).astype(int)]
    left, right = (cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) for image in (grey, other))
    near = 1.0 / (1.5 if rig.metric else 3.0)
    for number, pixel in enumerate(picks):
        hue = np.array([[[number * 180 // len(picks), 220, 240]]], np.uint8)
        colour = tuple(int(value) for value in cv2.cvtColor(hue, cv2.COLOR_HSV2BGR)[0, 0])
        cv2.circle(left, (round(pixel[0]), round(pixel[1])), 5, colour, 2)
        arc = EpipolarArc.of(rig, rig.fisheye.lift(pixel)[0], 0.0, near)
        points, valid = rig.project_to_view(arc.bearing(arc.steps(math.radians(0.2))), shot.reading)
        line = np.round(np.clip(points[valid], -1e4, 1e4)).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(right, [line], isClosed=False, color=colour, thickness=2)
    figures.append(("Fisheye: each ring has the colour of its arc below.", picture(np.asarray(left, np.uint8))))
    figures.append(
        (f"{shot.image}: every ring's place lies on its arc if the rig is right.", picture(np.asarray(right, np.uint8)))
    )
    return page("Rig", outcome, figures)


def _seen_from(rig: Rig, pixels: Array, reading: object) -> NDArray[np.bool_]:
    from ptzd.model import HeadReading

    assert isinstance(reading, HeadReading)
    rays, valid = rig.fisheye.lift(pixels)
    directions = np.where(valid[:, None], rays, [[0.0, 0.0, 1.0]]) @ rig.head_from_fisheye_rotation.T
    points, ahead = rig.project_to_view(directions, reading)
    return np.asarray(valid & ahead & in_picture(rig.camera(reading), points, 40.0))
