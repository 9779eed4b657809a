"""Kill -9 at random moments of a busy run: what opens after recovery, what is lost, whether anything is out of order.

python -m tests.bench.kills [KILLS]

The victim logs 15 MB/s of pictures, an event and a command every 4 ms, and begins a file every 0.7 s. It tells each
event that the log took, with its own time, so the loss is measured from record to record: from the first that is not in
a file to the last that the log had taken. Every other victim has a disk whose syncs take a second.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from ptzd.config import LogSettings
from ptzd.control.commands import StopHead
from ptzd.control.events import FrameArrived, Snapshot
from ptzd.log import file as file_module
from ptzd.log.reader import LoggedEvent, LogReader
from ptzd.log.recover import recover_directory
from ptzd.log.run_info import RunInfo
from ptzd.log.topics import FISHEYE_IMAGE
from ptzd.log.writer import McapLog
from ptzd.model import FrameRef
from ptzd.ports import Picture

PERIOD_S = 0.004
HELD_UP_S = 5 * PERIOD_S
"""A longer pause between two records is the machine's: neither of the victim's threads had a processor."""
SLOW_SYNC_S = 1.0


class Clock:
    def now_ns(self) -> int:
        return time.time_ns()

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


async def victim(directory: str, sync_s: float) -> None:
    """Log until killed."""
    _slow_down(sync_s)
    jpeg = os.urandom(60_000)
    settings = LogSettings(directory=directory, min_free_bytes=0, rotate_s=0.7, queue_frames=4096)
    async with McapLog(settings, RunInfo(rig="busy", config_text="", calibration_text=""), Clock()) as log:
        for sequence in itertools.count():
            t_ns = time.monotonic_ns()
            if log.rotate_due():
                log.rotate(sequence, t_ns, Snapshot())
                continue
            frame = FrameRef(seq=sequence, t_capture_ns=t_ns)
            log.picture(FISHEYE_IMAGE, Picture(frame=frame, t_arrival_ns=t_ns, jpeg=jpeg))
            log.event(sequence, t_ns, FrameArrived(frame=frame))
            log.command(sequence, t_ns, StopHead())
            print(sequence, t_ns, flush=True)
            await asyncio.sleep(PERIOD_S)


def _slow_down(sync_s: float) -> None:
    def slowly(descriptor: int) -> None:
        time.sleep(sync_s)

    if sync_s:
        file_module.os.fsync = file_module.os.fdatasync = slowly


@dataclass(frozen=True, slots=True, kw_only=True)
class Killed:
    """What was left of one victim."""

    notes: list[str]
    """What recovery said of each file."""
    sequences: list[int]
    """Of the decisions in the files, in their order."""
    events: int
    """That are in the files."""
    told_ns: list[int]
    """Times of the events that the log had taken."""

    @property
    def lost_s(self) -> float:
        """From the first record that is in no file to the last that was taken."""
        return (self.told_ns[-1] - self.told_ns[self.events]) / 1e9 if self.events < len(self.told_ns) else 0.0

    @property
    def held_up_s(self) -> float:
        """Part of that in which the victim as a whole stood still."""
        pauses = [(later - one) / 1e9 for one, later in itertools.pairwise(self.told_ns[self.events :])]
        return sum(pause - PERIOD_S for pause in pauses if pause > HELD_UP_S)

    @property
    def in_order(self) -> bool:
        """Without gap or repetition, event and command together."""
        first_seen = list(dict.fromkeys(self.sequences))
        return self.sequences == sorted(self.sequences) and first_seen == list(range(len(first_seen)))


def kill(directory: Path, after_s: float, sync_s: float = 0.0) -> Killed:
    """Start a victim, kill it that long after its first record, recover and read what it left."""
    command = [sys.executable, __file__, "victim", str(directory), str(sync_s)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert child.stdout is not None
    with child.stdout:
        lines = [child.stdout.readline()]
        deadline = time.monotonic() + after_s
        while time.monotonic() < deadline:
            lines.append(child.stdout.readline())
        child.send_signal(signal.SIGKILL)
        child.wait()
        lines += child.stdout.readlines()
    told = [line.split() for line in lines if line.endswith("\n")]
    notes = recover_directory(directory)
    sequences, events = [], 0
    for path in sorted(directory.glob("*.mcap"), key=lambda path: path.name.rsplit("-", 1)[-1]):
        with LogReader(path) as log:
            for item in log.decisions():
                sequences.append(item.sequence)
                if isinstance(item, LoggedEvent) and isinstance(item.event, FrameArrived):
                    events += 1
                    log.picture(FISHEYE_IMAGE, item.event.frame)
    return Killed(notes=notes, sequences=sequences, events=events, told_ns=[int(t_ns) for _, t_ns in told])


def main(kills: int) -> None:
    chance = random.Random(1)
    for sync_s in (0.0, SLOW_SYNC_S):
        found = []
        for _ in range(kills // 2):
            with tempfile.TemporaryDirectory() as folder:
                found.append(kill(Path(folder) / "log", chance.uniform(0.3, 3.0), sync_s))
        lost = sorted(one.lost_s for one in found)
        torn = sum(len(one.notes) for one in found)
        told = sum(len(one.told_ns) for one in found)
        print(
            f"{len(found)} kills, syncs of {sync_s:g} s: {torn} torn files recovered, {told} events told; "
            f"lost: median {lost[len(lost) // 2]:.3f} s, most {lost[-1]:.3f} s "
            f"(less the victim's own stand-stills {max(one.lost_s - one.held_up_s for one in found):.3f} s); "
            f"out of order: {sum(not one.in_order for one in found)}"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["victim"]:
        asyncio.run(victim(sys.argv[2], float(sys.argv[3])))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
