"""Confirmed locks, out of what the core was told and decided: what the calibration is judged by."""

from __future__ import annotations

import math

import numpy as np

from ptzd.calibration.drift import Lock
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.model import Box, Outcome

CONFIRMED = (Outcome.LOCKED, Outcome.RELEASED)


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
