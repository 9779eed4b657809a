"""`ptzd calibrate drift`: what the locks in logs say of a calibration, and on request a rig turned back onto them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from ptzd.calibrate.locks import ConfirmedLocks
from ptzd.calibrate.parts import Outcome
from ptzd.calibrate.rig import write_rig
from ptzd.calibration.drift import DriftMonitor, Lock, refined
from ptzd.calibration.file import load_provenance, load_rig
from ptzd.errors import CalibrationError
from ptzd.geometry.rig import Rig
from ptzd.log.reader import LoggedCommand, LogReader


def locks_of(log: Path, rig: Rig) -> Iterator[Lock]:
    """Confirmed locks of a log, as they were asked for and found."""
    confirmed = ConfirmedLocks(rig)
    with LogReader(log) as reader:
        for logged in reader.decisions():
            lock = confirmed.told(logged.command if isinstance(logged, LoggedCommand) else logged.event)
            if lock is not None:
                yield lock


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
