"""`ptzd calibrate zoom` and `rig` on pictures of a scene without a board: the verdict comes before the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from ptzd.calibrate.capture import FISHEYE
from ptzd.calibrate.studio import Studio
from ptzd.calibration.file import load_rig
from ptzd.calibration.target import Target
from ptzd.cli import entry

LIMIT_DEG = 0.2


@pytest.fixture(scope="module")
def studio(tmp_path_factory) -> tuple[Studio, Path]:
    """A simulated rig in a room, its pictures, and its zoom and head as `ptzd calibrate zoom` finds them."""
    folder = tmp_path_factory.mktemp("room")
    made = Studio("room", "dome", folder, Target(columns=8, rows=6, pitch_m=0.03), 3)
    shots = made.scene_only(zooms=(1.0, 800.0))
    assert entry(["calibrate", "zoom", str(shots), "--work", str(folder)]) == 0
    return made, shots


def test_nothing_is_written_above_the_limit_unless_it_is_accepted(studio, capsys) -> None:
    made, shots = studio
    work = shots.parent
    out = work / "rig.yaml"
    words = ["calibrate", "rig", str(shots), "--work", str(work), "--out", str(out)]
    words += ["--fisheye", str(work / "scene" / FISHEYE)]
    capsys.readouterr()
    before = sorted(work.iterdir())
    assert entry([*words, "--limit", "0.01"]) != 0
    told = capsys.readouterr().err
    assert "verdict: expect a pointing error of" in told
    assert "is above the limit of 0.01°, nothing was written" in told
    assert sorted(work.iterdir()) == before
    assert entry([*words, "--limit", "0.01", "--accept"]) == 0
    quality = yaml.safe_load(out.read_text())["provenance"]["pointing"]
    expected_deg = max(quality["covariance_p95_deg"], quality["halves_p95_deg"])
    assert expected_deg < LIMIT_DEG
    true_deg = float(np.percentile(made.pointing_errors_deg(load_rig(out)), 95))
    assert true_deg < LIMIT_DEG
