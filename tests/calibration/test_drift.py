from __future__ import annotations

import numpy as np
import pytest

from ptzd.calibration.drift import LEAST, DriftMonitor, Lock, offset_rad, refined
from ptzd.errors import CalibrationError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import normalise, rotation_from_rotvec, rotvec_from_rotation
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable

TRUE = rotation_from_rotvec([0.05, 0.1, 0.02])


def rig_with(rotation):
    return Rig(
        fisheye=UnifiedCamera(size_px=(640, 480), fx=270.0, fy=270.0, cx=320.0, cy=240.0, xi=1.1),
        zoom=ZoomTable(size_px=(640, 480), entries=(ZoomEntry(zoom=1.0, fx=500.0, fy=500.0, cx=320.0, cy=240.0),)),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=rotation,
        head_from_fisheye_translation=np.array([-0.5, -0.1, -0.05]),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=np.radians(0.1), translation=0.005, head_rad=np.radians(0.03)),
    )


def locks(count, seed=1, spread=0.7):
    rng = np.random.default_rng(seed)
    rays = normalise(np.column_stack([rng.uniform(-spread, spread, (count, 2)), np.ones(count)]))
    ranges = rng.uniform(1.5, 8.0, count)[:, None]
    directions = normalise(rays * ranges @ TRUE.T + [-0.5, -0.1, -0.05]) + rng.normal(0.0, 5e-4, (count, 3))
    band = np.radians(0.4)
    return [Lock(ray=r, direction=d, band_rad=band) for r, d in zip(rays, normalise(directions), strict=True)]


def test_a_true_rig_does_not_drift():
    monitor = DriftMonitor(rig_with(TRUE))
    assert not any(monitor.add(lock).drifted for lock in locks(60))


def test_a_turned_camera_is_told_and_put_right():
    turned = rotation_from_rotvec(np.radians([0.8, 0.0, 0.0])) @ TRUE
    monitor, kept = DriftMonitor(rig_with(turned)), locks(40)
    drift = [monitor.add(lock) for lock in kept]
    assert drift[-1].drifted
    assert not drift[LEAST - 2].drifted
    better, turn = refined(rig_with(turned), monitor.locks)
    assert np.degrees(turn) == pytest.approx(0.8, abs=0.2)
    before = np.median([abs(offset_rad(rig_with(turned), lock)) for lock in kept])
    after = np.median([abs(offset_rad(better, lock)) for lock in kept])
    assert after < 0.15 * before
    assert np.degrees(np.linalg.norm(rotvec_from_rotation(better.head_from_fisheye_rotation @ TRUE.T))) < 0.3


def test_few_close_or_wild_locks_change_nothing():
    rig = rig_with(TRUE)
    with pytest.raises(CalibrationError, match="at least"):
        refined(rig, locks(LEAST - 1))
    with pytest.raises(CalibrationError, match="close together"):
        refined(rig, locks(30, spread=0.02))
    moved = rig_with(rotation_from_rotvec(np.radians([9.0, 0.0, 0.0])) @ TRUE)
    with pytest.raises(CalibrationError, match="calibrate the rig again"):
        refined(moved, locks(40))
