"""What leaves a log for people: tables, pictures, pages; nothing of it can harm who opens it."""

import base64
import csv
import dataclasses
import math
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from ptzd.control import events as ev
from ptzd.errors import LogError
from ptzd.evidence import drawing, page, score_curve
from ptzd.evidence.export import bundle, export, page_name
from ptzd.evidence.info import describe
from ptzd.evidence.story import Look, Story
from ptzd.log.file import McapFile
from ptzd.log.reader import LogReader
from ptzd.model import Box, FrameRef


def rows(path):
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture
def exported(lock_log, tmp_path):
    out = tmp_path / "out"
    assert export(lock_log, out).requests == 2
    return out


def test_tables_hold_the_values_of_the_log(exported, lock):
    first, second = rows(exported / "requests.csv")
    assert (first["id"], first["outcome"], float(first["range_m"])) == ("gate-1", "locked", lock.range_m)
    assert (second["outcome"], second["reason"], second["range_m"]) == ("refused", "the queue is full", "")
    (match,) = rows(exported / "matches.csv")
    assert float(match["score"]) == 0.97
    assert float(match["range_m"]) == pytest.approx(lock.range_m)
    (pose,) = rows(exported / "poses.csv")
    assert (float(pose["vapix_pan_deg"]), pose["motion"]) == (2.0, "stable")
    assert [(row["topic"], row["seq"]) for row in rows(exported / "frames.csv")] == [
        ("/fisheye/image", "11"),
        ("/ptz/image", "3"),
    ]
    assert [row["what"] for row in rows(exported / "timeline.csv") if row["id"] == "gate-1"][-1] == "result"


def test_labels_of_other_apps_are_text_in_tables_and_pages(exported):
    assert rows(exported / "requests.csv")[0]["label"] == "'=gate <b>"
    text = (exported / "000-gate-1.html").read_text()
    assert "=gate &lt;b&gt;" in text
    assert "<b>" not in text


def test_no_id_leads_out_of_the_folder(exported, tmp_path):
    assert (exported / "001-.._.._evil.html").exists()
    assert not list(tmp_path.glob("*evil*"))
    story = Story(id="/etc/passwd\n", t_ns=0)
    assert page_name(2, story) == "002-_etc_passwd_.html"


class Page(HTMLParser):
    """Collects what a browser would load."""

    def __init__(self):
        super().__init__()
        self.sources, self.open = [], []

    def handle_starttag(self, tag, attrs):
        self.sources += [value for name, value in attrs if name in {"src", "href"}]
        if tag not in {"img", "meta", "polyline", "circle"}:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in {"polyline", "circle"}:
            assert self.open.pop() == tag


def test_a_page_stands_alone(lock_log, tmp_path):
    out = bundle(lock_log, "gate-1", tmp_path / "gate.html")
    shown = Page()
    shown.feed(out.read_text())
    assert shown.open == []
    assert len(shown.sources) == 3, "region, fisheye, one view"
    for source in shown.sources:
        kind, data = source.split(",")
        assert kind == "data:image/jpeg;base64"
        assert cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR) is not None
    assert "<svg" in out.read_text()
    assert "held as asked" in out.read_text()


def test_an_unknown_request_is_named_with_those_there_are(lock_log, tmp_path):
    with pytest.raises(LogError, match=r"no request 'nobody'; there are gate-1, \.\./\.\./evil"):
        bundle(lock_log, "nobody", tmp_path / "x.html")


def test_a_folder_that_cannot_be_written_is_named(lock_log, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LogError, match="export cannot be written"):
        export(lock_log, tmp_path / "file" / "deeper")


def test_pictures_come_out_as_the_camera_sent_them(lock_log, tmp_path, lock):
    assert export(lock_log, tmp_path / "out", pictures=True).pictures == 2
    found = {path.name.split("-")[0]: path.read_bytes() for path in (tmp_path / "out" / "pictures").iterdir()}
    assert found == {topic.split("/")[1]: jpeg for topic, _, jpeg in lock.pictures}


def test_pictures_of_a_request_have_drawn_into_them_what_was_asked_and_found(lock_log, tmp_path, lock):
    export(lock_log, tmp_path / "out", pictures=True)
    (folder,) = (tmp_path / "out" / "overlays").iterdir()
    assert folder.name == "000-gate-1"
    drawn = {path.stem: cv2.imdecode(np.fromfile(path, np.uint8), cv2.IMREAD_COLOR) for path in folder.iterdir()}
    assert drawn.keys() == {"fisheye", "region", "look-01"}
    for name, (_, _, jpeg) in zip(("fisheye", "look-01"), lock.pictures, strict=True):
        plain = drawing.decode(jpeg)
        assert drawn[name].shape == plain.shape
        assert (np.abs(drawn[name].astype(int) - plain).max(axis=-1) > 60).sum() > 100


