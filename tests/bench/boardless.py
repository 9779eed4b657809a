"""Calibration without a board on simulated rigs of several scenes and mountings, and how wrong each points.

python -m tests.bench.boardless [--seeds N] [SCENE-PROFILE-SEED ...]

The same steps as `ptzd calibrate zoom` and `rig`; pointing error at the true range over a grid of the picture. With
N seeds each rig is fitted N times to the same pictures: a row each, which differ by the random draws alone.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ptzd.calibrate.capture import FISHEYE
from ptzd.calibrate.head import turning
from ptzd.calibrate.rig import rig_from_scene
from ptzd.calibrate.studio import Studio
from ptzd.calibration.target import Target
from tests.bench.stage import RENDERED, rendered

RIGS = ("room-dome-3", "room-dome-4", "room-v5915-5", "yard-dome-3", "warehouse-dome-4")


def silent(text: str) -> None:
    del text


def fits(rig: str, folder: Path, seeds: int) -> Iterator[tuple[np.ndarray, float]]:
    """Pointing errors of one simulated rig, deg, and what the verdict expected at 95 %, rad, for every seed."""
    scene, profile, seed = rig.split("-")
    target = Target(columns=8, rows=6, pitch_m=0.03)
    studio = Studio(rendered(scene) if scene in RENDERED else scene, profile, folder, target, int(seed))
    shots = studio.scene_only()
    turning(shots, folder, silent)
    fisheye = folder / "scene" / FISHEYE
    for draws in range(1, seeds + 1):
        result = rig_from_scene(shots, fisheye, folder, folder / "rig.yaml", silent, seed=draws)
        yield studio.pointing_errors_deg(result.rig), result.expected.p95_rad


def main(rigs: tuple[str, ...], seeds: int) -> None:
    print("| simulated rig | pointing error, °: median | 95 % | largest | verdict, 95 % |\n|---|---|---|---|---|")
    for rig in rigs:
        with tempfile.TemporaryDirectory() as name:
            for errors, expected_rad in fits(rig, Path(name), seeds):
                told = " | ".join(
                    f"{value:.3f}"
                    for value in (np.median(errors), np.percentile(errors, 95), errors.max(), np.degrees(expected_rad))
                )
                print(f"| {rig} | {told} |", flush=True)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("rigs", nargs="*", default=RIGS, metavar="SCENE-PROFILE-SEED")
    arguments = parser.parse_args()
    main(tuple(arguments.rigs), arguments.seeds)
