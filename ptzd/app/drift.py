"""The drift monitor in service: what confirmed locks say of the calibration, and R turned back onto them if asked for.

It looks at what the core was told and decided and takes no part in it: replays are exact with and without. A refined
calibration is a file of its own beside the log; the one in the settings is never touched. It counts as long as it was
made from that very calibration and `drift.refine` is on, so taking it back is deleting it (`ptzd calibrate drift
--undo`), switching the setting off, or calibrating anew. The daemon begins anew with it when it is idle: every log file
holds one calibration.
"""

from __future__ import annotations

import asyncio
import hashlib
import logging
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ptzd.calibration.drift import Drift, DriftMonitor, Lock, refined
from ptzd.calibration.file import dump_rig, load_provenance
from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.documents import parse_mapping
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.model import Box, Outcome
from ptzd.ports import EventLog

CONFIRMED = (Outcome.LOCKED, Outcome.RELEASED)
FILE = "rig.refined.yaml"
SOURCE = "refined_from_sha256"

_log = logging.getLogger(__name__)


class ConfirmedLocks:
    """Told every event and command, gives the confirmed locks among them.

    Parameters
    ----------
    rig : Rig
        The calibration that was in use.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._boxes: dict[str, Box] = {}

    def told(self, told: ev.Event | cmd.Command) -> Lock | None:
        """Return the lock when this is the result that confirms one; a target that moved tells nothing."""
        match told:
            case ev.RequestReceived():
                self._boxes.setdefault(told.id, told.box)
            case ev.UpdateReceived():
                self._boxes.pop(told.id, None)
            case cmd.PublishResult():
                box = self._boxes.pop(told.id, None)
                if box is not None and told.outcome in CONFIRMED:
                    return self._lock(box, told)
            case _:
                pass
        return None

    def _lock(self, box: Box, result: cmd.PublishResult) -> Lock | None:
        ray, valid = self._rig.fisheye.lift(np.array(box.centre))
        if result.pan_deg is None or result.tilt_deg is None or not valid:
            return None
        direction = bearing(math.radians(result.pan_deg), math.radians(result.tilt_deg))
        near = 0.0 if result.range_m is None else 1.0 / result.range_m
        return Lock(ray=ray, direction=direction, band_rad=self._rig.band_rad(near))


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


def _source(text: str) -> str:
    """Digest of the calibration in the settings that a text is, or was refined from."""
    document = parse_mapping(text)
    made_from = document.get("provenance", {}).get(SOURCE)
    return str(made_from) if made_from else _digest(text)


class DriftWatch:
    """Shown every step of the core (an observer of the pump).

    Parameters
    ----------
    rig : Rig
        The calibration in use.
    config : Config
        Whether to refine, and where the log lies.
    calibration_text : str
        Of the calibration in use.
    log : EventLog
        Hears every judgement, topic ``/drift``.
    idle : callable
        Whether nothing is being looked at.
    renew : callable
        Lets the daemon begin anew.
    """

    def __init__(
        self,
        rig: Rig,
        config: Config,
        calibration_text: str,
        log: EventLog,
        *,
        idle: Callable[[], bool],
        renew: Callable[[], None],
    ) -> None:
        self._rig, self._config, self._text = rig, config, calibration_text
        self._log, self._idle, self._renew = log, idle, renew
        self._locks, self._monitor = ConfirmedLocks(rig), DriftMonitor(rig)
        self._drifted = False
        self._changed = asyncio.Event()

    def seen(self, sequence: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step."""
        del sequence
        self._locks.told(event)
        for command in commands:
            lock = self._locks.told(command)
            if lock is not None:
                self._judge(event.t_ns, self._monitor.add(lock))
        self._changed.set()

    def _judge(self, t_ns: int, drift: Drift) -> None:
        document: dict[str, object] = {
            "locks": drift.count,
            "median_deg": round(math.degrees(drift.median_rad), 4),
            "sigma_deg": round(math.degrees(drift.sigma_rad), 4),
            "band_deg": round(math.degrees(drift.band_rad), 4),
            "drifted": drift.drifted,
        }
        self._log.document("/drift", t_ns, document)
        if drift.drifted and not self._drifted:
            _log.warning(
                "calibration drifted: locks lie %+.3f° across their arcs in the median of %d, band ±%.3f°; refine it "
                "(drift.refine) or calibrate the rig again",
                math.degrees(drift.median_rad), drift.count, math.degrees(drift.band_rad),
            )  # fmt: skip
        self._drifted = drift.drifted

    async def run(self) -> None:
        """Refine when it has drifted, is wanted and nothing is being looked at; serve until cancelled."""
        tried = 0
        while True:
            await self._changed.wait()
            self._changed.clear()
            locks = self._monitor.locks
            if not (self._config.drift.refine and self._drifted and self._idle()) or len(locks) == tried:
                continue
            tried = len(locks)
            try:
                turn_rad = await asyncio.to_thread(self._refine, locks)
            except CalibrationError as error:
                _log.warning("calibration not refined: %s", error)
                continue
            while not self._idle():
                self._changed.clear()
                await self._changed.wait()
            _log.warning("R turned by %.3f° onto %d locks; beginning anew with it", math.degrees(turn_rad), tried)
            self._renew()

    def _refine(self, locks: tuple[Lock, ...]) -> float:
        better, turn_rad = refined(self._rig, locks)
        path = refined_path(self._config)
        provenance = {SOURCE: _source(self._text), "turned_deg": math.degrees(turn_rad), "locks": len(locks)}
        fresh = path.with_suffix(".new")
        fresh.write_text(dump_rig(better, provenance))
        fresh.replace(path)
        return turn_rad
