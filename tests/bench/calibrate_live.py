"""From nothing to rig.yaml without a board, by the commands of README on a live simulated rig, and how wrong it points.

`python tests/bench/calibrate_live.py [--keep FOLDER]`; exit 0 when 95 % of the common field are within 0.2°.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

LIMIT_DEG = 0.2


def ptzd(*words: object) -> str:
    """One command; what it prints."""
    print("$ ptzd", *words, flush=True)
    command = [sys.executable, "-m", "ptzd", *(str(word) for word in words)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def main(folder: Path) -> int:
    work, config = folder / "work", folder / "rig" / "ptzd.yaml"
    ports = ("--port", "0", "--fisheye-port", "0", "--truth-port", "0")
    server = [sys.executable, "-m", "ptzd", "sim", "--write-config", str(config.parent), "--json", *ports]
    with subprocess.Popen(server, stdout=subprocess.PIPE, text=True) as sim:
        assert sim.stdout is not None
        try:
            truth = json.loads(sim.stdout.readline())["truth_url"]
            ptzd("calibrate", "capture", "--config", config, "--work", work)
            for step in (["zoom"], ["rig", "--out", folder / "rig.yaml"]):
                print(ptzd("calibrate", *step, work / "shots.json", "--work", work))
            verify = ("calibrate", "verify", work / "shots.json", "--calibration", folder / "rig.yaml")
            told = json.loads(ptzd(*verify, "--truth", truth, "--json"))
        finally:
            sim.terminate()
    print(json.dumps(told, indent=1))
    return 0 if told["truth"]["pointing"]["p95_deg"] <= LIMIT_DEG else 1


if __name__ == "__main__":
    if len(sys.argv) == 3 and sys.argv[1] == "--keep":
        sys.exit(main(Path(sys.argv[2])))
    with tempfile.TemporaryDirectory() as name:
        sys.exit(main(Path(name)))
