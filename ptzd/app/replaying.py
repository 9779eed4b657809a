"""`ptzd replay`: one file, with its own calibration and settings or with others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import yaml

from ptzd.app.fingerprint import fingerprint
from ptzd.app.loading import checked_rig, load_config
from ptzd.config import parse_config
from ptzd.log.reader import LogReader
from ptzd.replay.compare import ACROSS_MACHINES, EXACT
from ptzd.replay.drive import Player, Replay
from ptzd.runtime.perception import ThreadPerception


def replay(
    path: Path,
    *,
    recompute: bool = False,
    config_path: Path | None = None,
    calibration_path: Path | None = None,
    advanced: Callable[[int], None] = lambda t_ns: None,
) -> Replay:
    """Drive the core from a log file.

    Parameters
    ----------
    path : Path
        A closed ``.mcap`` file.
    recompute : bool
        Run every match again on the recorded bytes: equal to the bit on the same fingerprint, within
        :data:`ACROSS_MACHINES` elsewhere.
    config_path, calibration_path : Path, optional
        What if: other settings or another calibration than the recorded ones.
    advanced : callable
        Told of every event's time.

    Raises
    ------
    LogError
        When the file is damaged or lacks what is needed.
    """
    cv2.setNumThreads(1)
    with LogReader(path) as reader:
        run = reader.run
        config = parse_config(yaml.safe_load(run.config_text), f"{path}: config.yaml")
        if config_path is not None:
            config = load_config(config_path)
        calibration = run.calibration_text if calibration_path is None else calibration_path.read_text()
        rig = checked_rig(config, calibration, f"{path}: rig.yaml")
        same_machine = dict(run.fingerprint) == dict(fingerprint())
        perception = ThreadPerception(rig) if recompute else None
        return Player(
            reader=reader,
            rig=rig,
            config=config,
            matcher=None if perception is None else perception.match_now,
            tolerance=EXACT if same_machine or not recompute else ACROSS_MACHINES,
            advanced=advanced,
        ).run()
