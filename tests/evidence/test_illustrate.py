"""What viewers are shown: documents that their schemas accept, in the right pixels, at the right times."""

import dataclasses
import json
import math
from functools import cache
from importlib import resources

import numpy as np
import pytest
from jsonschema import Draft7Validator

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.evidence import arcs, scene
from ptzd.evidence.illustrate import Illustrator
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.sphere import bearing
from ptzd.log.notes import Level
from ptzd.log.reader import LogReader
from ptzd.log.topics import TOPICS
from ptzd.log.writer import McapLog
from ptzd.model import Box, Candidate, FrameRef, HeadReading, Matcher, MatchResult, Motion, Outcome, ViewRef

T0 = 1_795_000_000_000_000_000
BOX = Box(x=380.0, y=200.0, w=40.0, h=30.0)
FRAME = FrameRef(seq=5, t_capture_ns=T0 - 100_000_000)
READING = HeadReading(pan_deg=10.0, tilt_deg=5.0, zoom=1.0)
VIEW = ViewRef(frame=FrameRef(seq=9, t_capture_ns=T0 + 300_000_000), reading=READING, sigma_deg=0.05)
CORNERS = ((300.0, 200.0), (360.0, 201.0), (359.0, 250.0), (299.0, 249.0))
JOB = cmd.RunMatch(
    match_id=1,
    request_id="a",
    frame=FRAME,
    box=BOX,
    view=VIEW,
    inverse_range=(0.01, 1.0),
    band_rad=0.01,
    matcher=Matcher.SWEEP,
    seed=1,
)
BEST = Candidate(
    pan_rad=0.17,
    tilt_rad=0.08,
    inverse_range=0.25,
    offset_rad=0.001,
    score=0.9,
    sharpness=0.1,
    sigma_rad=0.001,
    plane=(0.0, 0.0, 0.25),
    box_px=CORNERS,
)
SECOND = dataclasses.replace(BEST, score=0.4, box_px=tuple((x + 100, y) for x, y in CORNERS))
MATCH = MatchResult(
    matcher=Matcher.SWEEP, texture=9.0, candidates=(BEST, SECOND), coverage=(0.1, 0.9), seed=1, elapsed_ms=30.0
)
REQUEST = ev.RequestReceived(token=1, id="a", box=BOX, label="gate", range_m=(1.0, math.inf))
RESULT = cmd.PublishResult(
    id="a", outcome=Outcome.LOCKED, reason="held", label="gate", elapsed_ms=4200, views=3, pan_deg=9.7, box_ptz=CORNERS
)
STORY = [
    ev.Snapshot(),
    ev.HeadPolled(reading=READING, motion=Motion.STABLE),
    REQUEST,
    cmd.PinFrame(request_id="a", frame=FRAME),
    JOB,
    ev.HeadPolled(reading=dataclasses.replace(READING, zoom=2000.0), motion=Motion.MOVING),
    ev.MatchFinished(match_id=1, result=MATCH),
    ev.MatchFailed(match_id=2, reason="the view does not decode"),
    cmd.PublishStatus(state="SCAN", active="a", phase="moving", queue=("b",), fisheye="well", ptz="well", held=False),
    cmd.PublishFeedback(id="a", step="view", detail={"index": 1}),
    RESULT,
    cmd.ReleaseFrames(request_id="a"),
    ev.DeviceLost(device=ev.Device.PTZ, reason="no answer"),
    ev.DeviceWell(device=ev.Device.PTZ),
    ev.PayloadRefused(token=1, code="invalid", message="not a number", field="$.box.x"),
    cmd.ReplyRefused(token=1, code="busy", message="the queue is full", field="$"),
    ev.DeadlinePassed(),
]


@cache
def validator(name):
    text = resources.files("ptzd.log").joinpath("schemas", f"{TOPICS[name].schema}.json").read_text()
    return Draft7Validator(json.loads(text))


def told(rig, *story):
    illustrator = Illustrator(rig)
    return [document for item in story for document in illustrator.documents(T0 + 7, item)]


def of(documents, topic):
    return [document.body for document in documents if document.topic == topic]


def strict(name, document):
    """Errors of the official schema, and members that it does not know."""
    errors = [error.message for error in validator(name).iter_errors(document)]
    known = validator(name).schema["properties"]
    return errors + [f"unknown member {member}" for member in document if member not in known]


