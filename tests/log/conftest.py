"""Small makers that the tests of the log share."""

import dataclasses
import itertools
import json
import os
import threading
import time

import cv2
import numpy as np
import pytest

from ptzd.calibration.file import dump_rig
from ptzd.config import LogSettings
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.events import FrameArrived, Snapshot
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import pan_tilt
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.log.codec import encode
from ptzd.log.file import McapFile
from ptzd.log.notes import Level, log_message
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.run_info import RunInfo
from ptzd.model import Box, Candidate, FrameRef, HeadReading, Matcher, MatchResult, Motion, Outcome, ViewRef
from ptzd.ports import Picture

START_NS = 1_795_000_000_000_000_000


class SteadyClock:
    """The daemon's clock: starts at a known time of day."""

    def __init__(self) -> None:
        self._offset_ns = START_NS - time.monotonic_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() + self._offset_ns

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns + self._offset_ns


@pytest.fixture
def clock():
    return SteadyClock()


@pytest.fixture
def run():
    return RunInfo(
        rig="yard",
        config_text="rig: yard\n",
        calibration_text="ptzd_calibration: 1\n",
        seed=7,
        versions={"ptzd": "0.1.0", "numpy": "2"},
        fingerprint={"cpu": "AVX2"},
    )


@pytest.fixture
def settings(tmp_path):
    """Maker of settings for a directory that does not exist yet."""

    def make(**changes):
        given = {"directory": str(tmp_path / "log"), "min_free_bytes": 0} | changes
        return LogSettings(**given)

    return make


@pytest.fixture
def unsynced(monkeypatch):
    """For tests that write thousands of files: what they look at is with the kernel."""
    for name in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, name, lambda descriptor: None)


@pytest.fixture
def picture():
    """Maker of pictures with bytes that tell them apart."""

    def make(seq, size=2000, t_ns=None):
        t_ns = START_NS + seq * 33_000_000 if t_ns is None else t_ns
        jpeg = b"\xff\xd8" + seq.to_bytes(4, "big") * (size // 4) + b"\xff\xd9"
        return Picture(frame=FrameRef(seq=seq, t_capture_ns=t_ns), t_arrival_ns=t_ns + 5_000_000, jpeg=jpeg)

    return make


@pytest.fixture
def frames():
    """Endless FrameArrived events, each with its time."""
    times = itertools.count(START_NS, 33_000_000)
    return ((t_ns, FrameArrived(frame=FrameRef(seq=seq, t_capture_ns=t_ns))) for seq, t_ns in enumerate(times))


@pytest.fixture
def snapshot():
    return Snapshot(state={"phase": "parked", "far": float("inf")})


@pytest.fixture
def prompt_disk(monkeypatch):
    """A disk that confirms at once, for tests that close files by the hundred."""
    for name in ("fsync", "fdatasync"):
        monkeypatch.setattr(os, name, lambda descriptor: None)


@pytest.fixture(autouse=True)
def no_thread_stays():
    before = set(threading.enumerate())
    yield
    left = [thread for thread in set(threading.enumerate()) - before if thread.name.startswith("ptzd-log")]
    assert not left


@pytest.fixture(scope="session")
def rig():
    """Half a metre apart, side by side; fisheye of 180°, PTZ of 60° to 2.4°."""
    entries = tuple(
        ZoomEntry(zoom=zoom, fx=fx, fy=fx, cx=319.5, cy=239.5)
        for zoom, fx in ((1.0, 554.0), (2000.0, 2200.0), (9999.0, 15000.0))
    )
    return Rig(
        fisheye=UnifiedCamera(size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=1.2, max_angle_rad=1.6),
        zoom=ZoomTable(size_px=(640, 480), entries=entries),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=np.eye(3),
        head_from_fisheye_translation=np.array([-0.5, -0.1, -0.05]),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=0.003, translation=0.005, head_rad=0.001),
    )


def wall(points):
    """Grey value of a textured wall at metres (x, y): smooth, without repetition."""
    x, y = points[..., 0], points[..., 1]
    waves = np.zeros(x.shape)
    chance = np.random.default_rng(3)
    for _ in range(40):
        kx, ky, phase = chance.normal(0, 6), chance.normal(0, 6), chance.uniform(0, 6.3)
        waves += np.sin(kx * x + ky * y + phase)
    return np.clip(128 + 18 * waves, 0, 255)


WALL_M = 4.0
"""Distance of the wall before the head."""


def render(camera, head_from_camera, origin):
    """JPEG of the wall, seen by a camera at ``origin`` in the head frame."""
    width, height = camera.size_px
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    rays, valid = camera.lift(np.stack([x, y], axis=-1))
    toward = rays @ head_from_camera.T
    ahead = valid & (toward[..., 2] > 0.05)
    reach = np.where(ahead, (WALL_M - origin[2]) / np.where(ahead, toward[..., 2], 1.0), 0.0)
    grey = np.where(ahead, wall(origin + toward * reach[..., None]), 0).astype(np.uint8)
    return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()


@pytest.fixture(scope="session")
def calibration_text(rig):
    return dump_rig(rig, {"method": "made for tests"})


