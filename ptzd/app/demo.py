"""`ptzd demo`: a simulated rig, the real daemon, boxes asked for over Zenoh, and the error against the truth."""

from __future__ import annotations

import asyncio
import json
import math
import sys
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import aiohttp
import numpy as np

from ptzd.app.loopback import reserved_port
from ptzd.bus.client import Client
from ptzd.bus.messages import RoiResult
from ptzd.control.wording import in_words
from ptzd.errors import PtzdError, SimulationError
from ptzd.evidence.sheet import write_sheet
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.sim.scene import load_scene

TOLERANCE_DEG = 0.5
"""Pointing error that the demo accepts; what it reaches is printed."""
START_S = 40.0
"""Simulator and daemon are up in seconds; a loaded machine may need longer to import."""
END_S = 10.0
REQUEST_S = 90.0
ANSWER_S = 20.0
"""For the daemon's answer to a question: it shares the processor with both cameras."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One box of the demo and how it ended."""

    name: str
    box: tuple[float, float, float, float]
    result: RoiResult
    error_deg: float | None
    elapsed_s: float

    @property
    def good(self) -> bool:
        """Locked within the tolerance."""
        return self.result.outcome == "locked" and self.error_deg is not None and self.error_deg <= TOLERANCE_DEG


@dataclass(frozen=True, slots=True, kw_only=True)
class Report:
    """What the demo leaves behind."""

    shots: tuple[Shot, ...]
    log: Path
    sheet: Path

    @property
    def good(self) -> bool:
        """All boxes locked within the tolerance."""
        return bool(self.shots) and all(shot.good for shot in self.shots)


async def run_demo(scene: str, out: Path, say: Callable[[str], None], *, boxes: int) -> Report:
    """Start everything, ask for the scene's boxes, stop everything, draw the sheet.

    Parameters
    ----------
    scene : str
        Name of a scene.
    out : Path
        Folder for settings, calibration, log and sheet.
    say : callable
        Takes lines for a person.
    boxes : int
        How many of the scene's boxes are asked for, one after the other.
    """
    wanted = load_scene(scene).demo_boxes[:boxes]
    with reserved_port() as port:
        endpoint = f"tcp/127.0.0.1:{port}"
        async with simulator(scene, out, endpoint) as ready:
            say(f"simulated AXIS camera at {ready['ptz_url']}, fisheye at {ready['fisheye_url']}")
            async with daemon(out / "ptzd.yaml"), Client.open(endpoint, rig="demo", timeout_s=ANSWER_S) as client:
                say(f"daemon serves rig demo at {endpoint}")
                shots = [
                    await shoot(client, str(ready["truth_url"]), item.name, (item.x, item.y, item.w, item.h), say)
                    for item in wanted
                ]
    log, sheet = _newest_log(out), out / "sheet.png"
    await asyncio.to_thread(write_sheet, log, sheet)
    return Report(shots=tuple(shots), log=log, sheet=sheet)


def _newest_log(out: Path) -> Path:
    return max((out / "log").glob("*.mcap"))


async def shoot(
    client: Client, truth_url: str, name: str, box: tuple[float, float, float, float], say: Callable[[str], None]
) -> Shot:
    """Ask for one box, tell its steps, hold the result against the truth."""
    started = time.monotonic()
    accepted = await client.request(box=box, id=name, label=name, hold_s=1.0, timeout_s=REQUEST_S)
    locked_s = [math.nan]

    async def follow() -> None:
        async for step in client.feedback(accepted.id):
            say(f"  {name}: {step.step} {in_words(step.detail)}")
            if step.step == "locked":
                locked_s[0] = time.monotonic() - started

    following = asyncio.create_task(follow())
    try:
        result = await client.result(accepted.id, timeout_s=REQUEST_S + 30)
        await following
    finally:
        following.cancel()
    elapsed_s = locked_s[0] if math.isfinite(locked_s[0]) else time.monotonic() - started
    error_deg = await _error_deg(truth_url, box, result)
    shown = "–" if error_deg is None else f"{error_deg:.3f}° off the truth"
    say(f"{name}: {result.outcome} after {elapsed_s:.1f} s, {shown}")
    return Shot(name=name, box=box, result=result, error_deg=error_deg, elapsed_s=elapsed_s)


async def _error_deg(truth_url: str, box: tuple[float, float, float, float], result: RoiResult) -> float | None:
    """Angle between the set point and the true direction of what the fisheye sees at the box's centre, deg."""
    if result.pan_deg is None or result.tilt_deg is None:
        return None
    where = {"x": str(box[0] + box[2] / 2), "y": str(box[1] + box[3] / 2)}
    async with (
        aiohttp.ClientSession() as session,
        session.get(f"{truth_url}/truth/direction", params=where) as reply,
    ):
        if reply.status != 200:
            raise SimulationError(f"the truth of {where} is not known: {(await reply.text()).strip()}")
        truth = await reply.json()
    true = bearing(np.radians(truth["pan_deg"]), np.radians(truth["tilt_deg"]))
    found = bearing(math.radians(result.pan_deg), math.radians(result.tilt_deg))
    return math.degrees(float(angle_between(true, found)))


@asynccontextmanager
async def simulator(scene: str, out: Path, endpoint: str) -> AsyncIterator[dict[str, object]]:
    """The simulated rig in a process of its own; yields what it says when it is ready."""
    ports = ("--port", "0", "--fisheye-port", "0", "--truth-port", "0")
    command = ("sim", "--scene", scene, *ports, "--write-config", str(out), "--bus", endpoint, "--json")
    async with _process(*command, what="simulator") as process:
        assert process.stdout is not None
        line = await asyncio.wait_for(process.stdout.readline(), START_S)
        if not line:
            raise SimulationError("the simulator ended before it was ready; run `ptzd sim` to see why")
        yield json.loads(line)


@asynccontextmanager
async def daemon(config: Path) -> AsyncIterator[asyncio.subprocess.Process]:
    """The daemon in a process of its own, once it serves requests."""
    async with _process("run", "--config", str(config), what="daemon") as process:
        assert process.stdout is not None
        if not await asyncio.wait_for(process.stdout.readline(), START_S):
            raise PtzdError(f"the daemon ended before it was ready; run `ptzd run --config {config}` to see why")
        yield process


@asynccontextmanager
async def _process(*arguments: str, what: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """One of our own commands as a child, ended by SIGTERM."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "ptzd", *arguments, stdout=asyncio.subprocess.PIPE
    )
    try:
        yield process
    finally:
        if process.returncode is None:
            process.terminate()
        try:
            await asyncio.wait_for(process.communicate(), END_S)
        except TimeoutError:
            process.kill()
            await process.communicate()
            raise PtzdError(f"the {what} did not end within {END_S:g} s of SIGTERM and was killed") from None
