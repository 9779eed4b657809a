"""A log turned into files that anybody can open: tables, pictures with overlays, an evidence page per request."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ptzd.calibration.file import read_rig
from ptzd.control.events import HeadPolled, MatchFinished
from ptzd.control.wording import scaled
from ptzd.errors import LogError
from ptzd.evidence import drawing, page
from ptzd.evidence.story import Stories, Story
from ptzd.evidence.tables import match_document, result_document
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LoggedEvent, LogReader
from ptzd.log.topics import COMMAND, EVENT, IMAGES

_UNSAFE = re.compile(r"[^A-Za-z0-9._-]")
_RESULT = ("pan_deg", "tilt_deg", "zoom", "hfov_deg", "range_m", "range_baselines", "probability", "sigma_deg")
_REQUEST = ("id", "label", "t_ns", "x", "y", "w", "h", "outcome", "reason", "elapsed_ms", "views", *_RESULT)
_MATCH = (
    *("request_id", "match_id", "frame_seq", "view_seq", "matcher", "texture", "candidates", "score", "second_score"),
    *("sharpness", "inverse_range", "range_m", "range_baselines", "offset_deg", "sigma_deg", "pan_deg", "tilt_deg"),
    *("elapsed_ms", "error"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Export:
    """What was written."""

    directory: Path
    requests: int
    pictures: int


@dataclass(slots=True)
class _Tables:
    """Rows collected in one pass over the file."""

    stories: Stories
    poses: list[Sequence[object]]
    frames: list[Sequence[object]]


def export(path: Path, out: Path, *, pictures: bool = False) -> Export:
    """Write ``requests.csv``, ``matches.csv``, ``timeline.csv``, ``poses.csv``, ``frames.csv`` and a page per request.

    Parameters
    ----------
    path : Path
        A whole log file.
    out : Path
        Directory; made when it is not there.
    pictures : bool
        All recorded pictures as well, with the camera's own bytes, and those of each request with box, arc and score
        drawn into them, in ``overlays``.

    Raises
    ------
    LogError
        The log is damaged, or the directory cannot be written.
    """
    with LogReader(path) as log:
        rig = read_rig(log.run.calibration_text, f"{path}: rig.yaml")
        try:
            out.mkdir(parents=True, exist_ok=True)
            found = _collect(log, out / "pictures" if pictures else None)
            _write_tables(found, out)
            for number, story in enumerate(found.stories.all):
                path = out / page_name(number, story)
                _write_page(log, rig, story, path)
                if pictures:
                    _write_overlays(log, rig, story, out / "overlays" / path.stem)
        except OSError as error:
            raise LogError(f"{out}: the export cannot be written: {error.strerror}") from None
    return Export(directory=out, requests=len(found.stories.all), pictures=len(found.frames) if pictures else 0)


def bundle(path: Path, request_id: str, out: Path) -> Path:
    """Write the evidence page of one request; the last one of that id.

    Raises
    ------
    LogError
        The log has no such request, is damaged, or the page cannot be written.
    """
    with LogReader(path) as log:
        rig = read_rig(log.run.calibration_text, f"{path}: rig.yaml")
        stories = Stories(metric=rig.metric)
        for decision in log.decisions():
            stories.tell(decision)
        asked = [story for story in stories.all if story.id == request_id]
        if not asked:
            known = ", ".join(story.id for story in stories.all[:20]) or "none"
            raise LogError(f"{path}: no request {request_id!r}; there are {known}")
        try:
            _write_page(log, rig, asked[-1], out)
        except OSError as error:
            raise LogError(f"{out}: the page cannot be written: {error.strerror}") from None
    return out


def page_name(number: int, story: Story) -> str:
    """File name that no request id can lead out of its directory."""
    return f"{number:03d}-{_UNSAFE.sub('_', story.id)}.html"


def _write_page(log: LogReader, rig: Rig, story: Story, out: Path) -> None:
    out.write_text(page.render(log, rig, story), encoding="utf-8")


def _write_overlays(log: LogReader, rig: Rig, story: Story, folder: Path) -> None:
    for name, pixels in page.overlays(log, rig, story):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.jpg").write_bytes(drawing.encode(pixels))


def _collect(log: LogReader, pictures: Path | None) -> _Tables:
    found = _Tables(Stories(metric=log.run.metric), [], [])
    if pictures is not None:
        pictures.mkdir(exist_ok=True)
    for entry in log.entries((EVENT, COMMAND, *IMAGES)):
        if entry.topic in IMAGES:
            image = log.image(entry)
            found.frames.append((entry.topic, entry.sequence, entry.publish_ns, entry.log_ns, len(image.data)))
            if pictures is not None:
                stream = entry.topic.split("/")[1]
                (pictures / f"{stream}-{entry.sequence:08d}-{entry.publish_ns}.jpg").write_bytes(image.data)
            continue
        decision = log.decision(entry)
        found.stories.tell(decision)
        if isinstance(decision, LoggedEvent) and isinstance(decision.event, HeadPolled):
            polled, reading = decision.event, decision.event.reading
            found.poses.append((decision.t_ns, reading.pan_deg, reading.tilt_deg, reading.zoom, polled.motion.value))
    return found


def _write_tables(found: _Tables, out: Path) -> None:
    stories, metric = found.stories.all, found.stories.metric
    _table(out / "requests.csv", _REQUEST, (_request_row(story, metric=metric) for story in stories))
    _table(out / "matches.csv", _MATCH, (row for story in stories for row in _match_rows(story, metric=metric)))
    steps = ((story.id, s.t_ns, s.sequence, s.what, s.text) for story in stories for s in story.steps)
    _table(out / "timeline.csv", ("id", "t_ns", "sequence", "what", "text"), steps)
    _table(out / "poses.csv", ("t_ns", "vapix_pan_deg", "vapix_tilt_deg", "zoom", "motion"), found.poses)
    _table(out / "frames.csv", ("topic", "seq", "t_capture_ns", "t_arrival_ns", "bytes"), found.frames)


def _request_row(story: Story, *, metric: bool) -> Sequence[object]:
    box, result = story.box, story.result
    corners = ("", "", "", "") if box is None else (box.x, box.y, box.w, box.h)
    told = {} if result is None else scaled(result_document(result), metric=metric)
    ended = (told.get("elapsed_ms", ""), told.get("views", ""), *(told.get(name, "") for name in _RESULT))
    return (story.id, story.label, story.t_ns, *corners, story.outcome, story.reason, *ended)


def _match_rows(story: Story, *, metric: bool) -> Iterable[Sequence[object]]:
    for look in story.looks:
        told: dict[str, object] = {"request_id": story.id, "match_id": look.job.match_id}
        if look.answer is not None:
            told |= scaled(match_document(look.answer, look.job), metric=metric)
        if isinstance(look.answer, MatchFinished):
            told["error"] = ""
        yield [told.get(name, "") for name in _MATCH]


def _table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow(header)
        writer.writerows([_cell(value) for value in row] for row in rows)


def _cell(value: object) -> object:
    """Text that a spreadsheet takes for a formula gets a quote before it: labels come from other apps."""
    if isinstance(value, str) and value[:1] in {"=", "+", "-", "@", "\t", "\r"}:
        return f"'{value}"
    return value