def test_every_document_fits_its_schema(rig):
    documents = told(rig, *STORY)
    for document in documents:
        assert strict(document.topic, document.body) == [], document
        assert json.loads(json.dumps(document.body, allow_nan=False)) == document.body
    assert {document.topic for document in documents} == {
        "/tf", "/scene", "/ptz/calibration", "/request", "/log", "/fisheye/annotations", "/ptz/annotations", "/match",
        "/state", "/result",
    }  # fmt: skip


def test_annotations_carry_the_time_of_their_picture_and_the_corners_of_its_pixels(rig):
    documents = told(rig, REQUEST, JOB, ev.MatchFinished(match_id=1, result=MATCH))
    (fisheye,) = of(documents, "/fisheye/annotations")
    assert fisheye["timestamp"] == {"sec": FRAME.t_capture_ns // 10**9, "nsec": FRAME.t_capture_ns % 10**9}
    drawn = [(point["x"], point["y"]) for point in fisheye["points"][0]["points"]]
    assert drawn == [(x + 0.5, y + 0.5) for x, y in BOX.corners]
    assert fisheye["points"][0]["type"] == 2
    (ptz,) = of(documents, "/ptz/annotations")
    assert ptz["timestamp"] == {"sec": VIEW.frame.t_capture_ns // 10**9, "nsec": VIEW.frame.t_capture_ns % 10**9}
    assert [(point["x"], point["y"]) for point in ptz["points"][0]["points"]] == [
        (x + 0.5, y + 0.5) for x, y in CORNERS
    ]
    assert [text["text"][:4] for text in ptz["texts"]] == ["0.90", "0.40"]


def test_the_arc_starts_at_the_box_and_lies_on_the_plane_of_ray_and_baseline(rig):
    arc = arcs.arc_of(rig, dataclasses.replace(JOB, inverse_range=(0.0, 1.0)))
    (line,) = arcs.in_fisheye(rig, arc)
    assert line[0] == pytest.approx(BOX.centre, abs=1e-6)
    rays, _ = rig.fisheye.lift(np.array(line))
    normal = np.cross(rig.head_from_fisheye_translation, rays[0])
    assert np.abs(rays @ (normal / np.linalg.norm(normal))).max() < 1e-9
    (seen,) = arcs.in_view(rig, arc, READING)
    assert len(seen) > 10
    assert arcs.in_view(rig, arc, dataclasses.replace(READING, zoom=50_000.0)) == []


def test_the_epipole_is_where_the_fisheye_sees_the_head(rig):
    toward = dataclasses.replace(rig, head_from_fisheye_translation=np.array([-0.5, 0.0, -0.5]))
    x, y = arcs.epipole_in_fisheye(toward)
    (ray,), _ = toward.fisheye.lift(np.array([[x, y]]))
    assert ray == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5)], abs=1e-9)
    behind = dataclasses.replace(rig, head_from_fisheye_translation=np.array([0.0, 0.0, 0.5]))
    assert arcs.epipole_in_fisheye(behind) is None


def test_a_box_beyond_the_image_circle_is_drawn_without_an_arc(rig):
    job = dataclasses.replace(JOB, box=Box(x=0.0, y=0.0, w=8.0, h=8.0))
    assert arcs.arc_of(rig, job) is None
    documents = told(rig, job, ev.MatchFinished(match_id=1, result=MATCH))
    assert len(of(documents, "/fisheye/annotations")[0]["points"]) == 1
    assert of(documents, "/scene") == []


def test_the_same_request_is_drawn_once_for_all_its_views(rig):
    documents = told(rig, JOB, dataclasses.replace(JOB, match_id=2))
    assert len(of(documents, "/fisheye/annotations")) == 1


def test_what_was_drawn_goes_when_the_request_is_over(rig):
    last = of(told(rig, JOB, cmd.ReleaseFrames(request_id="a")), "/fisheye/annotations")[-1]
    assert (last["points"], last["circles"], last["texts"]) == ([], [], [])


def test_an_answer_to_a_match_of_an_older_file_still_makes_a_row(rig):
    documents = told(rig, ev.MatchFinished(match_id=8, result=MATCH))
    assert [document.topic for document in documents] == ["/match"]
    row = documents[0].body
    assert row["score"] == 0.9
    assert row["second_score"] == 0.4
    assert row["range_m"] == pytest.approx(4.0)
    assert "request_id" not in row


