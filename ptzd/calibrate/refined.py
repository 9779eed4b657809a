"""The refined calibration: a file of its own beside the log; the one in the settings is never touched.

It counts as long as it was made from that very calibration and `drift.refine` is on, so taking it back is deleting it
(`ptzd calibrate drift --undo`), switching the setting off, or calibrating anew.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from ptzd.calibration.file import load_provenance
from ptzd.config import Config
from ptzd.documents import parse_mapping
from ptzd.errors import CalibrationError

FILE = "rig.refined.yaml"
SOURCE = "refined_from_sha256"


def refined_path(config: Config) -> Path:
    """Where a refined calibration lies."""
    return Path(config.log.directory) / FILE


def in_force(config: Config, calibration_text: str) -> str:
    """The text of the calibration to use: the refined one when it is wanted and was made from this very one."""
    path = refined_path(config)
    if not config.drift.refine or not path.is_file():
        return calibration_text
    return path.read_text() if _made_from(path) == _digest(calibration_text) else calibration_text


def undo(config: Config) -> Path:
    """Take the refined calibration back; the daemon uses the one of its settings from its next start.

    Raises
    ------
    CalibrationError
        When there is none.
    """
    path = refined_path(config)
    if not path.is_file():
        raise CalibrationError(f"{path}: there is no refined calibration; the one in the settings is in use")
    kept = path.with_suffix(".undone")
    path.replace(kept)
    return kept


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _made_from(path: Path) -> object:
    return load_provenance(path).get(SOURCE)


def source_of(text: str) -> str:
    """Digest of the calibration in the settings that a text is, or was refined from."""
    document = parse_mapping(text)
    made_from = document.get("provenance", {}).get(SOURCE)
    return str(made_from) if made_from else _digest(text)
