"""From a moment to what a picture taken then shows: true poses, freeze, focus, exposure control."""

from __future__ import annotations

import math

from ptzd.sim.head import Pose
from ptzd.sim.imager import Exposure
from ptzd.sim.optics import focal_px
from ptzd.sim.unit import Unit

BLUR_SAMPLES = 3
DEFOCUS_PX = 1.2
"""Blur of a 640 px wide picture right after a zoom."""
DEFOCUS_FADE_S = 0.5
GAIN_STEP = 0.15
GAIN_FADE_S = 0.8
E_FLIP_DEG = -90.0


def exposure_at(unit: Unit, t_s: float, size_px: tuple[int, int]) -> Exposure:
    """What a picture shows whose exposure has its middle at ``t_s``."""
    seen_s = _unfrozen(unit, t_s)
    half_s = unit.settings.exposure_s / 2
    poses = tuple(unit.head.optical(seen_s + share * half_s) for share in (-1.0, 0.0, 1.0))
    middle = poses[1]
    still = _sweep_px(unit, poses, size_px) < 0.25
    since_s = unit.head.since_zoom_s(seen_s) if unit.switches["autofocus"] == "on" else math.inf
    since_move_s = unit.head.since_move_s(seen_s)
    gain = GAIN_STEP * math.exp(-since_move_s / GAIN_FADE_S) if unit.settings.auto_exposure else 0.0
    return Exposure(
        poses=(_rounded(middle),) if still else poses,
        size_px=size_px,
        defocus_px=DEFOCUS_PX * size_px[0] / 640 * max(1.0 - since_s / DEFOCUS_FADE_S, 0.0),
        gain=1.0 + gain if gain > 0.01 else 1.0,
        flipped=unit.settings.e_flip_tilt_deg is not None and middle.tilt_deg < E_FLIP_DEG,
    )


def _unfrozen(unit: Unit, t_s: float) -> float:
    """The moment that the encoder shows: with ImageFreeze, that before the present motion began."""
    freeze = unit.parameters["PTZ.UserAdv.U1.ImageFreeze"]
    frozen = freeze == "on" or (freeze == "auto" and unit.preset_move)
    return unit.head.motion_start_s(t_s) if frozen and unit.head.moving(t_s) else t_s


def _sweep_px(unit: Unit, poses: tuple[Pose, ...], size_px: tuple[int, int]) -> float:
    """How far the picture moves during the exposure."""
    first, last = poses[0], poses[-1]
    focal = focal_px(unit.profile, last.zoom, size_px)
    pan = math.remainder(last.pan_deg - first.pan_deg, 360.0)
    angle = math.radians(math.hypot(pan, last.tilt_deg - first.tilt_deg))
    zoomed = abs(focal / focal_px(unit.profile, first.zoom, size_px) - 1) * size_px[0] / 2
    return max(angle * focal, zoomed)


def _rounded(pose: Pose) -> Pose:
    """A pose at rest, to 1e-5 deg, so that equal pictures are rendered once."""
    return Pose(pan_deg=round(pose.pan_deg, 5), tilt_deg=round(pose.tilt_deg, 5), zoom=round(pose.zoom, 2))
