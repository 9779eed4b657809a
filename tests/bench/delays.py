"""How well the delay between pictures and position reports is measured, and what the pose of a picture is worth.

python -m tests.bench.delays [--profile P] [--latency 0.15]

Client and simulator live on one virtual clock. Exit status 1 when a picture at rest has another pose than its sigma
allows, or a delay is measured wrongly by more than half the period of the reports.
"""

from __future__ import annotations

import argparse
import asyncio
import hashlib
import math
import sys
import tempfile
from dataclasses import dataclass

import numpy as np

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.poses import SIGMA_FLOOR_DEG
from ptzd.devices.vapix.timing import Timing, measure_timing
from ptzd.model import HeadReading, Motion
from ptzd.sim.camera import AxisCamera
from ptzd.sim.profile import PROFILES, profile
from ptzd.sim.rig_truth import head_model
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.settings import SimSettings
from tests.bench.virtual import LoopClock, VirtualLoop

START = HeadReading(pan_deg=5.0, tilt_deg=5.0, zoom=1.0)
FAR = HeadReading(pan_deg=45.0, tilt_deg=5.0, zoom=1.0)
AFTER_S = 1.5
"""Pictures are followed so long after a move."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Delay:
    """One camera."""

    camera: str
    true_s: float
    """Age of a picture on arrival less the mean age of a report."""
    measured: Timing
    at_rest_deg: list[float]
    """Pose errors in pan of pictures called stable, against the optics at the exposure."""
    moving_s: list[float]
    """Pose errors of pictures in motion, as time: error over speed."""


async def measured_delay(name: str, latency_s: float, scene: Scene) -> Delay:
    """Measure the delay of one camera, then use it."""
    clock, kind = LoopClock(asyncio.get_running_loop()), profile(name)
    settings = SimSettings(profile=name, image_latency_s=latency_s)
    camera = AxisCamera(settings, scene, head_model(kind.mount, kind), clock)
    with tempfile.NamedTemporaryFile("w", suffix=".password") as file:
        file.write(settings.password)
        file.flush()
        async with camera:
            ptz = Ptz(
                url=camera.url, user=settings.user, password_file=file.name, size_px=(320, 240), fps=25.0, poll_hz=25.0,
                report_lag_s=kind.timing.report_lag_s + kind.timing.report_refresh_s / 2,
            )  # fmt: skip
            async with VapixHead(ptz, Limits(), clock, jitter=lambda: 0.5) as head:
                await head.describe()
                found = await measure_timing(head, START)
            ptz = replace_latency(ptz, ptz.report_lag_s + found.offset_s)
            async with VapixHead(ptz, Limits(), clock, jitter=lambda: 0.5) as head:
                await head.describe()
                rest, moving = await _followed(head, camera)
    return Delay(camera=name, true_s=latency_s - ptz.report_lag_s, measured=found, at_rest_deg=rest, moving_s=moving)


def replace_latency(ptz: Ptz, latency_s: float) -> Ptz:
    """The same camera with the delay that was measured."""
    return Ptz(**{name: getattr(ptz, name) for name in ptz.__struct_fields__} | {"image_latency_s": latency_s})


async def _followed(head: VapixHead, camera: AxisCamera) -> tuple[list[float], list[float]]:
    """Pose errors of the pictures of two large moves."""
    rest, moving = [], []

    async def follow() -> None:
        async for picture, reading, motion in head.pictures():
            shot = camera.shots.find(hashlib.sha256(picture.jpeg).hexdigest())
            if shot is None or shot.pose is None:
                continue
            error = abs(math.remainder(reading.pan_deg - shot.pose.pan_deg, 360.0))
            speed = abs(camera.unit.head.axes["pan"].velocity(shot.t_s))
            if motion is Motion.STABLE:
                rest.append(error)
            elif speed > 10:
                moving.append(error / speed)

    following = asyncio.create_task(follow())
    for target in (FAR, START):
        await head.move(target)
        await asyncio.sleep(AFTER_S)
    following.cancel()
    await asyncio.gather(following, return_exceptions=True)
    return rest, moving


def broken(one: Delay) -> list[str]:
    """What does not hold for one camera."""
    lines = []
    period_s = profile(one.camera).timing.report_refresh_s
    if abs(one.measured.offset_s - one.true_s) > period_s / 2:
        lines.append(f"{one.camera}: measured {one.measured.offset_s:.3f} s, the truth is {one.true_s:.3f} s")
    if max(one.at_rest_deg) > SIGMA_FLOOR_DEG:
        lines.append(f"{one.camera}: the pose of a picture at rest is {max(one.at_rest_deg):.4f}° off")
    return lines


def table(found: list[Delay]) -> str:
    """Markdown: one line per camera and latency."""
    lines = [
        "| camera | delay of pictures against reports, ms | measured − true, ms (stated sigma) "
        "| pose of a picture at rest, worst error, ° | in motion, error ÷ speed, ms: median / 95 % |",
        "|---|---|---|---|---|",
    ]
    for one in found:
        error_ms = 1000 * (one.measured.offset_s - one.true_s)
        median, most = (1000 * value for value in np.percentile(one.moving_s, (50, 95)))
        lines.append(
            f"| {one.camera} | {1000 * one.true_s:+.0f} | {error_ms:+.0f} ({1000 * one.measured.sigma_s:.0f}) "
            f"| {max(one.at_rest_deg):.4f} | {median:.0f} / {most:.0f} |"
        )
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--profile", choices=sorted(PROFILES), action="append")
    parser.add_argument("--latency", type=float, action="append", help="of the stream, s")
    arguments = parser.parse_args()
    scene, found = load_scene("room"), []
    for name in arguments.profile or PROFILES:
        for latency_s in arguments.latency or (0.05, 0.15, 0.30):
            with asyncio.Runner(loop_factory=VirtualLoop) as runner:
                found.append(runner.run(measured_delay(name, latency_s, scene)))
    print(table(found))
    wrong = [line for one in found for line in broken(one)]
    print("\n".join(wrong), file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
