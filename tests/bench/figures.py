"""Rough figures of one machine, measured: prints them and, with --write, puts them into README and docs/figures.json.

python -m tests.bench.figures [--write]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import platform
import statistics
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

from ptzd.app import demo
from ptzd.app.loopback import reserved_port
from ptzd.bus.client import Client
from ptzd.calibration.file import read_rig
from ptzd.control import commands as cmd
from ptzd.jpeg.pixels import decode_grey
from ptzd.log.reader import LoggedCommand, LogReader
from ptzd.matching.inputs import MatchInputs
from ptzd.matching.job import match
from ptzd.model import Matcher
from ptzd.sim.scene import load_scene
from tests.bench import seconds

README = Path("README.md")
BEGIN, END = "<!-- figures -->", "<!-- /figures -->"
IDLE_S = 10.0
REPEATS = 5


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, s (user and system)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def rig_figures(scene: str, out: Path) -> dict[str, float]:
    """Run the demo's parts with a stopwatch on the daemon's process."""
    boxes = load_scene(scene).demo_boxes
    with reserved_port() as port:
        endpoint = f"tcp/127.0.0.1:{port}"
        async with (
            demo.simulator(scene, out, endpoint) as ready,
            demo.daemon(out / "ptzd.yaml") as process,
            Client.open(endpoint, rig="demo") as client,
        ):
            idle = await share(process.pid, asyncio.sleep(IDLE_S))
            shots: list[demo.Shot] = []

            async def scan() -> None:
                for item in boxes:
                    box = (item.x, item.y, item.w, item.h)
                    shots.append(await demo.shoot(client, str(ready["truth_url"]), item.name, box, lambda line: None))

            busy = await share(process.pid, scan())
            memory = resident_mb(process.pid)
    errors = [shot.error_deg for shot in shots if shot.error_deg is not None]
    return {
        "cpu_idle_percent": 100 * idle,
        "cpu_scanning_percent": 100 * busy,
        "resident_mb": memory,
        "requests": len(shots),
        "locked": sum(shot.result.outcome == "locked" for shot in shots),
        "seconds_to_lock_median": statistics.median(shot.elapsed_s for shot in shots),
        "error_deg_median": statistics.median(errors),
        "error_deg_worst": max(errors),
    }


async def share(pid: int, work: object) -> float:
    """Share of one core that the process took while ``work`` ran."""
    before, start = cpu_s(pid), time.monotonic()
    await work
    return (cpu_s(pid) - before) / (time.monotonic() - start)


def match_figures(log: Path) -> dict[str, float]:
    """Time of each matcher on the scan matches of a log, decoding apart."""
    cv2.setNumThreads(1)
    found: dict[str, float] = {}
    with LogReader(log) as reader:
        rig = read_rig(reader.run.calibration_text, str(log))
        jobs = [
            told.command
            for told in reader.decisions()
            if isinstance(told, LoggedCommand) and isinstance(told.command, cmd.RunMatch)
        ]
        for matcher in Matcher:
            times = [match(inputs(job, reader, rig), matcher).elapsed_ms for job in jobs for _ in range(REPEATS)]
            found[f"{matcher}_ms_median"] = statistics.median(times)
        view = reader.picture("/ptz/image", jobs[0].view.frame)
        start = time.perf_counter()
        for _ in range(20):
            decode_grey(view)
        found["decode_ms"] = (time.perf_counter() - start) / 20 * 1e3
    return found


def step_figures(log: Path) -> dict[str, float]:
    """Where the seconds to a lock go."""
    spent = seconds.medians_s([log])
    moves, pictures, matches = (spent[step] for step in seconds.STEPS.values())
    return {"moves_s": moves, "pictures_s": pictures, "matches_s": matches, "ideal_s": spent["the head alone"]}


def inputs(job: cmd.RunMatch, reader: LogReader, rig: object) -> MatchInputs:
    return MatchInputs(
        fisheye_grey=decode_grey(reader.picture("/fisheye/image", job.frame)),
        view_grey=decode_grey(reader.picture("/ptz/image", job.view.frame)),
        rig=rig,
        box=job.box,
        reading=job.view.reading,
        inverse_range=job.inverse_range,
        band_rad=job.band_rad,
        seed=job.seed,
    )


def table(figures: dict[str, object]) -> str:
    """Markdown for README."""
    rows = [
        ("one match, `sweep` / `harris` (region 26–44 px, view 640×480, decoding apart), median",
         "{sweep_ms_median:.0f} / {harris_ms_median:.0f} ms"),
        ("decoding one 640×480 picture", "{decode_ms:.1f} ms"),
        ("request → lock on the simulated rig, median of {requests}", "{seconds_to_lock_median:.1f} s"),
        ("of that, for one view and one look that confirms: moves until rest is proven / pictures at rest / matches",
         "{moves_s:.2f} / {pictures_s:.2f} / {matches_s:.2f} s"),
        ("the head alone, told where to go at once and one picture taken", "{ideal_s:.2f} s"),
        ("locked", "{locked} of {requests}"),
        ("pointing error against the truth, median / worst", "{error_deg_median:.3f}° / {error_deg_worst:.3f}°"),
        ("CPU share of one core, idle / scanning all the time (fisheye 640×480 at 10 fps, PTZ 640×480 at 15 fps, "
         "everything logged)", "{cpu_idle_percent:.0f} % / {cpu_scanning_percent:.0f} %"),
        ("resident memory of the daemon", "{resident_mb:.0f} MB"),
    ]  # fmt: skip
    lines = ["| what | measured |", "|---|---|"]
    lines += [f"| {what.format(**figures)} | {value.format(**figures)} |" for what, value in rows]
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    return "\n".join([*lines, "", f"Measured by `make figures` on {machine}, numpy {np.__version__}; scene `room`."])


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--write", action="store_true")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        figures: dict[str, object] = dict(asyncio.run(rig_figures("room", out)))
        log = max((out / "log").glob("*.mcap"))
        figures |= match_figures(log) | step_figures(log)
    print(json.dumps(figures, indent=2))
    if arguments.write:
        Path("docs").mkdir(exist_ok=True)
        Path("docs/figures.json").write_text(json.dumps(figures, indent=2) + "\n")
        text = README.read_text()
        head, rest = text.split(BEGIN)
        README.write_text(head + BEGIN + "\n" + table(figures) + "\n" + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
