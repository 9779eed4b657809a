"""What the motors have gone in their life, kept over restarts in a file beside the log."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

import msgspec

from ptzd.app.kept import KeptFile, put_aside
from ptzd.config import Config, Motor
from ptzd.control.motor import Travel
from ptzd.documents import read_regular
from ptzd.outgoing import MotorStatus
from ptzd.ports import Clock, EventLog

FILE = "motor.json"
EVERY_S = 10.0
"""What a crash may lose."""

_log = logging.getLogger(__name__)


class _Document(msgspec.Struct, kw_only=True, forbid_unknown_fields=True):
    ptzd_motor: Literal[1]
    travel: Travel


def motor_path(config: Config) -> Path:
    """Where it lies."""
    return Path(config.log.directory) / FILE


def read_travel(path: Path) -> Travel:
    """What is kept there; nothing yet where there is no file.

    A damaged file is put aside and said in the journal: what it held is lost, and counting begins anew.
    """
    try:
        document = msgspec.json.decode(read_regular(path), type=_Document)
        _check(document.travel)
    except FileNotFoundError:
        return Travel()
    except (OSError, ValueError) as error:  # msgspec's errors are ValueErrors
        why = " ".join(str(error).split())
        _log.warning(
            "%s cannot be used (%s): what the motors have gone is counted anew; %s", path, why, put_aside(path)
        )
        return Travel()
    return document.travel


def _check(travel: Travel) -> None:
    values = (travel.pan_deg, travel.tilt_deg, travel.zoom_steps, travel.moves, travel.spared)
    if min(values, default=0) < 0 or any(minute.moves < 0 or minute.degrees < 0 for minute in travel.minutes):
        raise ValueError("a count is below 0")
    numbers = [minute.number for minute in travel.minutes]
    if numbers != sorted(set(numbers)):
        raise ValueError("minutes are not in their order")


def motor_status(travel: Travel, settings: Motor, t_ns: int) -> MotorStatus:
    """The counts as ``status`` and the log topic ``/motor`` show them."""
    moves, degrees = travel.hour(t_ns)
    return MotorStatus(
        pan_deg=round(travel.pan_deg, 1),
        tilt_deg=round(travel.tilt_deg, 1),
        zoom_steps=round(travel.zoom_steps),
        moves=travel.moves,
        spared=travel.spared,
        moves_last_hour=moves,
        degrees_last_hour=round(degrees, 1),
        moves_per_hour=settings.moves_per_hour,
        degrees_per_hour=settings.degrees_per_hour,
    )


class MotorBook:
    """Keeps the counts: in their file, and in the log, topic ``/motor``.

    Parameters
    ----------
    path : Path
    now : callable
        The counts as they are, and the settings in force.
    log : EventLog
    clock : Clock
    """

    def __init__(self, path: Path, now: Callable[[], tuple[Travel, Motor]], log: EventLog, clock: Clock) -> None:
        self._file = KeptFile(path)
        self._now = now
        self._log = log
        self._clock = clock
        self._written = b""

    async def run(self) -> None:
        """Keep them until cancelled."""
        while True:
            await asyncio.sleep(EVERY_S)
            await self.keep()

    async def keep(self) -> None:
        """Write them if they have changed; a disk that takes none is told once, and tried again."""
        travel, settings = self._now()
        encoded = msgspec.json.encode(_Document(ptzd_motor=1, travel=replace(travel, counted=None)))
        if encoded == self._written:
            return
        t_ns = self._clock.now_ns()
        self._log.document("/motor", t_ns, msgspec.to_builtins(motor_status(travel, settings, t_ns)))
        if await self._file.write(encoded):
            self._written = encoded
