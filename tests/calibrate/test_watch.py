"""The drift monitor in service: a fisheye that was knocked is told from locks, R is turned back, and back again."""

from __future__ import annotations

import asyncio
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from ptzd.app.loading import load
from ptzd.calibrate.refined import in_force, refined_path, undo
from ptzd.calibrate.watch import DriftWatch
from ptzd.calibration.file import dump_rig, read_rig
from ptzd.cli import entry
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Uncertainty
from ptzd.geometry.sphere import angle_between, normalise, pan_tilt, rotation_from_rotvec
from ptzd.model import Box, Outcome

CALIBRATION = (Path(__file__).parents[2] / "config" / "rig.example.yaml").read_text()
KNOCK = rotation_from_rotvec(np.radians([0.3, 0.2, -0.35]))
"""Half a degree."""


class Log:
    def __init__(self):
        self.documents = []

    def document(self, topic, t_ns, document):
        self.documents.append((topic, document))


def settings(tmp_path, **drift):
    known = Uncertainty(rotation_rad=math.radians(0.06), translation=0.002, head_rad=math.radians(0.02))
    rig = dataclasses.replace(read_rig(CALIBRATION, "example"), uncertainty=known)
    (tmp_path / "rig.yaml").write_text(dump_rig(rig, {"by": "hand"}))
    (tmp_path / "secret").write_text("swordfish\n")
    document = {
        "rig": "hall", "calibration": "rig.yaml", "fisheye": {"source": "files", "path": "."},
        "ptz": {"url": "http://127.0.0.1:9", "user": "ptzd", "password_file": "secret"},
        "log": {"directory": "log"}, "drift": drift,
    }  # fmt: skip
    (tmp_path / "log").mkdir(exist_ok=True)
    (tmp_path / "ptzd.yaml").write_text(yaml.safe_dump(document))
    return tmp_path / "ptzd.yaml"


def knocked(rig):
    """What is true after the knock."""
    return dataclasses.replace(rig, head_from_fisheye_rotation=KNOCK @ rig.head_from_fisheye_rotation)


def request(number, rig, pixel, range_m):
    """The events and commands of a request that found its target where it truly is."""
    ray, valid = rig.fisheye.lift(pixel)
    assert valid
    towards = normalise(rig.head_from_fisheye_rotation @ ray + rig.head_from_fisheye_translation / range_m)
    pan, tilt = (float(np.degrees(angle)) for angle in pan_tilt(towards))
    box = Box(x=pixel[0] - 15.0, y=pixel[1] - 15.0, w=30.0, h=30.0)
    asked = ev.RequestReceived(token=None, id=f"{number}", box=box)
    result = cmd.PublishResult(
        id=f"{number}", outcome=Outcome.LOCKED, reason="held as asked", label="", elapsed_ms=1, views=1,
        pan_deg=pan, tilt_deg=tilt, range_m=range_m,
    )  # fmt: skip
    return asked, result


def shown(watch, truth, count=20, *, moved=False):
    rng = np.random.default_rng(7)
    width, height = truth.fisheye.size_px
    for number in range(count):
        angle, reach = rng.uniform(0.0, 6.28), 0.4 * height * np.sqrt(rng.random())
        pixel = np.array([width / 2 + reach * np.cos(angle), height / 2 + reach * np.sin(angle)])
        asked, result = request(number, truth, pixel, float(rng.uniform(2.0, 8.0)))
        watch.seen(2 * number, asked, [])
        if moved:
            watch.seen(2 * number, ev.UpdateReceived(id=asked.id, box=asked.box), [])
        watch.seen(2 * number + 1, ev.DeadlinePassed(), [result])


def watching(loaded, log, renew, *, idle=True):
    return DriftWatch(loaded.rig, loaded.config, loaded.calibration_text, log, idle=lambda: idle, renew=renew)


async def test_a_knocked_fisheye_is_told_refined_and_taken_back(tmp_path, capsys):
    config = settings(tmp_path, monitor=True, refine=True)
    loaded, log, renewed = load(config), Log(), asyncio.Event()
    truth = knocked(loaded.rig)
    watch = watching(loaded, log, renewed.set)
    shown(watch, truth)
    assert log.documents[-1][1]["drifted"]
    running = asyncio.create_task(watch.run())
    async with asyncio.timeout(60):
        await renewed.wait()
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)

    again = load(config)
    carried = [rig.head_from_fisheye_rotation for rig in (truth, loaded.rig, again.rig)]
    rays = normalise(np.random.default_rng(1).normal([0.0, 0.0, 2.0], 1.0, (50, 3)))
    before, after = (angle_between(rays @ carried[0].T, rays @ one.T) for one in carried[1:])
    assert np.degrees(np.median(before)) > 0.3
    assert np.degrees(np.median(after)) < 0.15
    assert (tmp_path / "rig.yaml").read_text() != again.calibration_text

    assert entry(["calibrate", "drift", "--undo", "--config", str(config)]) == 0
    assert "taken back" in capsys.readouterr().out
    assert load(config).calibration_text == loaded.calibration_text
    with pytest.raises(CalibrationError, match="no refined calibration"):
        undo(loaded.config)


@pytest.mark.parametrize("drift", [{}, {"monitor": True}], ids=["off", "monitor"])
def test_a_refined_file_counts_only_when_asked_for(tmp_path, drift):
    loaded = load(settings(tmp_path, **drift))
    refined_path(loaded.config).write_text("anything")
    assert in_force(loaded.config, loaded.calibration_text) == loaded.calibration_text


def test_a_new_calibration_ends_the_refined_one(tmp_path):
    loaded = load(settings(tmp_path, monitor=True, refine=True))
    refined_path(loaded.config).write_text(dump_rig(loaded.rig, {"refined_from_sha256": "of another"}))
    assert in_force(loaded.config, loaded.calibration_text) == loaded.calibration_text


async def test_targets_that_moved_say_nothing(tmp_path):
    loaded, log = load(settings(tmp_path, monitor=True)), Log()
    shown(watching(loaded, log, lambda: None), knocked(loaded.rig), moved=True)
    assert log.documents == []


async def test_a_good_calibration_stays(tmp_path):
    loaded, log = load(settings(tmp_path, monitor=True)), Log()
    shown(watching(loaded, log, lambda: None), loaded.rig)
    assert not any(document["drifted"] for _, document in log.documents)
