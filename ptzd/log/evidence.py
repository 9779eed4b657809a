"""One request as one HTML page that needs nothing else: to hand to a colleague."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator

import cv2
import numpy as np

from ptzd.control.events import MatchFailed, MatchFinished
from ptzd.errors import LogError, PtzdError
from ptzd.geometry.rig import Rig
from ptzd.log import along, drawing
from ptzd.log.info import clock_time
from ptzd.log.protobuf import NS
from ptzd.log.reader import LogReader
from ptzd.log.story import Look, Story
from ptzd.log.topics import FISHEYE_IMAGE, PTZ_IMAGE
from ptzd.model import FrameRef

MAX_VIEWS = 24
"""Views shown on a page; the timeline has them all."""
_PLOT = (720, 220)
_STYLE = """
body{font:15px/1.45 system-ui,sans-serif;margin:2rem auto;max-width:1100px;padding:0 1rem;color:#222;background:#fff}
h1{font-size:1.5rem}h2{font-size:1.1rem;margin-top:2rem}img,svg{max-width:100%;border:1px solid #ccc}
figure{display:inline-block;margin:0 1rem 1rem 0;vertical-align:top}
figcaption{font-size:.85rem;color:#555;max-width:40rem}
table{border-collapse:collapse;font-size:.9rem}td,th{padding:.15rem .8rem .15rem 0;text-align:left;vertical-align:top}
.num{text-align:right;font-variant-numeric:tabular-nums}
"""


def page(log: LogReader, rig: Rig, story: Story) -> str:
    """Self-contained HTML of one request.

    Parameters
    ----------
    log : LogReader
        The file, open; pictures come from it.
    rig : Rig
        Calibration of the log.
    story : Story
        The request.

    Raises
    ------
    LogError
        The file is damaged.
    """
    title = html.escape(f"{story.id} {story.label}".strip())
    body = "\n".join(
        (
            f"<h1>{title}: {html.escape(story.outcome)}</h1>",
            f"<p>{html.escape(story.reason)}</p>",
            _facts(log, story),
            "<h2>Asked for</h2>",
            *_asked(log, rig, story),
            "<h2>Score along the arc</h2>",
            _curves(log, rig, story),
            "<h2>Views</h2>",
            *_views(log, rig, story),
            "<h2>Timeline</h2>",
            _timeline(story),
        )
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def _facts(log: LogReader, story: Story) -> str:
    run, result = log.run, story.result
    facts = [("log", log.path.name), ("rig", run.rig), ("ptzd", run.versions.get("ptzd", "?"))]
    facts += [("heard of", clock_time(story.t_ns)), ("file", f"{run.file_index} of its run")]
    if result is not None:
        known = {
            "took": f"{result.elapsed_ms / 1000:.2f} s",
            "views": str(result.views),
            "pan, tilt": f"{_number(result.pan_deg)}°, {_number(result.tilt_deg)}°",
            "range": "unknown or infinite" if result.range_m is None else f"{result.range_m:.2f}",
            "probability": _number(result.probability),
            "one sigma": f"{_number(result.sigma_deg)}°",
        }
        facts += list(known.items())
    rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in facts)
    return f"<table>{rows}</table>"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _picture(log: LogReader, topic: str, frame: FrameRef) -> drawing.Pixels | None:
    """Decoded picture; None when it is not in this file or does not decode."""
    if not log.has_picture(topic, frame):
        return None
    return drawing.decode(log.picture(topic, frame))


def _figure(pixels: drawing.Pixels, caption: str) -> str:
    data = base64.b64encode(drawing.encode(pixels)).decode()
    return (
        f'<figure><img alt="" src="data:image/jpeg;base64,{data}">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def _asked(log: LogReader, rig: Rig, story: Story) -> Iterator[str]:
    frame = story.frame or (story.looks[0].job.frame if story.looks else None)
    pixels = None if frame is None else _picture(log, FISHEYE_IMAGE, frame)
    if frame is None or pixels is None:
        yield "<p>The fisheye picture is not in this file.</p>"
        return
    if story.box is not None:
        yield _figure(drawing.crop(pixels, story.box), "the region, enlarged")
    caption = f"fisheye frame {frame.seq}, {clock_time(frame.t_capture_ns)}: box, arc, epipole"
    yield _figure(drawing.fisheye(pixels, rig, story), caption)


def _views(log: LogReader, rig: Rig, story: Story) -> Iterator[str]:
    if not story.looks:
        yield "<p>No view was matched.</p>"
    for number, look in enumerate(story.looks[:MAX_VIEWS]):
        pixels = _picture(log, PTZ_IMAGE, look.job.view.frame)
        caption = f"look {number}: {_said(look)}"
        yield (
            f"<p>{html.escape(caption)}: not in this file</p>"
            if pixels is None
            else _figure(drawing.view(pixels, rig, look), caption)
        )
    if len(story.looks) > MAX_VIEWS:
        yield f"<p>… and {len(story.looks) - MAX_VIEWS} more.</p>"


def _said(look: Look) -> str:
    reading = look.job.view.reading
    pose = f"pan {reading.pan_deg:.2f}°, tilt {reading.tilt_deg:.2f}° (camera's), zoom {reading.zoom:g}"
    if isinstance(look.answer, MatchFailed):
        return f"{pose}: {look.answer.reason}"
    if look.answer is None:
        return f"{pose}: no answer in this file"
    best = look.answer.result.candidates[:1]
    return f"{pose}: score {best[0].score:.3f}" if best else f"{pose}: nothing found"


def _curves(log: LogReader, rig: Rig, story: Story) -> str:
    look = story.found
    fisheye = None if look is None else _picture(log, FISHEYE_IMAGE, look.job.frame)
    view = None if look is None else _picture(log, PTZ_IMAGE, look.job.view.frame)
    if look is None or fisheye is None or view is None:
        return "<p>Nothing was found, so there is no curve to show.</p>"
    grey = (cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) for pixels in (fisheye, view))
    try:
        curve = along.score_along(rig, look, *(np.asarray(pixels, np.uint8) for pixels in grey))
    except LogError:
        raise
    except PtzdError as error:
        return f"<p>No curve: {html.escape(str(error))}</p>"
    if curve is None:
        return "<p>The arc is a point: there is no curve to show.</p>"
    assert isinstance(look.answer, MatchFinished)
    note = (
        "Plain correlation of the region with the best view, recomputed from the recorded pictures; "
        "dots are the matcher's own candidates."
    )
    return f"{_plot(curve, look.answer)}<p>{note}</p>"


def _plot(curve: along.Curve, answer: MatchFinished) -> str:
    """SVG: score over the angle along the arc, the candidates at their inverse range."""
    width, height = _PLOT
    first, last = float(curve.angle_deg[0]), float(curve.angle_deg[-1])

    def at(angle_deg: float, score: float) -> str:
        x = 50 + (angle_deg - first) / max(last - first, 1e-9) * (width - 70)
        return f"{x:.1f},{20 + (1.0 - score) / 2.0 * (height - 60):.1f}"

    parts = [f'<polyline points="{at(first, 0)} {at(last, 0)}" stroke="#bbb" fill="none"/>']
    for run in np.split(np.arange(len(curve.score)), np.flatnonzero(np.isnan(curve.score))):
        points = " ".join(
            at(float(curve.angle_deg[k]), float(curve.score[k])) for k in run if not np.isnan(curve.score[k])
        )
        if points:
            parts.append(f'<polyline points="{points}" stroke="#06c" fill="none" stroke-width="1.5"/>')
    for candidate in answer.result.candidates:
        angle = float(np.interp(candidate.inverse_range, curve.inverse_range, curve.angle_deg))
        x, y = at(angle, candidate.score).split(",")
        parts.append(f'<circle cx="{x}" cy="{y}" r="4" fill="#2a2"/>')
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        k = round(share * (len(curve.angle_deg) - 1))
        s = float(curve.inverse_range[k])
        named = f"{1.0 / s:.3g}" if s > 0.0 else "∞"
        x, _ = at(float(curve.angle_deg[k]), 0.0).split(",")
        parts.append(f'<text x="{x}" y="{height - 10}" font-size="12" text-anchor="middle">{named}</text>')
    for score in (-1, 0, 1):
        _, y = at(first, score).split(",")
        parts.append(f'<text x="40" y="{y}" font-size="12" text-anchor="end">{score}</text>')
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        f'role="img" aria-label="score over range">{"".join(parts)}</svg><p>range along the ray</p>'
    )


def _timeline(story: Story) -> str:
    rows = "".join(
        f'<tr><td class="num">{(step.t_ns - story.t_ns) / NS:.3f} s</td><td class="num">{step.sequence}</td>'
        f"<td>{html.escape(step.what)}</td><td>{html.escape(step.text)}</td></tr>"
        for step in story.steps
    )
    return f"<table><tr><th>after</th><th>event</th><th>what</th><th></th></tr>{rows}</table>"
