"""The log's rates: writing, recovering, and how much faster than the night itself it replays, with reading's share.

python -m tests.bench.replay [--write]

Prints a table; with --write it goes into README. The replayed logs are the golden ones blown up to full rate: fisheye
1280×960 at 30 fps (300 kB each), PTZ 640×480 at 15 fps (90 kB each), every frame told to the core. Their rig is busy
all the time, which is the worst case.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import tempfile
import time
from pathlib import Path

from ptzd.app.replaying import replay
from ptzd.log.file import McapFile
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.reader import LogReader
from ptzd.log.topics import EVENT, FISHEYE_IMAGE, PTZ_IMAGE
from tests.bench.files import rates

GOLDEN = Path(__file__).parents[1] / "golden"
README = Path(__file__).parents[2] / "README.md"
BEGIN, END = "<!-- log figures -->", "<!-- /log figures -->"
NAMES = ("lock", "preemption", "update")
REPEATS = 5
FILL = {FISHEYE_IMAGE: 300_000, PTZ_IMAGE: 90_000}
RATE_HZ = {FISHEYE_IMAGE: 30.0, PTZ_IMAGE: 15.0}
FRAMES_HZ = 5.0
"""At which the golden logs' fisheye frames are told."""


def blow_up(source: Path, target: Path) -> None:
    """Copy a log; add pictures up to full rate and tell every fisheye frame as often as there are more of them."""
    noise = os.urandom(1 << 20)
    with LogReader(source) as reader:
        entries = list(reader.entries())
        file = McapFile(target, reader.run, entries[0].log_ns)
    file.open()
    due = dict.fromkeys(FILL, entries[0].log_ns)
    sequence = 1 << 30
    for entry in entries:
        file.add(entry.topic, entry.log_ns, entry.publish_ns, entry.sequence, entry.data)
        if entry.topic == EVENT and json.loads(entry.data)["name"] == "FrameArrived":
            for _ in range(round(RATE_HZ[FISHEYE_IMAGE] / FRAMES_HZ) - 1):
                file.add(entry.topic, entry.log_ns, entry.publish_ns, entry.sequence, entry.data)
        for topic, size in FILL.items():
            while due[topic] <= entry.log_ns:
                start = sequence % (1 << 18)
                picture = CompressedImage(
                    t_ns=due[topic], frame_id="filler", data=noise[start : start + size], format="jpeg"
                )
                file.add(topic, due[topic], due[topic], sequence, encode_image(picture))
                due[topic] += round(1e9 / RATE_HZ[topic])
                sequence += 1
    file.finish()


def measure(path: Path, *, recompute: bool) -> tuple[float, float, float]:
    """Best of some: recorded over elapsed time, the same over processor time, share of reading.

    Matches computed anew may differ: a faster matcher is measured before the golden logs are renewed.
    """
    best = (0.0, 0.0, 0.0)
    for _ in range(REPEATS):
        before = time.process_time()
        found = replay(path, recompute=recompute)
        cpu_s = time.process_time() - before
        assert found.same or recompute, [str(difference) for difference in found.differences[:3]]
        best = max(best, (found.speed, found.span_s / cpu_s, found.reading_s / found.elapsed_s))
    return best


def replays(folder: Path) -> list[tuple[str, str, str]]:
    """Rows of the table: the slowest of the logs counts."""
    rows = []
    found: dict[str, list[tuple[float, float]]] = {"decisions": [], "recompute": []}
    for name in NAMES:
        path = folder / f"{name}.mcap"
        blow_up(GOLDEN / path.name, path)
        rate = path.stat().st_size / 1e6 / replay(path).span_s
        for mode, all_found in found.items():
            speed, cpu, reading = measure(path, recompute=mode == "recompute")
            print(
                f"{name}: {rate:.1f} MB/s recorded, {mode}: {speed:.1f}× real time, {reading:.0%} of it reading; "
                f"{cpu:.1f}× with processor time, set-up included",
                flush=True,
            )
            all_found.append((speed, reading))
        path.unlink()
    for mode, wanted in (("decisions", "≥ 20"), ("recompute", "≥ 3")):
        speed, reading = min(found[mode])
        what = "replaying the decisions" if mode == "decisions" else "replaying with every match computed anew"
        rows.append(
            (f"{what} of a full-rate log ({reading:.0%} of the time is reading it)", f"{speed:.0f}× real time", wanted)
        )
    return rows


def table(rows: list[tuple[str, str, str]]) -> str:
    """Markdown."""
    machine = f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}"
    return "\n".join(
        [
            "| the log | measured | wanted |",
            "|---|---|---|",
            *(f"| {what} | {measured} | {wanted} |" for what, measured, wanted in rows),
            "",
            f"Measured by `make bench-replay` on {machine}.",
        ]
    )


def main(*, write: bool) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        told = table([*rates(folder), *replays(folder)])
    print(told)
    if write:
        head, _, rest = README.read_text().partition(BEGIN)
        README.write_text(f"{head}{BEGIN}\n{told}\n{END}{rest.partition(END)[2]}")


if __name__ == "__main__":
    main(write="--write" in sys.argv[1:])
