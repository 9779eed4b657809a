"""A fisheye knocked by half a degree, seen by the daemon's own locks and put right: `python tests/bench/drift.py`.

A simulated rig whose rig.yaml is wrong by the knock, the real daemon on it with `drift.monitor` and `drift.refine` on,
one request after the other; then the angle across the arc between truth and calibration, before and after, the
decisions of all logs replayed, and the refinement undone.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import sys
import tempfile
from pathlib import Path

import msgspec
import numpy as np
import yaml

from ptzd.app.daemon import serve
from ptzd.app.loading import load
from ptzd.app.replaying import replay
from ptzd.app.simulate import DEFAULT_PASSWORD, RIG, write_config
from ptzd.bus.client import Client
from ptzd.calibrate.refined import refined_path, undo
from ptzd.calibrate.verify import across_rad
from ptzd.errors import PtzdError
from ptzd.geometry.rig import Rig
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import CalibrationError, SimSettings

KNOCK_DEG = (0.3, 0.2, -0.35)
ENDPOINT = "tcp/127.0.0.1:17493"


def across_deg(sim: SimRig, rig: Rig) -> np.ndarray:
    """Over the fisheye's picture, where the PTZ sees it too."""
    errors = []
    for x in range(60, 600, 30):
        for y in range(30, 460, 30):
            truth = sim.direction(x, y)
            if truth is not None and truth.visible and bool(rig.fisheye.lift(np.array([x, y]))[1]):
                errors.append(math.degrees(across_rad(rig, (x, y), msgspec.to_builtins(truth.vapix))))
    return np.array(errors)


async def ask(boxes: list, refined: Path) -> None:
    """One request after the other until the calibration was refined."""
    for number in range(4 * len(boxes)):
        box = boxes[number % len(boxes)]
        with contextlib.suppress(PtzdError, TimeoutError):
            async with asyncio.timeout(60), Client.open(ENDPOINT, rig=RIG) as client:
                await client.request(box=(box.x, box.y, box.w, box.h), id=f"r{number}", hold_s=0.0)
                result = await client.result(f"r{number}")
                print(f"{box.name:16} {result.outcome}", flush=True)
        if await asyncio.to_thread(refined.is_file):
            return
        await asyncio.sleep(0.2)


async def main() -> int:
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    error = CalibrationError(rotation_deg=KNOCK_DEG, sigma_rotation_deg=0.1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        async with SimRig(SimSettings(calibration=error)) as sim:
            config = write_config(sim, folder, bus=ENDPOINT, password=DEFAULT_PASSWORD)
            document = yaml.safe_load(config.read_text())
            document["drift"] = {"monitor": True, "refine": True}
            config.write_text(yaml.safe_dump(document))
            before, stop, ready = load(config), asyncio.Event(), asyncio.Event()
            daemon = asyncio.create_task(serve(before, stop, ready=ready.set))
            await ready.wait()
            ready.clear()
            refined = refined_path(before.config)
            await ask([*sim.scene.demo_boxes, *sim.scene.regions], refined)
            if refined.is_file():
                await asyncio.wait_for(ready.wait(), 60)
            stop.set()
            await daemon
            after = load(config)
            for label, loaded in (("before", before), ("after", after)):
                errors = across_deg(sim, loaded.rig)
                print(f"across the arc {label}: median {np.median(errors):.3f}°, 95 % {np.percentile(errors, 95):.3f}°")
        same = [not replay(path).differences for path in sorted((folder / "log").glob("*.mcap"))]
        print(f"replays without difference: {sum(same)} of {len(same)} logs")
        if refined.is_file():
            undo(after.config)
        print(f"undone: {load(config).calibration_text == before.calibration_text}")
        good = all(same) and after.calibration_text != before.calibration_text
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(asyncio.run(main()))
