"""What every file of the log says about the run that wrote it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field

from ptzd.documents import DocumentError, parse_mapping
from ptzd.errors import LogError
from ptzd.log.migrations import SCHEMA_VERSION

METADATA = "ptzd.run"
CONFIG = "config.yaml"
CALIBRATION = "rig.yaml"


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, slots=True, kw_only=True)
class RunInfo:
    """Who wrote a log, with what."""

    rig: str
    config_text: str
    """YAML without secrets; attachment ``config.yaml``."""
    calibration_text: str
    """YAML; attachment ``rig.yaml``."""
    seed: int = 0
    versions: Mapping[str, str] = field(default_factory=dict)
    """By name: ptzd, python, numpy, opencv …"""
    fingerprint: Mapping[str, str] = field(default_factory=dict)
    """What can change the last bits of a result: CPU features, BLAS, threads."""
    file_index: int = 0
    """Counts the files of one run."""
    schema: int = SCHEMA_VERSION
    """Version of the events' and commands' fields."""

    @property
    def metric(self) -> bool:
        """Whether the rig's ranges are in m; where the calibration does not say, they are."""
        try:
            rig = parse_mapping(self.calibration_text).get("rig")
        except DocumentError:
            return True
        return bool(rig.get("metric", True)) if isinstance(rig, Mapping) else True

    def metadata(self) -> dict[str, str]:
        """Flat text pairs of the metadata record ``ptzd.run``."""
        return {
            "rig": self.rig,
            "seed": str(self.seed),
            "schema": str(self.schema),
            "file_index": str(self.file_index),
            "config_sha256": _sha256(self.config_text),
            "calibration_sha256": _sha256(self.calibration_text),
            **{f"version.{name}": value for name, value in self.versions.items()},
            **{f"fingerprint.{name}": value for name, value in self.fingerprint.items()},
        }


def run_info(metadata: Mapping[str, str], config_text: str, calibration_text: str) -> RunInfo:
    """Reverse of :meth:`RunInfo.metadata`.

    Raises
    ------
    LogError
        A part is missing or no number, or an attachment is not the one whose hash is recorded.
    """
    try:
        info = RunInfo(
            rig=metadata["rig"],
            config_text=config_text,
            calibration_text=calibration_text,
            seed=int(metadata["seed"]),
            versions=_group(metadata, "version."),
            fingerprint=_group(metadata, "fingerprint."),
            file_index=int(metadata["file_index"]),
            schema=int(metadata["schema"]),
        )
    except KeyError as error:
        raise LogError(f"metadata {METADATA}: {error} is missing") from None
    except ValueError as error:
        raise LogError(f"metadata {METADATA}: {error}") from None
    for name, text in (("config", config_text), ("calibration", calibration_text)):
        if metadata.get(f"{name}_sha256") != _sha256(text):
            raise LogError(f"metadata {METADATA}: the attached {name} is not the one whose hash is recorded")
    return info


def _group(metadata: Mapping[str, str], prefix: str) -> dict[str, str]:
    return {name.removeprefix(prefix): value for name, value in metadata.items() if name.startswith(prefix)}
