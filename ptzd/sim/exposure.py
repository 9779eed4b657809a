"""From a moment to what a picture taken then shows: true poses, freeze, focus, exposure control."""

from __future__ import annotations

import math

from ptzd.sim.head import Pose
from ptzd.sim.imager import Exposure
from ptzd.sim.optics import focal_px
from ptzd.sim.unit import Unit

SHARP_PX = 0.25
"""Motion during an exposure that does not show."""
DEFOCUS_PX = 1.2
"""Blur of a 640 px wide picture right after a zoom."""
DEFOCUS_FADE_S = 0.5
GAIN_STEP = 0.15
GAIN_FADE_S = 0.8
E_FLIP_DEG = -90.0


def exposure_at(unit: Unit, t_s: float, size_px: tuple[int, int]) -> Exposure:
    """What a picture shows whose exposure has its middle at ``t_s``."""
    seen_s = _unfrozen(unit, t_s)
    middle = unit.head.optical(seen_s)
    sweep_px = _sweep_px(unit, seen_s, size_px)
    still = math.hypot(*sweep_px) < SHARP_PX and not unit.head.moving(seen_s)
    since_s = unit.head.since_zoom_s(seen_s) if unit.switches["autofocus"] == "on" else math.inf
    since_move_s = unit.head.since_move_s(seen_s)
    gain = GAIN_STEP * math.exp(-since_move_s / GAIN_FADE_S) if unit.settings.auto_exposure else 0.0
    return Exposure(
        pose=_rounded(middle) if still else middle,
        size_px=size_px,
        sweep_px=sweep_px if math.hypot(*sweep_px) >= SHARP_PX else (0.0, 0.0),
        defocus_px=DEFOCUS_PX * size_px[0] / 640 * max(1.0 - since_s / DEFOCUS_FADE_S, 0.0),
        gain=1.0 + gain if gain > 0.01 else 1.0,
        flipped=unit.settings.e_flip_tilt_deg is not None and middle.tilt_deg < E_FLIP_DEG,
    )


def _unfrozen(unit: Unit, t_s: float) -> float:
    """The moment that the encoder shows: with ImageFreeze, that before the present motion began."""
    freeze = unit.parameters["PTZ.UserAdv.U1.ImageFreeze"]
    frozen = freeze == "on" or (freeze == "auto" and unit.preset_move)
    return unit.head.motion_start_s(t_s) if frozen and unit.head.moving(t_s) else t_s


def _sweep_px(unit: Unit, t_s: float, size_px: tuple[int, int]) -> tuple[float, float]:
    """How far the middle of the picture moves during the exposure, (x, y)."""
    half_s = unit.settings.exposure_s / 2
    first, last = unit.head.optical(t_s - half_s), unit.head.optical(t_s + half_s)
    focal = focal_px(unit.profile, last.zoom, size_px)
    side = -1.0 if unit.profile.reversed_mount else 1.0
    pan = math.radians(math.remainder(last.pan_deg - first.pan_deg, 360.0)) * math.cos(math.radians(last.tilt_deg))
    return -side * pan * focal, side * math.radians(last.tilt_deg - first.tilt_deg) * focal


def _rounded(pose: Pose) -> Pose:
    """A pose at rest, to 1e-5 deg, so that equal pictures are rendered once."""
    return Pose(pan_deg=round(pose.pan_deg, 5), tilt_deg=round(pose.tilt_deg, 5), zoom=round(pose.zoom, 2))
