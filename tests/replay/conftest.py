"""Logs of lives in virtual time, written as the daemon writes them, falsified or not."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import ModuleType

import cv2
import msgspec
import pytest
import yaml

from ptzd.app.fingerprint import fingerprint, versions
from ptzd.calibration.file import read_rig
from ptzd.config import Config, FilesSource, LogSettings, Ptz
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.geometry.rig import Rig
from ptzd.log.run_info import RunInfo
from ptzd.log.writer import McapLog
from ptzd.model import FrameRef
from ptzd.ports import Picture

CONTROL = Path(__file__).parents[1] / "control" / "conftest.py"
CALIBRATION = Path(__file__).parents[2] / "config" / "rig.example.yaml"

Step = tuple[int, ev.Event, list[cmd.Command]]
Falsify = Callable[[list[Step]], list[Step]]


class Clock:
    def now_ns(self) -> int:
        return time.time_ns()

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


@pytest.fixture(scope="session")
def virtual() -> ModuleType:
    """The world in virtual time that tests of the core use."""
    spec = importlib.util.spec_from_file_location("virtual_world", CONTROL)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def calibration_text() -> str:
    return CALIBRATION.read_text()


@pytest.fixture(scope="session")
def rig(calibration_text: str) -> Rig:
    return read_rig(calibration_text, "rig.yaml")


@pytest.fixture(scope="session")
def config() -> Config:
    return Config(
        rig="test",
        calibration="rig.yaml",
        fisheye=FilesSource(path="pictures"),
        ptz=Ptz(url="http://127.0.0.1:9", user="operator"),
    )


@pytest.fixture(scope="session")
def steps(virtual: ModuleType, rig: Rig, config: Config) -> list[Step]:
    """A lock, a refusal, a pre-emption, a loss and a recovery."""
    world = virtual.World(rig, config)
    world.start()
    world.request("first", hold_s=1.0)
    world.run(until=State.IDLE)
    world.frame(1)
    world.request("refused", token=2, frame_seq=77)
    world.request("slow", token=3, hold_s=50.0)
    world.run(until=State.LOCK)
    world.frame(2)
    world.request("urgent", token=4, priority=5, hold_s=50.0)
    world.run(1.0)
    world.tell(ev.DeviceLost(device=ev.Device.FISHEYE, reason="unplugged"))
    world.tell(ev.DeviceWell(device=ev.Device.FISHEYE))
    world.run(30.0)
    machine = Machine(rig, config)
    told = zip(world.told_ns, world.told, strict=True)
    return [(t_ns, event, machine.handle(event, t_ns)) for t_ns, event in told]


@pytest.fixture
def record(
    rig: Rig, config: Config, calibration_text: str, steps: list[Step], tmp_path: Path
) -> Callable[..., Awaitable[Path]]:
    """Writes the steps, falsified or not, as a log; the path of the file."""

    async def write(falsify: Falsify = list, *, folder: str = "log", foreign: bool = False) -> Path:
        cv2.setNumThreads(1)  # as the daemon does: with another number the log would be another machine's
        run = RunInfo(
            rig="test",
            config_text=yaml.safe_dump(msgspec.to_builtins(config)),
            calibration_text=calibration_text,
            versions=versions(),
            fingerprint={"cpu": "another"} if foreign else fingerprint(),
        )
        directory = tmp_path / folder
        settings = LogSettings(directory=str(directory), min_free_bytes=0)
        async with McapLog(settings, run, Clock()) as log:
            log.rotate(1, steps[0][0], Machine(rig, config).snapshot())
            for number, (t_ns, event, commands) in enumerate(falsify(list(steps)), 2):
                if isinstance(event, ev.FrameArrived):
                    log.picture("/fisheye/image", picture(event.frame))
                if isinstance(event, ev.ViewTaken):
                    log.picture("/ptz/image", picture(event.view.frame))
                log.event(number, t_ns, event)
                for command in commands:
                    log.command(number, t_ns, command)
        (path,) = directory.glob("*.mcap")
        return path

    return write


def picture(frame: FrameRef) -> Picture:
    return Picture(
        frame=frame, t_arrival_ns=frame.t_capture_ns, jpeg=b"\xff\xd8" + bytes([frame.seq % 256]) + b"\xff\xd9"
    )
