"""A world of fakes behind the ports: each records what it was told, in one common order."""

from __future__ import annotations

import asyncio
import math
from collections.abc import AsyncIterator, Callable

import cv2
import numpy as np
import pytest

from ptzd.config import Config, FilesSource, Ptz
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import DeviceError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import FrameRef, HeadLimits, HeadReading, MatchResult, Motion, ViewRef
from ptzd.outgoing import ImageAttachment, Pose
from ptzd.ports import HeadPoll, Picture

HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
LIMITS = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))


class Clock:
    """Stands still until it is moved."""

    def __init__(self) -> None:
        self.t_ns = 1_000_000_000_000

    def now_ns(self) -> int:
        return self.t_ns

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


class Log:
    """An event log in memory."""

    def __init__(self, story: list[tuple[str, object]]) -> None:
        self.story = story
        self.pictures: list[tuple[str, Picture]] = []
        self.documents: list[tuple[str, dict[str, object]]] = []
        self.cuts: list[tuple[int, ev.Snapshot]] = []
        self.sequences: list[int] = []
        self.stamps: list[int] = []
        self.due = False

    def event(self, sequence: int, t_ns: int, event: ev.Event) -> None:
        self.story.append(("event", event))
        self.sequences.append(sequence)
        self.stamps.append(t_ns)

    def command(self, sequence: int, t_ns: int, command: cmd.Command) -> None:
        assert (sequence, t_ns) == (self.sequences[-1], self.stamps[-1])
        self.story.append(("command", command))

    def picture(self, topic: str, picture: Picture) -> None:
        self.pictures.append((topic, picture))

    def rotate_due(self) -> bool:
        return self.due

    def rotate(self, sequence: int, t_ns: int, snapshot: ev.Snapshot) -> None:
        self.due = False
        self.cuts.append((sequence, snapshot))
        self.story.append(("cut", snapshot))

    def document(self, topic: str, t_ns: int, document: dict[str, object]) -> None:
        self.documents.append((topic, document))


class Bus:
    """Performs by remembering; what comes in is put by the test."""

    def __init__(self, story: list[tuple[str, object]]) -> None:
        self.story = story
        self.incoming: asyncio.Queue[ev.Event | BaseException] = asyncio.Queue()
        self.poses: list[Pose] = []
        self.images: list[tuple[str, bytes, ImageAttachment]] = []
        self.wanted: set[str] = set()

    async def events(self) -> AsyncIterator[ev.Event]:
        while True:
            event = await self.incoming.get()
            if isinstance(event, BaseException):
                raise event
            yield event

    def perform(self, command: cmd.Command) -> None:
        self.story.append(("performed", command))

    def publish_pose(self, pose: Pose) -> None:
        self.poses.append(pose)

    def publish_image(self, key: str, jpeg: bytes, attachment: ImageAttachment) -> None:
        self.images.append((key, jpeg, attachment))

    def image_wanted(self, key: str) -> bool:
        return key in self.wanted


class Feed:
    """An endless series that the test feeds; an error ends one iteration, as a lost device does."""

    def __init__(self) -> None:
        self.items: asyncio.Queue[object] = asyncio.Queue()

    async def listen(self) -> AsyncIterator[object]:
        while True:
            item = await self.items.get()
            if isinstance(item, BaseException):
                raise item
            yield item

    def put(self, item: object) -> None:
        self.items.put_nowait(item)


class Fisheye(Feed):
    def pictures(self) -> AsyncIterator[Picture]:
        return self.listen()  # type: ignore[return-value]  # the test puts pictures in


class Head:
    """Does what the test says: ``refuse`` is raised by every method, ``gate`` holds moves and grabs back."""

    def __init__(self) -> None:
        self.refuse: DeviceError | None = None
        self.error: Exception | None = None
        self.gate = asyncio.Event()
        self.gate.set()
        self.calls: list[str] = []
        self.polled, self.seen = Feed(), Feed()
        self.picture: Picture | None = None

    def _check(self, name: str) -> None:
        self.calls.append(name)
        if self.refuse is not None:
            raise self.refuse

    async def describe(self) -> HeadLimits:
        self._check("describe")
        return LIMITS

    async def move(self, target: HeadReading) -> HeadReading:
        self._check("move")
        await self.gate.wait()
        if self.error is not None:
            raise self.error
        return target

    async def stop(self) -> None:
        self._check("stop")

    async def grab(self, not_before_ns: int) -> tuple[Picture, ViewRef]:
        self._check("grab")
        await self.gate.wait()
        assert self.picture is not None
        return self.picture, ViewRef(frame=self.picture.frame, reading=HOME, sigma_deg=0.01)

    def polls(self) -> AsyncIterator[HeadPoll]:
        return self.polled.listen()  # type: ignore[return-value]  # the test puts polls in

    def pictures(self) -> AsyncIterator[tuple[Picture, HeadReading, Motion]]:
        return self.seen.listen()  # type: ignore[return-value]  # the test puts pictures in


