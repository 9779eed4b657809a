"""`ptzd calibrate --live`: before a real MJPEG stream in which somebody holds a board, and before a PTZ's zooms."""

from __future__ import annotations

import asyncio

import cv2
import numpy as np
import pytest
import yaml

from ptzd.app.capturing import record
from ptzd.calibrate.live import zoom_pictures
from ptzd.calibrate.parts import zoom_from_boards, zoom_of
from ptzd.calibrate.studio import samples, tilted
from ptzd.calibration.guide import Action, Goal
from ptzd.calibration.lens import PERSPECTIVE, UNIFIED, WIDE_RAD
from ptzd.calibration.pictures import list_pictures
from ptzd.calibration.target import Target
from ptzd.errors import CalibrationError
from ptzd.model import FrameRef, HeadLimits, HeadReading, ViewRef
from ptzd.ports import Picture
from ptzd.runtime.clock import SteadyClock
from ptzd.sim.clock import WallClock
from ptzd.sim.fisheye import FisheyeCamera
from ptzd.sim.imager import encode
from ptzd.sim.settings import SimSettings

TARGET = Target(columns=8, rows=6, pitch_m=0.03)
LENS = UNIFIED.camera(np.array([180.0, 180.0, 159.5, 119.5, 1.0, 0.0, 0.0, 0.0, 0.0]), (320, 240), WIDE_RAD)
GOAL = Goal(pictures=4, covered=0.3)