@dataclasses.dataclass(frozen=True)
class Lock:
    """One request that locks: its decisions in order, and the pictures it used."""

    decisions: list
    """Sequence number, ns since the first, event or command."""
    pictures: list
    range_m: float


@pytest.fixture(scope="session")
def lock(rig):
    box = Box(x=350.0, y=215.0, w=44.0, h=36.0)
    reading = HeadReading(pan_deg=2.0, tilt_deg=3.0, zoom=1.0)
    translation = rig.head_from_fisheye_translation
    frame = FrameRef(seq=11, t_capture_ns=START_NS - 50_000_000)
    view = ViewRef(frame=FrameRef(seq=3, t_capture_ns=START_NS + 900_000_000), reading=reading, sigma_deg=0.05)
    (ray,), _ = rig.fisheye.lift(np.array([box.centre]))
    range_m = float((WALL_M - translation[2]) / ray[2])
    centre = rig.head_from_fisheye_rotation @ ray * range_m + translation
    pan, tilt = pan_tilt(centre)
    spots, _ = rig.fisheye.lift(np.array(box.corners))
    on_wall = spots * ((WALL_M - translation[2]) / spots[:, 2:]) + translation
    corners, _ = rig.project_to_view(on_wall, reading)
    best = Candidate(
        pan_rad=float(pan),
        tilt_rad=float(tilt),
        inverse_range=1.0 / range_m,
        offset_rad=0.0,
        score=0.97,
        sharpness=0.4,
        sigma_rad=0.0004,
        plane=(0.0, 0.0, 0.25),
        box_px=tuple((float(x), float(y)) for x, y in corners),
    )
    job = cmd.RunMatch(
        match_id=1, request_id="gate-1", frame=frame, box=box, view=view, inverse_range=(0.02, 1.0), band_rad=0.01,
        matcher=Matcher.SWEEP, seed=1,
    )  # fmt: skip
    result = MatchResult(
        matcher=Matcher.SWEEP, texture=20.0, candidates=(best,), coverage=(0.02, 1.0), seed=1, elapsed_ms=12.0
    )
    decisions = [
        (1, 0, ev.Snapshot()),
        (2, 1, ev.RequestReceived(token=5, id="gate-1", box=box, frame_seq=11, label="=gate <b>")),
        (2, 1, cmd.PinFrame(request_id="gate-1", frame=frame)),
        (2, 1, cmd.ReplyAccepted(token=5, id="gate-1", frame=frame, position=0)),
        (2, 1, cmd.PublishFeedback(id="gate-1", step="plan", detail={"views": 1})),
        (3, 500_000_000, ev.HeadPolled(reading=reading, motion=Motion.STABLE)),
        (4, 1_000_000_000, ev.ViewTaken(grab_id=1, view=view)),
        (4, 1_000_000_000, job),
        (5, 1_100_000_000, ev.MatchFinished(match_id=1, result=result)),
        (5, 1_100_000_000, cmd.PublishFeedback(id="gate-1", step="match", detail={"score": 0.97})),
        (6, 1_200_000_000, ev.UpdateReceived(id="gate-1", box=box)),
        (7, 1_300_000_000, ev.CancelReceived(token=None, id="gate-1")),
        (7, 1_300_000_000, cmd.PublishResult(
            id="gate-1", outcome=Outcome.LOCKED, reason="held as asked", label="=gate <b>", elapsed_ms=1400, views=1,
            pan_deg=1.5, tilt_deg=2.5, range_m=range_m, probability=0.99,
        )),
        (8, 2_000_000_000, ev.RequestReceived(token=6, id="../../evil", box=box)),
        (8, 2_000_000_000, cmd.ReplyRefused(token=6, code="busy", message="the queue is full", field="$")),
    ]  # fmt: skip
    pictures = [
        ("/fisheye/image", frame, render(rig.fisheye, rig.head_from_fisheye_rotation, translation)),
        ("/ptz/image", view.frame, render(rig.camera(reading), rig.head_from_camera(reading), np.zeros(3))),
    ]
    return Lock(decisions, pictures, range_m)


@pytest.fixture
def lock_log(tmp_path, run, lock, calibration_text):
    """A log file of that request."""
    file = McapFile(tmp_path / "lock.mcap", dataclasses.replace(run, calibration_text=calibration_text), START_NS)
    file.open()
    for topic, frame, jpeg in lock.pictures:
        image = CompressedImage(t_ns=frame.t_capture_ns, frame_id="x", data=jpeg, format="jpeg")
        t_ns = frame.t_capture_ns
        file.add(topic, t_ns + 20_000_000, t_ns, frame.seq, encode_image(image))
    for sequence, after_ns, told in lock.decisions:
        is_event, t_ns = isinstance(told, ev.Event), START_NS + after_ns
        name, body = encode(told)
        document = {"sequence": sequence, "t_ns": t_ns, "name": name, "body": body.decode()}
        file.add("/event" if is_event else "/command", t_ns, t_ns, sequence, json.dumps(document).encode())
    said = log_message(t_ns, Level.WARNING, "ptzd.log", "3 pictures dropped")
    file.add("/log", t_ns, t_ns, 0, json.dumps(said).encode())
    file.finish()
    return file.path
