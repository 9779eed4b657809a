"""The drift monitor in service: what confirmed locks say of the calibration, and R turned back onto them if asked for.

It looks at what the core was told and decided and takes no part in it: replays are exact with and without. The daemon
begins anew with a refined calibration when it is idle: every log file holds one calibration.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable

from ptzd.calibrate.locks import ConfirmedLocks
from ptzd.calibrate.refined import SOURCE, refined_path, source_of
from ptzd.calibration.drift import Drift, DriftMonitor, Lock, refined
from ptzd.calibration.file import dump_rig
from ptzd.config import Config
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Rig
from ptzd.ports import EventLog

_log = logging.getLogger(__name__)


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

    def seen(self, t_ns: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step."""
        self._locks.told(event)
        for command in commands:
            lock = self._locks.told(command)
            if lock is not None:
                self._judge(t_ns, self._monitor.add(lock))
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
        provenance = {SOURCE: source_of(self._text), "turned_deg": math.degrees(turn_rad), "locks": len(locks)}
        fresh = path.with_suffix(".new")
        fresh.write_text(dump_rig(better, provenance))
        fresh.replace(path)
        return turn_rad