class Person(FisheyeCamera):
    """Holds a board, and holds it elsewhere when told that a picture was taken or adds nothing."""

    def __init__(self) -> None:
        rng, (rays, _) = np.random.default_rng(4), samples(LENS)
        self.poses = []
        for index in range(10):
            angle, turn = 0.85 * np.sqrt(index / 9), 2.4 * index
            direction = np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
            grey = tilted(rng, TARGET, direction, 0.3).over(np.full((240, 320), 120, np.uint8), rays)
            self.poses.append(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
        self.held, self.carried = 0, 2
        settings = SimSettings(fisheye_noise_sigma=0.0, fisheye_fps=20.0)
        super().__init__(settings, lambda: self.poses[0], LENS, WallClock())

    def _jpeg(self) -> bytes:
        self.carried = max(self.carried - 1, 0)
        empty = np.full((240, 320, 3), 120, np.uint8)
        return encode(empty if self.carried else self.poses[self.held % len(self.poses)], 95)

    def hear(self, advice) -> None:
        if advice.action in (Action.TAKE, Action.KNOWN):
            self.held, self.carried = self.held + 1, 3


def write_settings(folder, url):
    document = {
        "rig": "hall", "calibration": "rig.yaml", "fisheye": {"source": "http", "url": url},
        "ptz": {"url": "http://127.0.0.1:9", "user": "ptzd", "password_file": "secret"},
    }  # fmt: skip
    path = folder / "ptzd.yaml"
    path.write_text(yaml.safe_dump(document))
    return path


async def test_pictures_are_taken_as_the_board_moves_and_a_later_run_uses_them(tmp_path):
    told = []
    async with Person() as person:
        config = write_settings(tmp_path, person.url)

        def show(advice):
            told.append(advice)
            person.hear(advice)

        async with asyncio.timeout(120):
            folder = await record(config, TARGET, tmp_path / "boards", GOAL, show)
            taken = list_pictures(folder)
            count = len(told)
            await record(config, TARGET, folder, GOAL, show)
    assert sum(advice.action is Action.TAKE for advice in told) == len(taken) >= GOAL.pictures
    assert {Action.MOVING, Action.TAKE} <= {advice.action for advice in told}
    assert [advice.action for advice in told[count:]] == [Action.ENOUGH]
    assert list_pictures(folder) == taken
    assert told[-1].covered >= GOAL.covered
    assert all(cv2.imread(str(path)).shape == (240, 320, 3) for path in taken)


async def test_pictures_of_another_size_in_the_folder_are_named(tmp_path):
    (tmp_path / "boards").mkdir()
    cv2.imwrite(str(tmp_path / "boards" / "1.jpg"), np.zeros((100, 100), np.uint8))
    async with Person() as person:
        config = write_settings(tmp_path, person.url)
        async with asyncio.timeout(60):
            with pytest.raises(CalibrationError, match=r"1\.jpg: not a picture of 320×240 px"):
                await record(config, TARGET, tmp_path / "boards", GOAL, person.hear)


async def test_a_folder_of_pictures_is_found_from_where_the_settings_are(tmp_path):
    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures" / "1.jpg"), np.full((240, 320), 120, np.uint8))
    config = write_settings(tmp_path, "http://127.0.0.1:9")
    document = yaml.safe_load(config.read_text())
    config.write_text(yaml.safe_dump({**document, "fisheye": {"source": "files", "path": "pictures"}}))
    told = asyncio.get_running_loop().create_future()

    def hear(advice):
        if not told.done():
            told.set_result(advice)

    watching = asyncio.create_task(record(config, TARGET, tmp_path / "boards", GOAL, hear))
    async with asyncio.timeout(20):
        advice = await told
    watching.cancel()
    await asyncio.wait([watching])
    assert advice.action is Action.NO_BOARD
    assert "no picture" not in advice.text


class Head:
    """A PTZ at rest before which somebody moves a board whenever a picture was taken; a picture every 0.3 s."""

    def __init__(self) -> None:
        self.reading, self.now_ns, self.held = HeadReading(pan_deg=12.0, tilt_deg=-3.0, zoom=1.0), 0, 0
        self.drawn: dict[tuple[float, int], bytes] = {}

    async def describe(self):
        return HeadLimits(pan_deg=(-170.0, 170.0), tilt_deg=(-20.0, 90.0), zoom=(1.0, 9999.0))

    async def move(self, target):
        self.reading, self.held = target, 0
        return target

    async def grab(self, not_before_ns):
        self.now_ns += 300_000_000
        frame = FrameRef(seq=self.now_ns, t_capture_ns=self.now_ns)
        picture = Picture(frame=frame, t_arrival_ns=self.now_ns, jpeg=self._jpeg())
        return picture, ViewRef(frame=frame, reading=self.reading, sigma_deg=0.01)

    def _jpeg(self):
        focal = 320.0 * self.reading.zoom
        key = (focal, self.held % 12)
        if key not in self.drawn:
            camera = PERSPECTIVE.camera(np.array([focal, focal, 160.0, 118.0, 0, 0, 0, 0, 0]), (320, 240), WIDE_RAD)
            rng, rays = np.random.default_rng(key[1]), samples(camera)[0]
            x, y = (key[1] % 4 - 1.5) * 0.13, (key[1] // 4 - 1.0) * 0.12
            board = tilted(rng, TARGET, np.array([x * 320 / focal, y * 320 / focal, 1.0]), 0.75 * focal / 320.0)
            grey = board.over(np.full((240, 320), 120, np.uint8), rays)
            self.drawn[key] = encode(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), 95)
        return self.drawn[key]

    def hear(self, advice) -> None:
        self.held += advice.action in (Action.TAKE, Action.KNOWN)


async def test_the_camera_is_driven_through_the_zooms_and_its_lens_comes_out(tmp_path):
    head = Head()
    goal = Goal(pictures=8, covered=0.4)
    zooms = (1.0, 1.5, 2.0, 2.5, 3.0, 20000.0)
    async with asyncio.timeout(240):
        shots = await zoom_pictures(head, SteadyClock(), TARGET, tmp_path, zooms, goal, head.hear)
    outcome = await asyncio.to_thread(zoom_from_boards, shots, TARGET, tmp_path, lambda text: None)
    assert len(outcome.document["zooms"]) == 5
    table = zoom_of(tmp_path)
    for zoom in (1.0, 1.7, 3.0):
        assert table.camera_at(zoom).fx == pytest.approx(320.0 * zoom, rel=0.02)
