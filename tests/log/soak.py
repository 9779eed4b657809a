"""The log at full rate for as long as you like: memory flat, no decision lost, no frame lost on an idle machine.

python -m tests.log.soak [minutes] [directory]

Fisheye 1280×960 at 30 fps, PTZ 640×480 at 15 fps, every frame and every position told to the core and written, with
photographs as cameras send them.
"""

import asyncio
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from ptzd.config import LogSettings
from ptzd.control.events import FrameArrived, HeadPolled, Snapshot
from ptzd.log.reader import LogReader
from ptzd.log.run_info import RunInfo
from ptzd.log.topics import FISHEYE_IMAGE, PTZ_IMAGE
from ptzd.log.writer import McapLog
from ptzd.model import FrameRef, HeadReading, Motion
from ptzd.ports import Picture
from tests.bench.photos import photos

FISHEYE_HZ, PTZ_HZ = 30, 15
TICK_S = 1 / FISHEYE_HZ


class WallClock:
    """Steady enough for a soak."""

    def now_ns(self) -> int:
        return time.time_ns()

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


def rss_mib() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


async def feed(log: McapLog, minutes: float) -> tuple[int, list[float], float]:
    """Returns decisions told, memory once a second, and the longest lag of the loop in s."""
    fisheye, ptz = photos(1280, 960, 60), photos(640, 480, 60)
    print(f"fisheye pictures of {len(fisheye[0]) / 1e3:.0f} kB, PTZ pictures of {len(ptz[0]) / 1e3:.0f} kB", flush=True)
    sequence, memory, worst = 0, [], 0.0
    begin = time.monotonic()
    for tick in range(round(minutes * 60 * FISHEYE_HZ)):
        due = begin + tick * TICK_S
        await asyncio.sleep(max(0.0, due - time.monotonic()))
        worst = max(worst, time.monotonic() - due)
        t_ns = time.time_ns()
        if log.rotate_due():
            log.rotate(sequence, t_ns, Snapshot())
            sequence += 1
        frame = FrameRef(seq=tick, t_capture_ns=t_ns)
        log.picture(FISHEYE_IMAGE, Picture(frame=frame, t_arrival_ns=t_ns, jpeg=fisheye[tick % 60]))
        log.event(sequence, t_ns, FrameArrived(frame=frame))
        sequence += 1
        if tick % (FISHEYE_HZ // PTZ_HZ) == 0:
            log.picture(PTZ_IMAGE, Picture(frame=frame, t_arrival_ns=t_ns, jpeg=ptz[tick % 60]))
            reading = HeadReading(pan_deg=tick % 90, tilt_deg=0.0, zoom=1.0)
            log.event(sequence, t_ns, HeadPolled(reading=reading, motion=Motion.MOVING))
            sequence += 1
        if tick % FISHEYE_HZ == 0:
            memory.append(rss_mib())
    return sequence, memory, worst


async def soak(minutes: float, directory: str) -> None:
    settings = LogSettings(directory=directory, rotate_s=60.0, keep_bytes=1 << 30, min_free_bytes=0)
    run = RunInfo(rig="soak", config_text="", calibration_text="")
    log = McapLog(settings, run, WallClock())
    async with log:
        told, memory, worst = await feed(log, minutes)
        cpu_s = time.process_time()
    stats = log.stats()
    kept = []
    for path in log.closed_files():
        with LogReader(path) as reader:
            kept += [item.sequence for item in reader.decisions()]
    third = len(memory) // 3
    share = cpu_s / minutes / 0.6
    print(f"{stats.bytes / 1e6:.0f} MB in {minutes:g} min, {share:.1f} % of a core, longest lag {worst * 1e3:.0f} ms")
    slope = np.polyfit(np.arange(third, len(memory)), memory[third:], 1)[0] * 60.0
    print(
        f"memory: {memory[third]:.1f} MiB after a third, {memory[-1]:.1f} at the end, at most {max(memory):.1f}; "
        f"slope over the last two thirds {slope:+.3f} MiB a minute"
    )
    print(
        f"decisions: {told} told, {stats.decisions_lost} lost, {len(kept)} in the {len(log.closed_files())} files kept"
    )
    print(f"pictures: {stats.pictures} written, {stats.pictures_dropped} dropped")
    assert stats.decisions_lost == 0
    assert kept == list(range(kept[0], told))
    assert memory[-1] <= memory[third] + 16


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        asyncio.run(
            soak(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0, sys.argv[2] if len(sys.argv) > 2 else scratch)
        )
