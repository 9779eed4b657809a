"""Rates of writing and reading on this machine; prints them, asserts only what they cost the processor, with slack."""

import os
import time

import pytest

from ptzd.control.events import DeadlinePassed
from ptzd.log.reader import LogReader
from ptzd.log.topics import FISHEYE_IMAGE
from ptzd.log.writer import McapLog

PICTURE_BYTES = 300_000
COUNT = int(os.environ.get("PTZD_RATE_PICTURES", "250"))


@pytest.mark.bench
async def test_writing_and_reading_are_far_above_what_cameras_send(settings, run, clock, picture):
    """A 1280x960 fisheye at 30 Hz and a 640x480 PTZ at 15 Hz make about 12 MB/s."""
    pictures = [picture(seq, size=PICTURE_BYTES) for seq in range(COUNT)]
    log = McapLog(settings(queue_frames=COUNT, rotate_bytes=1 << 40), run, clock)
    begin, begin_cpu = time.perf_counter(), time.process_time()
    async with log:
        for seq, item in enumerate(pictures):
            log.picture(FISHEYE_IMAGE, item)
            log.event(seq, item.t_arrival_ns, DeadlinePassed())
        queued = time.perf_counter() - begin
        await log.settled()
        written, written_cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
        stats = log.stats()
        path = log.current_file
    begin, begin_cpu = time.perf_counter(), time.process_time()
    with LogReader(path) as reader:
        decisions = sum(1 for _ in reader.decisions())
    read, read_cpu = time.perf_counter() - begin, time.process_time() - begin_cpu
    size = path.stat().st_size / 1e6
    print(
        f"{size:.0f} MB: queued at {queued / COUNT * 1e6:.0f} us per frame and event, "
        f"written at {size / written:.0f} MB/s, decisions read at {size / read:.0f} MB/s"
    )
    assert (stats.pictures, stats.pictures_dropped, decisions) == (COUNT, 0, COUNT)
    assert size / written_cpu > 20
    assert size / read_cpu > 40
