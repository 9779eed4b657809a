"""Small makers that the tests of the log share."""

import itertools
import threading
import time

import numpy as np
import pytest

from ptzd.config import LogSettings
from ptzd.control.events import FrameArrived, Snapshot
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.log.run import RunInfo
from ptzd.model import FrameRef
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
def picture():
    """Maker of pictures with bytes that tell them apart."""

    def make(seq, size=2000, t_ns=None):
        t_ns = START_NS + seq * 33_000_000 if t_ns is None else t_ns
        jpeg = b"\xff\xd8" + seq.to_bytes(4, "big") * (size // 4) + b"\xff\xd9"
        return Picture(frame=FrameRef(seq=seq, t_capture_ns=t_ns), t_arrival_ns=t_ns + 5_000_000, jpeg=jpeg)

    return make


@pytest.fixture
def frames():
    """Endless FrameArrived events."""
    return (
        FrameArrived(
            t_ns=START_NS + seq * 33_000_000, frame=FrameRef(seq=seq, t_capture_ns=START_NS + seq * 33_000_000)
        )
        for seq in itertools.count()
    )


@pytest.fixture
def snapshot():
    return Snapshot(t_ns=START_NS, state={"phase": "parked", "far": float("inf")})


@pytest.fixture(autouse=True)
def no_thread_stays():
    before = set(threading.enumerate())
    yield
    left = [thread for thread in set(threading.enumerate()) - before if thread.name == "ptzd-log"]
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
