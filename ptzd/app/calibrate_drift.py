"""`ptzd calibrate drift`: what the locks in logs say of a calibration, and on request a rig turned back onto them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ptzd.app.calibrate_rig import write_rig
from ptzd.app.calibrating import Outcome
from ptzd.calibration.drift import DriftMonitor, Lock, refined
from ptzd.calibration.file import load_provenance, load_rig
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.log.reader import LoggedCommand, LogReader
from ptzd.model import Box
from ptzd.model import Outcome as End

CONFIRMED = (End.LOCKED, End.RELEASED)


def locks_of(log: Path, rig: Rig) -> Iterator[Lock]:
    """Confirmed locks of a log, as they were asked for and found."""
    boxes: dict[str, Box] = {}
    with LogReader(log) as reader:
        for logged in reader.decisions():
            told = logged.command if isinstance(logged, LoggedCommand) else logged.event
            if isinstance(told, ev.RequestReceived):
                boxes.setdefault(told.id, told.box)
            elif isinstance(told, cmd.PublishResult) and told.outcome in CONFIRMED and told.id in boxes:
                ray, valid = rig.fisheye.lift(np.array(boxes[told.id].centre))
                if told.pan_deg is None or told.tilt_deg is None or not valid:
                    continue
                direction = bearing(math.radians(told.pan_deg), math.radians(told.tilt_deg))
                near = 0.0 if told.range_m is None else 1.0 / told.range_m
                yield Lock(ray=ray, direction=direction, band_rad=rig.band_rad(near))


def drift(logs: Sequence[Path], calibration: Path, out: Path | None) -> Outcome:
    """Say whether the median offset has left the band; with ``out`` also write the refined rig there.

    The calibration that was used stays as it is; its name is kept in the new one's provenance.
    """
    rig = load_rig(calibration)
    monitor = DriftMonitor(rig)
    told = [monitor.add(lock) for log in logs for lock in locks_of(log, rig)]
    if not told:
        raise CalibrationError(f"{logs[0]}: no confirmed lock in {len(logs)} log(s); drift is measured on locks")
    last = told[-1]
    state = "DRIFTED: run with --out to turn the rig, or calibrate it again" if last.drifted else "within the band"
    lines = [
        f"drift: median {math.degrees(last.median_rad):+.3f}° ± {math.degrees(last.sigma_rad):.3f}° across the arc in "
        f"{last.count} locks, band ±{math.degrees(last.band_rad):.3f}°: {state}"
    ]
    document: dict[str, object] = {"locks": last.count, "median_deg": math.degrees(last.median_rad)}
    document["drifted"] = last.drifted
    if out is None:
        return Outcome(lines=tuple(lines), document=document, written=())
    if out.resolve() == calibration.resolve():
        raise CalibrationError(
            f"--out {out}: is the calibration in use; give another name, so that it can be taken back"
        )
    better, turn = refined(rig, monitor.locks)
    before = {"refined_from": calibration.name, "turned_deg": math.degrees(turn), "locks": last.count}
    written = write_rig(better, out, {**before, "before": load_provenance(calibration)})
    lines.append(
        f"R turned by {math.degrees(turn):.3f}°; put {out} in place of {calibration} to use it, and back to undo it"
    )
    return Outcome(lines=tuple(lines), document=document, written=(written,))