class Perception:
    def __init__(self) -> None:
        self.error: Exception | None = None
        self.jobs: list[tuple[bytes, bytes]] = []
        self.gate = asyncio.Event()
        self.gate.set()

    async def match(self, job: cmd.RunMatch, fisheye_jpeg: bytes, view_jpeg: bytes) -> MatchResult:
        self.jobs.append((fisheye_jpeg, view_jpeg))
        await self.gate.wait()
        if self.error is not None:
            raise self.error
        return MatchResult(matcher=job.matcher, texture=9.0, candidates=(), coverage=(0.0, 1.0), seed=1, elapsed_ms=1.0)


@pytest.fixture
def story() -> list[tuple[str, object]]:
    """Everything logged and performed, in order."""
    return []


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def log(story: list[tuple[str, object]]) -> Log:
    return Log(story)


@pytest.fixture
async def bus(story: list[tuple[str, object]]) -> Bus:
    return Bus(story)


@pytest.fixture
async def fisheye() -> Fisheye:
    return Fisheye()


@pytest.fixture
async def head() -> Head:
    return Head()


@pytest.fixture
async def perception() -> Perception:
    return Perception()


@pytest.fixture(scope="session")
def rig() -> Rig:
    fisheye = UnifiedCamera(
        size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=1.2, max_angle_rad=math.radians(92)
    )
    entries = tuple(ZoomEntry(zoom=zoom, fx=fx, fy=fx, cx=319.5, cy=239.5) for zoom, fx in ((1, 554), (9999, 9000)))
    return Rig(
        fisheye=fisheye,
        zoom=ZoomTable(size_px=(640, 480), entries=entries),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=np.eye(3),
        head_from_fisheye_translation=np.array([-0.5, -0.1, -0.05]),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=0.002, translation=0.002, head_rad=0.0005),
    )


@pytest.fixture(scope="session")
def config() -> Config:
    return Config(
        rig="test",
        calibration="rig.yaml",
        fisheye=FilesSource(path="pictures"),
        ptz=Ptz(url="http://127.0.0.1:9", user="operator"),
    )


@pytest.fixture(scope="session")
def jpeg() -> Callable[[int, int], bytes]:
    def make(width: int = 640, height: int = 480) -> bytes:
        pixels = np.random.default_rng(1).integers(0, 255, (height, width), np.uint8)
        return cv2.imencode(".jpg", pixels)[1].tobytes()

    return make


@pytest.fixture
def picture(jpeg: Callable[..., bytes], clock: Clock) -> Callable[..., Picture]:
    def make(seq: int = 0, *, width: int = 640, height: int = 480, lost_before: int = 0) -> Picture:
        frame = FrameRef(seq=seq, t_capture_ns=clock.t_ns + seq)
        return Picture(frame=frame, t_arrival_ns=clock.t_ns + seq, jpeg=jpeg(width, height), lost_before=lost_before)

    return make


@pytest.fixture
def poll(clock: Clock) -> Callable[..., HeadPoll]:
    def make(pan_deg: float = 0.0, *, motion: Motion = Motion.STABLE, foreign: bool = False) -> HeadPoll:
        reading = HeadReading(pan_deg=pan_deg, tilt_deg=0.0, zoom=1.0)
        return HeadPoll(reading=reading, t_ns=clock.t_ns, motion=motion, foreign=foreign)

    return make


@pytest.fixture
def settled() -> Callable[[], object]:
    """Lets every task run until nothing more happens by itself."""

    async def wait(turns: int = 50) -> None:
        for _ in range(turns):
            await asyncio.sleep(0)

    return wait