def test_rows_leave_out_what_is_unknown(rig):
    (row,) = of(told(rig, RESULT), "/result")
    assert "range_m" not in row
    assert row["outcome"] == "locked"
    (row,) = of(told(rig, REQUEST), "/request")
    assert row["range_near_m"] == 1.0
    assert "range_far_m" not in row


def test_frames_agree_with_the_geometry(rig):
    (pose,) = of(told(rig, ev.HeadPolled(reading=READING, motion=Motion.STABLE)), "/tf")
    (turn,) = pose["transforms"]
    rotated = turned(turn["rotation"], np.array([0.0, 0.0, 1.0]))
    assert rotated == pytest.approx(bearing(math.radians(10.0), math.radians(5.0)), abs=1e-12)
    fixed = scene.fixed_transforms(T0, rig)["transforms"]
    assert [(item["parent_frame_id"], item["child_frame_id"]) for item in fixed] == [
        ("world", "head"),
        ("head", "fisheye"),
    ]
    assert turned(fixed[0]["rotation"], np.array([0.0, -1.0, 0.0])) == pytest.approx([0.0, 0.0, 1.0]), "up is up"
    assert turned(fixed[0]["rotation"], np.array([0.0, 0.0, 1.0])) == pytest.approx([1.0, 0.0, 0.0]), "forward is x"


def turned(q, vector):
    axis, w = np.array([q["x"], q["y"], q["z"]]), q["w"]
    return vector + 2.0 * np.cross(axis, np.cross(axis, vector) + w * vector)


def test_poses_are_written_when_they_change(rig):
    poll = ev.HeadPolled(reading=READING, motion=Motion.STABLE)
    moved = dataclasses.replace(poll, reading=dataclasses.replace(READING, pan_deg=11.0))
    documents = told(rig, poll, poll, moved)
    assert len(of(documents, "/tf")) == 2
    assert len(of(documents, "/ptz/calibration")) == 1
    beyond = dataclasses.replace(poll, reading=dataclasses.replace(READING, zoom=50_000.0))
    assert of(told(rig, beyond), "/ptz/calibration") == []


def test_calibrations_name_models_that_viewers_know(rig):
    assert scene.calibration(T0, "fisheye", rig.fisheye) is None
    pinhole = dataclasses.replace(rig.fisheye, xi=0.0)
    assert scene.calibration(T0, "fisheye", pinhole)["distortion_model"] == "plumb_bob"
    fisheye = KannalaBrandtCamera(size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5)
    document = scene.calibration(T0, "fisheye", fisheye)
    assert document["distortion_model"] == "kannala_brandt"
    assert strict("/fisheye/calibration", document) == []


def test_the_target_ray_ends_where_the_match_says(rig):
    updates = of(told(rig, JOB, ev.MatchFinished(match_id=1, result=MATCH)), "/scene")
    target = updates[-1]["entities"][0]
    assert target["id"] == "target"
    tip = np.array([target["lines"][0]["points"][-1][axis] for axis in "xyz"])
    arc = arcs.arc_of(rig, JOB)
    assert np.linalg.norm(tip) == pytest.approx(1.0 / float(arc.head_inverse_range(0.25)))
    assert tip / np.linalg.norm(tip) == pytest.approx(bearing(0.17, 0.08))


def test_levels_of_messages(rig):
    lost = of(told(rig, ev.DeviceLost(device=ev.Device.PTZ, reason="no answer")), "/log")
    assert (lost[0]["level"], lost[0]["message"]) == (Level.ERROR, "ptz lost: no answer")


async def test_the_writer_shows_what_it_is_told(rig, settings, run, clock):
    async with McapLog(settings(), run, clock, illustrate=Illustrator(rig).documents) as log:
        log.rotate(0, T0, STORY[0])
        for number, item in enumerate(STORY[1:], 1):
            if isinstance(item, ev.Event):
                log.event(number, T0 + number, item)
            else:
                log.command(number, T0 + number, item)
        await log.settled()
        path = log.closed_files() or [log.current_file]
    with LogReader(path[0]) as reader:
        entries = list(reader.entries())
    assert len({entry.topic for entry in entries}) == 12
    annotated = [entry for entry in entries if entry.topic == "/fisheye/annotations"]
    assert annotated[0].publish_ns == FRAME.t_capture_ns
