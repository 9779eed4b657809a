"""How fast the log writes, to the end of the last sync, and how fast a torn file is mended."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

from ptzd.config import LogSettings
from ptzd.control.events import FrameArrived, Snapshot
from ptzd.log.file import McapFile
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.recover import recover
from ptzd.log.run_info import RunInfo
from ptzd.log.topics import FISHEYE_IMAGE
from ptzd.log.writer import McapLog
from ptzd.model import FrameRef
from ptzd.ports import Picture
from tests.bench.photos import photos

RUN = RunInfo(rig="bench", config_text="", calibration_text="")
WAITING = 64
"""Pictures that may wait for the writer before the bench does."""


class Clock:
    def now_ns(self) -> int:
        return time.time_ns()

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


async def drained(log: McapLog, waiting: int) -> None:
    while log.stats().waiting > waiting:  # noqa: ASYNC110 - a thread has no event to wait for
        await asyncio.sleep(0.001)


async def write(directory: Path, total_bytes: int) -> tuple[float, float]:
    """Write pictures with an event each as fast as the log takes them; MB/s until it is synced, and until written."""
    pictures = photos(1280, 960, 20)
    settings = LogSettings(
        directory=str(directory), min_free_bytes=0, rotate_bytes=256 << 20, keep_bytes=1 << 30, queue_frames=2 * WAITING
    )
    begin = time.perf_counter()
    async with McapLog(settings, RUN, Clock()) as log:
        number = told = 0
        while told < total_bytes:
            t_ns = time.time_ns()
            if log.rotate_due():
                log.rotate(number, t_ns, Snapshot())
                number += 1
            jpeg = pictures[number % len(pictures)]
            frame = FrameRef(seq=number, t_capture_ns=t_ns)
            log.picture(FISHEYE_IMAGE, Picture(frame=frame, t_arrival_ns=t_ns, jpeg=jpeg))
            log.event(number, t_ns, FrameArrived(frame=frame))
            number, told = number + 1, told + len(jpeg)
            await drained(log, WAITING)
        await drained(log, 0)
        written_s = time.perf_counter() - begin
    synced_s = time.perf_counter() - begin
    stats = log.stats()
    assert (stats.pictures_dropped, stats.decisions_lost) == (0, 0), stats
    return told / 1e6 / synced_s, told / 1e6 / written_s


def mend(directory: Path, total_bytes: int) -> tuple[float, float]:
    """Cut a file in the middle of a record and recover it; MB/s with the file in the page cache, and its MB."""
    pictures = photos(1280, 960, 20)
    file = McapFile(directory / "torn.mcap", RUN, 0)
    file.open()
    number = 0
    while file.size < total_bytes:
        image = CompressedImage(t_ns=number, frame_id="fisheye", data=pictures[number % len(pictures)], format="jpeg")
        file.add(FISHEYE_IMAGE, number, number, number, encode_image(image))
        number += 1
    file.flush()
    file.abandon()
    size = file.active.stat().st_size - 1000
    with file.active.open("rb+") as stream:
        stream.truncate(size)
        os.fsync(stream.fileno())  # what a crash left behind is on the disk; recovery syncs what it adds
    begin = time.perf_counter()
    report = recover(file.active)
    elapsed_s = time.perf_counter() - begin
    assert number - 10 < report.messages < number
    report.path.unlink()
    return size / 1e6 / elapsed_s, size / 1e6


def rates(directory: Path, megabytes: int = 2000) -> list[tuple[str, str, str]]:
    """Rows of a table: what, measured, wanted."""
    synced, written = asyncio.run(write(directory / "log", megabytes * 1_000_000))
    mended, size = mend(directory, megabytes * 300_000)
    return [
        (
            f"writing {megabytes} MB of 1280×960 pictures with an event each, last sync included",
            f"{synced:.0f} MB/s",
            "≥ 50",
        ),
        ("the same until the kernel has it", f"{written:.0f} MB/s", ""),
        (f"recovering a torn file of {size:.0f} MB", f"{mended:.0f} MB/s", "≥ 200"),
    ]
