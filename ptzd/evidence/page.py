"""One request as one HTML page that needs nothing else: to hand to a colleague."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterator

import cv2
import numpy as np

from ptzd.control.events import MatchFailed, MatchFinished
from ptzd.errors import LogError, PtzdError
from ptzd.evidence import drawing, score_curve
from ptzd.evidence.plot import score_plot
from ptzd.evidence.story import Look, Story
from ptzd.evidence.words import distance, sentences
from ptzd.geometry.rig import Rig
from ptzd.log.protobuf import NS
from ptzd.log.reader import LogReader
from ptzd.log.times import clock_time
from ptzd.log.topics import FISHEYE_IMAGE, PTZ_IMAGE
from ptzd.model import FrameRef

MAX_VIEWS = 24
"""Views shown on a page; the timeline has them all."""
_STYLE = """
body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:1100px;padding:0 1rem;color:#222;background:#fff}
h1{font-size:1.6rem;margin-bottom:.3rem}h2{font-size:1.15rem;margin:2.2rem 0 .6rem;border-bottom:1px solid #ddd}
.outcome{background:#222;color:#fff;border-radius:.3rem;padding:.1rem .5rem;font-size:1.1rem;margin-left:.5rem}
.locked,.released{background:#187a2f}.lead{font-size:1.05rem;max-width:52rem}
img,svg{max-width:100%;border:1px solid #ccc}.pictures{display:flex;flex-wrap:wrap;gap:1rem;align-items:flex-start}
figure{margin:0;max-width:640px}figcaption{font-size:.88rem;color:#555}
table{border-collapse:collapse;font-size:.92rem}td,th{padding:.15rem .9rem .15rem 0;text-align:left;vertical-align:top}
.num{text-align:right;font-variant-numeric:tabular-nums}code{background:#f3f3f3;padding:.1rem .3rem}
@media print{h2{break-after:avoid}figure,tr{break-inside:avoid}}
"""


def render(log: LogReader, rig: Rig, story: Story) -> str:
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
    name = story.id if story.label in {"", story.id} else f"{story.id}: {story.label}"
    title = html.escape(name)
    lock = _lock(story)
    body = "\n".join(
        (
            f'<h1>{title}<span class="outcome {html.escape(story.outcome)}">{html.escape(story.outcome)}</span></h1>',
            f'<p class="lead">{html.escape(" ".join(sentences(story, rig)))}</p>',
            "<h2>Asked for, and found</h2>",
            '<div class="pictures">',
            *_asked(log, rig, story, lock),
            "</div>",
            "<h2>Score along the arc</h2>",
            _curves(log, rig, story),
            "<h2>Views</h2>",
            '<div class="pictures">',
            *_views(log, rig, story, lock),
            "</div>",
            "<h2>Timeline</h2>",
            _timeline(story),
            "<h2>Where this comes from</h2>",
            _facts(log, rig, story),
        )
    )
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>'
        f"<style>{_STYLE}</style></head><body>\n{body}\n</body></html>\n"
    )


def overlays(log: LogReader, rig: Rig, story: Story) -> Iterator[tuple[str, drawing.Pixels]]:
    """Names and pictures of one request with what was asked for and found drawn into them; those that the file has.

    Raises
    ------
    LogError
        The file is damaged.
    """
    frame = _frame(story)
    pixels = None if frame is None else _picture(log, FISHEYE_IMAGE, frame)
    if pixels is not None:
        yield "fisheye", drawing.fisheye(pixels, rig, story)
        if story.box is not None:
            yield "region", drawing.crop(pixels, story.box)
    for number, look in enumerate(story.looks, 1):
        seen = _picture(log, PTZ_IMAGE, look.job.view.frame)
        if seen is not None:
            yield f"look-{number:02d}", drawing.view(seen, rig, look)


def _frame(story: Story) -> FrameRef | None:
    return story.frame or (story.looks[0].job.frame if story.looks else None)


def _lock(story: Story) -> Look | None:
    """The last look that confirmed the target."""
    if not any(step.what == "locked" for step in story.steps):
        return None
    confirmed = (look for look in reversed(story.looks) if _score(look) is not None)
    return next(confirmed, None)


def _score(look: Look) -> float | None:
    if isinstance(look.answer, MatchFinished) and look.answer.result.candidates:
        return look.answer.result.candidates[0].score
    return None


def _facts(log: LogReader, rig: Rig, story: Story) -> str:
    run, result = log.run, story.result
    facts = [("log", f"{log.path.name}, file {run.file_index} of its run"), ("rig", run.rig)]
    facts += [("first heard of", clock_time(story.t_ns))]
    if result is not None:
        facts += [
            ("pan, tilt", f"{_number(result.pan_deg)}°, {_number(result.tilt_deg)}° (calibrated frame of the head)"),
            ("zoom, field of view", f"{_number(result.zoom)}, {_number(result.hfov_deg)}°"),
            ("range", distance(result.range_m, rig)),
            ("probability", "–" if result.probability is None else f"{result.probability:.5f}"),
            ("one sigma", f"{_number(result.sigma_deg)}°"),
        ]
    facts += [(name, version) for name, version in sorted(run.versions.items())]
    rows = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>" for name, value in facts)
    again = f"ptzd replay --recompute {log.path.name}"
    return (
        f"<table>{rows}</table><p>The same code comes to the same decisions from this log again: "
        f"<code>{html.escape(again)}</code></p>"
    )


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


def _asked(log: LogReader, rig: Rig, story: Story, lock: Look | None) -> Iterator[str]:
    frame = _frame(story)
    pixels = None if frame is None else _picture(log, FISHEYE_IMAGE, frame)
    if frame is None or pixels is None:
        yield "<p>The fisheye picture is not in this file.</p>"
    elif story.box is not None:
        yield _figure(drawing.crop(pixels, story.box), "the region that was asked for, enlarged")
    if lock is not None:
        yield _view(log, rig, story, lock, "the lock")
    if frame is None or pixels is None:
        return
    legend = "green: the box; yellow: where the head looks along the arc; ×: where the fisheye sees the head"
    caption = f"fisheye frame {frame.seq}, {clock_time(frame.t_capture_ns)}. {legend}"
    yield _figure(drawing.fisheye(pixels, rig, story), caption)


def _views(log: LogReader, rig: Rig, story: Story, lock: Look | None) -> Iterator[str]:
    if not story.looks:
        yield "<p>No view was matched.</p>"
    for number, look in enumerate(story.looks[:MAX_VIEWS], 1):
        if look is not lock:
            yield _view(log, rig, story, look, f"look {number} of {len(story.looks)}")
    if lock is not None:
        yield "<p>The lock is shown above.</p>"
    if len(story.looks) > MAX_VIEWS:
        yield f"<p>… and {len(story.looks) - MAX_VIEWS} more.</p>"


def _view(log: LogReader, rig: Rig, story: Story, look: Look, name: str) -> str:
    pixels = _picture(log, PTZ_IMAGE, look.job.view.frame)
    after_s = (look.job.view.frame.t_capture_ns - story.t_ns) / NS
    caption = f"{name}, after {after_s:.2f} s: {_said(look)}"
    if pixels is None:
        return f"<p>{html.escape(caption)}: the picture is not in this file</p>"
    return _figure(drawing.view(pixels, rig, look), caption)


def _said(look: Look) -> str:
    reading = look.job.view.reading
    pose = f"pan {reading.pan_deg:.2f}°, tilt {reading.tilt_deg:.2f}° (camera's), zoom {reading.zoom:g}"
    if isinstance(look.answer, MatchFailed):
        return f"{pose}: {look.answer.reason}"
    if look.answer is None:
        return f"{pose}: no answer in this file"
    score = _score(look)
    if score is None:
        return f"{pose}: nothing found"
    others = len(look.answer.result.candidates) - 1
    rivals = f", {others} other candidates in red" if others else ""
    return f"{pose}: best score {score:.3f}{rivals}"


def _curves(log: LogReader, rig: Rig, story: Story) -> str:
    look = story.found
    fisheye = None if look is None else _picture(log, FISHEYE_IMAGE, look.job.frame)
    view = None if look is None else _picture(log, PTZ_IMAGE, look.job.view.frame)
    if look is None or fisheye is None or view is None:
        return "<p>Nothing was found, so there is no curve to show.</p>"
    grey = (cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) for pixels in (fisheye, view))
    try:
        curve = score_curve.score_along(rig, look, *(np.asarray(pixels, np.uint8) for pixels in grey))
    except LogError:
        raise
    except PtzdError as error:
        return f"<p>No curve: {html.escape(str(error))}</p>"
    if curve is None:
        return "<p>The arc is a point: there is no curve to show.</p>"
    assert isinstance(look.answer, MatchFinished)
    note = (
        "Blue: how well the region agrees with the best view at every place along the arc, as plain correlation "
        "computed anew from the recorded pictures; 1 is perfect. Dots: what the matcher itself found, green the "
        "one it chose. "
        "One clear peak is an unmistakable place; two alike are why a request ends as ambiguous."
    )
    return f"{score_plot(curve, look.answer, 'm' if rig.metric else 'baselines')}<p>{note}</p>"


def _timeline(story: Story) -> str:
    rows = "".join(
        f'<tr><td class="num">{(step.t_ns - story.t_ns) / NS:.3f} s</td><td class="num">{step.sequence}</td>'
        f"<td>{html.escape(step.what)}</td><td>{html.escape(step.text)}</td></tr>"
        for step in story.steps
    )
    return f"<table><tr><th>after</th><th>event</th><th>what</th><th></th></tr>{rows}</table>"
