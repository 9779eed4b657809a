"""The sheet: one picture of what a log holds, a row per request: fisheye with box and arc, the views, the last look."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.calibration.file import read_rig
from ptzd.control import events as ev
from ptzd.control.wording import range_in_words
from ptzd.evidence import drawing
from ptzd.evidence.story import Look, Story, collect
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LogReader

Pixels = NDArray[np.uint8]

TILE_PX = (400, 300)
HEADER_PX = 36
FOOTER_PX = 26
MARGIN_PX = 6
MAX_VIEWS = 3
"""Views of the scan that are shown; the last look comes after them."""
GREY_BGR = (60, 60, 60)
WHITE_BGR = (240, 240, 240)


def write_sheet(log: Path, out: Path) -> int:
    """Draw the requests of a log file.

    Parameters
    ----------
    log : Path
        A whole log file.
    out : Path
        Picture to write; its ending names the format.

    Returns
    -------
    int
        Rows drawn; no picture is written for 0.
    """
    with LogReader(log) as reader:
        rig = read_rig(reader.run.calibration_text, f"{log}: rig.yaml")
        stories = [story for story in collect(reader.decisions(), metric=rig.metric) if story.looks]
        rows = [(_caption(story, rig), _tiles(story, rig, reader)) for story in stories]
    if rows:
        columns = max(len(tiles) for _, tiles in rows)
        sheet = np.vstack([_row(caption, tiles, columns) for caption, tiles in rows])
        out.write_bytes(cv2.imencode(out.suffix, sheet)[1].tobytes())
    return len(rows)


def _tiles(story: Story, rig: Rig, reader: LogReader) -> list[Pixels]:
    """Fisheye, enlarged box, the views of the scan, the last look."""
    first, last = story.looks[0], story.looks[-1]
    fisheye = _decoded(reader.picture("/fisheye/image", first.job.frame))
    box = first.job.box
    tiles = [
        _tile(drawing.fisheye(fisheye, rig, story), "fisheye: box, and where the head looks along the arc (yellow)"),
        _tile(drawing.crop(fisheye, box), f"the box, {box.w:g} x {box.h:g} px, enlarged"),
    ]
    scan = [look for look in story.looks if look.job.inverse_range == first.job.inverse_range][:MAX_VIEWS]
    shown = [("scan", look) for look in scan] + ([] if last in scan else [("last look", last)])
    for what, look in shown:
        view = _decoded(reader.picture("/ptz/image", look.job.view.frame))
        tiles.append(_tile(drawing.view(view, rig, look), _about(what, look)))
    return tiles


def _about(what: str, look: Look) -> str:
    pose, answer = look.job.view.reading, look.answer
    text = f"{what}: camera at pan {pose.pan_deg:.1f}, tilt {pose.tilt_deg:.1f}, zoom {pose.zoom:.0f}"
    if isinstance(answer, ev.MatchFinished) and answer.result.candidates:
        return f"{text}, score {answer.result.candidates[0].score:.2f}"
    return text


def _caption(story: Story, rig: Rig) -> str:
    label = "" if story.label in {"", story.id} else f" ({story.label})"
    parts = [f"{story.id}{label}: {story.outcome}"]
    result = story.result
    if result is not None and result.pan_deg is not None and result.tilt_deg is not None:
        parts.append(f"pan {result.pan_deg:.2f} tilt {result.tilt_deg:.2f} deg in the head's frame")
    if result is not None and result.range_m is not None:
        parts.append(f"range {range_in_words(result.range_m, metric=rig.metric)}")
    if result is not None and result.probability is not None:
        parts.append(f"probability {result.probability:.3f}")
    return ",  ".join(parts)


def _row(caption: str, tiles: list[Pixels], columns: int) -> Pixels:
    """One request: a line of text above its tiles, filled up to the widest row."""
    filler = [_tile(_blank(), "")] * (columns - len(tiles))
    strip = np.hstack([*tiles, *filler])
    header = np.full((HEADER_PX, strip.shape[1], 3), GREY_BGR, np.uint8)
    _write(header, caption, (10, 25), 0.62)
    return np.vstack([header, strip]).astype(np.uint8)


def _tile(picture: Pixels, text: str) -> Pixels:
    """Fit a picture into a tile, the rest dark, a line of text below, a margin around."""
    scale = min(TILE_PX[0] / picture.shape[1], TILE_PX[1] / picture.shape[0])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    tile = _blank()
    top, left = (TILE_PX[1] - small.shape[0]) // 2, (TILE_PX[0] - small.shape[1]) // 2
    tile[top : top + small.shape[0], left : left + small.shape[1]] = small
    footer = np.full((FOOTER_PX, tile.shape[1], 3), GREY_BGR, np.uint8)
    _write(footer, text, (4, 18), 0.42)
    margins = (MARGIN_PX, MARGIN_PX, MARGIN_PX, MARGIN_PX)
    framed = cv2.copyMakeBorder(np.vstack([tile, footer]), *margins, cv2.BORDER_CONSTANT, value=GREY_BGR)
    return np.asarray(framed, np.uint8)


def _write(picture: Pixels, text: str, where: tuple[int, int], scale: float) -> None:
    cv2.putText(picture, text, where, cv2.FONT_HERSHEY_SIMPLEX, scale, WHITE_BGR, 1, cv2.LINE_AA)


def _blank() -> Pixels:
    return np.full((TILE_PX[1], TILE_PX[0], 3), 30, np.uint8)


def _decoded(jpeg: bytes) -> Pixels:
    pixels = drawing.decode(jpeg)
    return _blank() if pixels is None else pixels
