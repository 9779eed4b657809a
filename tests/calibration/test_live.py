"""`ptzd calibrate fisheye --live` before a real MJPEG stream in which somebody holds a board."""

from __future__ import annotations

import asyncio

import cv2
import numpy as np
import pytest
import yaml

from ptzd.app.calibrate_live import record
from ptzd.app.calibrate_session import samples, tilted
from ptzd.calibration.guide import Action, Goal
from ptzd.calibration.lens import UNIFIED, WIDE_RAD
from ptzd.calibration.pictures import list_pictures
from ptzd.calibration.target import Target
from ptzd.errors import CalibrationError
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
