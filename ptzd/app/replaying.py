"""`ptzd replay`: one file, with its own calibration and settings or with others."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import msgspec
from mcap.opcode import Opcode

from ptzd.app.fingerprint import fingerprint
from ptzd.app.loading import checked_rig, load_config
from ptzd.config import parse_config
from ptzd.documents import DocumentError, parse_yaml, read_regular
from ptzd.errors import CalibrationError, LogError
from ptzd.log.migrations import settings_now
from ptzd.log.reader import LogReader
from ptzd.log.records import RecordFile
from ptzd.log.run_info import RunInfo
from ptzd.replay.compare import ACROSS_MACHINES, ACROSS_OPENCV, EXACT, ROUNDING, Tolerance
from ptzd.replay.drive import Player, Replay
from ptzd.runtime.perception import ThreadPerception

OPENCV = "opencv-python-headless"
"""Name of its version in a fingerprint."""
_SPAN = struct.Struct("<QQ")
"""Head of a chunk: time of its first and of its last message, ns."""


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
        recorded_config = parse_config(_settings(path, run), f"{path}: config.yaml")
        recorded_rig = checked_rig(recorded_config, run.calibration_text, f"{path}: rig.yaml")
        config = recorded_config if config_path is None else load_config(config_path)
        # whether anything moved is what happened, no setting that could have been otherwise
        config = msgspec.structs.replace(config, shadow=recorded_config.shadow)
        rig = recorded_rig
        if calibration_path is not None or config_path is not None:
            text = run.calibration_text if calibration_path is None else _text(calibration_path)
            rig = checked_rig(config, text, str(calibration_path or f"{path}: rig.yaml"))
        what_if = config_path is not None or calibration_path is not None
        regime, tolerance = _regime(run.fingerprint, recompute=recompute)
        found = Player(
            reader=reader,
            rig=rig,
            config=config,
            recorded=(recorded_rig, recorded_config) if recompute or what_if else None,
            matcher=ThreadPerception(rig).match_now if recompute else None,
            tolerance=tolerance,
            untouched=EXACT if tolerance is EXACT else ROUNDING,
            advanced=advanced,
        ).run()
    changed = [str(other) for other in (config_path, calibration_path) if other is not None]
    found.regime = ", ".join([*(f"with {name}" for name in changed), regime])
    return found


def time_span_ns(path: Path) -> tuple[int, int]:
    """First and last time of a file, for a progress bar; only the heads of its chunks are read.

    Raises
    ------
    LogError
        It cannot be read or is torn.
    """
    with RecordFile(path) as file:
        heads = [file.read(frame.body, _SPAN.size) for frame in file.frames() if frame.opcode == Opcode.CHUNK]
    spans = [_SPAN.unpack(head) for head in heads if len(head) == _SPAN.size]
    return min((first for first, _ in spans if first), default=0), max((last for _, last in spans), default=0)


def _regime(recorded: Mapping[str, str], *, recompute: bool) -> tuple[str, Tolerance]:
    """What counts as equal, as words and numbers."""
    here = fingerprint()
    other = sorted(name for name in recorded.keys() | here.keys() if recorded.get(name) != here.get(name))
    what = "matches computed anew" if recompute else "decisions on the recorded matches"
    if not other:
        return f"{what}, to the bit: same fingerprint as recorded", EXACT
    tolerance = ROUNDING
    if recompute:
        tolerance = ACROSS_OPENCV if recorded.get(OPENCV) != here.get(OPENCV) else ACROSS_MACHINES
    limits = f"within {tolerance.deg:g}° and {tolerance.relative:g} of other values"
    limits += "" if tolerance.rivals else ", best places only"
    return f"{what}, {limits}: the machine that recorded differs in {', '.join(other)}", tolerance


def _settings(path: Path, run: RunInfo) -> object:
    try:
        return settings_now(parse_yaml(run.config_text), run.schema)
    except (LogError, DocumentError) as error:
        raise LogError(f"{path}: config.yaml: {' '.join(str(error).split())}") from None


def _text(path: Path) -> str:
    try:
        return read_regular(path).decode()
    except (OSError, UnicodeDecodeError) as error:
        raise CalibrationError(f"{path}: cannot be read: {error}") from None
