"""Golden logs under other versions of OpenCV: ``python -m tests.bench.opencv 4.10 4.13`` (or ``make opencv``).

Makes an environment for each version, runs every match of the golden logs anew there, and prints how far the best place
and its score moved and what `ptzd replay --recompute` says.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from pathlib import Path

GOLDEN = Path(__file__).parents[1] / "golden"
ROOT = Path(__file__).parents[2]


def inside() -> None:
    """Measure in this environment; one line."""
    import cv2

    from ptzd.app.replaying import replay
    from ptzd.calibration.file import read_rig
    from ptzd.control.commands import RunMatch
    from ptzd.control.events import MatchFinished
    from ptzd.log.reader import LoggedEvent, LogReader
    from ptzd.log.topics import FISHEYE_IMAGE, PTZ_IMAGE
    from ptzd.runtime.perception import ThreadPerception

    cv2.setNumThreads(1)
    moved_deg = changed = 0.0
    matches = others = same = files = 0
    for path in sorted(GOLDEN.glob("*.mcap")):
        files += 1
        same += replay(path, recompute=True).same
        jobs: dict[int, RunMatch] = {}
        with LogReader(path) as log:
            perception = ThreadPerception(read_rig(log.run.calibration_text, path.name))
            for logged in log.decisions():
                if not isinstance(logged, LoggedEvent):
                    if isinstance(logged.command, RunMatch):
                        jobs[logged.command.match_id] = logged.command
                    continue
                event = logged.event
                if not isinstance(event, MatchFinished) or event.match_id not in jobs or not event.result.candidates:
                    continue
                job = jobs[event.match_id]
                found = perception.match_now(
                    job, log.picture(FISHEYE_IMAGE, job.frame), log.picture(PTZ_IMAGE, job.view.frame)
                )
                matches += 1
                others += len(found.candidates) != len(event.result.candidates)
                one, other = event.result.candidates[0], found.candidates[0]
                turn = math.hypot((one.pan_rad - other.pan_rad) * math.cos(one.tilt_rad), one.tilt_rad - other.tilt_rad)
                moved_deg = max(moved_deg, math.degrees(turn))
                changed = max(changed, abs(one.score - other.score))
    print(
        f"OpenCV {cv2.__version__}: {same} of {files} logs decide the same; {matches} matches, best place moved by up "
        f"to {moved_deg:.5f}°, its score by {changed:.5f}, another number of places in {others}"
    )


def main(versions: list[str]) -> None:
    inside()
    for version in versions:
        with tempfile.TemporaryDirectory() as folder:
            python = Path(folder) / "bin" / "python"
            subprocess.run([sys.executable, "-m", "venv", folder], check=True)
            wanted = [str(ROOT), f"opencv-python-headless=={version}.*"]
            subprocess.run([python, "-m", "pip", "install", "--quiet", *wanted], check=True)
            subprocess.run([python, "-m", "tests.bench.opencv", "--inside"], check=True, cwd=ROOT)


if __name__ == "__main__":
    if sys.argv[1:] == ["--inside"]:
        inside()
    else:
        main(sys.argv[1:] or ["4.10", "4.13"])