def test_a_damaged_picture_message_is_named_with_its_file(tmp_path, run, calibration_text):
    file = McapFile(tmp_path / "odd.mcap", dataclasses.replace(run, calibration_text=calibration_text), 5)
    file.open()
    file.add("/ptz/image", 5, 5, 0, b"\x12\x7f")
    file.finish()
    with pytest.raises(LogError, match=r"odd\.mcap: /ptz/image at 5: picture message"):
        export(file.path, tmp_path / "out")
    with LogReader(file.path) as log, pytest.raises(LogError, match=r"odd\.mcap: /ptz/image"):
        log.picture("/ptz/image", FrameRef(seq=0, t_capture_ns=5))


def grey(lock, index):
    return cv2.imdecode(np.frombuffer(lock.pictures[index][2], np.uint8), cv2.IMREAD_GRAYSCALE)


@pytest.fixture
def look(lock_log):
    return describe(lock_log).stories[0].looks[0]


def test_the_score_peaks_at_the_true_range(rig, lock, look):
    curve = score_curve.score_along(rig, look, grey(lock, 0), grey(lock, 1))
    best = int(np.nanargmax(curve.score))
    assert curve.score[best] > 0.9
    assert 1.0 / curve.inverse_range[best] == pytest.approx(lock.range_m, rel=0.05)
    assert np.nanmedian(curve.score) < 0.5
    assert (np.diff(curve.inverse_range) > 0).all()


def test_places_out_of_view_have_no_score(rig, lock, look):
    aside = dataclasses.replace(look.job.view.reading, pan_deg=35.0)
    job = dataclasses.replace(look.job, view=dataclasses.replace(look.job.view, reading=aside))
    curve = score_curve.score_along(rig, dataclasses.replace(look, job=job), grey(lock, 0), grey(lock, 1))
    assert np.isnan(curve.score).any()


def test_a_box_outside_the_image_circle_has_no_curve(rig, lock, look):
    job = dataclasses.replace(look.job, box=Box(x=0.0, y=0.0, w=8.0, h=8.0))
    assert score_curve.score_along(rig, dataclasses.replace(look, job=job), grey(lock, 0), grey(lock, 1)) is None


def test_the_found_box_is_drawn_where_it_is(rig, lock, look):
    pixels = drawing.decode(lock.pictures[1][2])
    drawn = drawing.view(pixels, rig, look)
    changed = np.argwhere((drawn != pixels).any(axis=-1))
    corners = np.array(look.answer.result.candidates[0].box_px)
    near = [np.hypot(*(changed[:, ::-1] - corner).T).min() for corner in corners]
    assert max(near) < 2.0
    assert (drawn[tuple(np.round(corners[0]).astype(int)[::-1])] == drawing.GREEN).sum() >= 2


@pytest.mark.parametrize("answer", [None, ev.MatchFailed(match_id=1, reason="the view does not decode")])
def test_pages_of_requests_that_found_nothing(lock_log, rig, answer, look):
    with LogReader(lock_log) as log:
        story = Story(id="x", t_ns=0, looks=[Look(t_ns=0, job=look.job, answer=answer)])
        text = page.render(log, rig, story)
        assert "Nothing was found" in text
        elsewhere = dataclasses.replace(look.job, frame=dataclasses.replace(look.job.frame, seq=999))
        missing = Story(id="x", t_ns=0, looks=[Look(t_ns=0, job=elsewhere, answer=answer)])
        assert "not in this file" in page.render(log, rig, missing)
        assert "No view was matched" in page.render(log, rig, Story(id="x", t_ns=0))


def test_wild_boxes_are_drawn_without_harm(rig, lock, look):
    best = look.answer.result.candidates[0]
    wild = tuple((x * 1e9, -y * 1e9) for x, y in best.box_px)
    nowhere = tuple((math.inf, math.nan) for _ in range(4))
    result = dataclasses.replace(
        look.answer.result,
        candidates=(
            dataclasses.replace(best, box_px=wild),
            dataclasses.replace(best, box_px=()),
            dataclasses.replace(best, box_px=nowhere),
        ),
    )
    answer = dataclasses.replace(look.answer, result=result)
    pixels = drawing.decode(lock.pictures[1][2])
    assert drawing.view(pixels, rig, dataclasses.replace(look, answer=answer)).shape == pixels.shape
    assert drawing.crop(pixels, Box(x=-5000.0, y=-5000.0, w=10.0, h=10.0)).size
    assert drawing.decode(b"") is None
    assert drawing.decode(b"no picture") is None
    assert math.isfinite(float(drawing.encode(pixels)[0]))
    assert re.match(rb"\xff\xd8", drawing.encode(pixels))
