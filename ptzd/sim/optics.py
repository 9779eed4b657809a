"""The true lens over zoom: what the simulated camera's pictures obey and its calibration states."""

from __future__ import annotations

import math

import numpy as np

from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.sim.profile import SENSOR_PX, ZOOM_STEPS, Profile

CALIBRATED_ZOOMS = 24
"""Entries of the true zoom table: enough that interpolation in between errs by less than 1e-3 in focal length."""


def magnification(profile: Profile, zoom: float) -> float:
    """True magnification at a zoom position, 1 at the wide end; positions past the optical end are digital zoom."""
    u = min(zoom - 1, ZOOM_STEPS - 1) / (ZOOM_STEPS - 1)
    optical = (1 + u * (profile.max_magnification - 1)) * (1 + profile.optics.bend * math.sin(math.pi * u))
    return optical * max(zoom / ZOOM_STEPS, 1.0)


def focal_px(profile: Profile, zoom: float, size_px: tuple[int, int]) -> float:
    """True focal length in px of a picture of ``size_px``: the sensor's middle, scaled to cover the picture."""
    half = math.tan(math.radians(profile.optics.hfov_wide_deg) / 2)
    scale = max(size_px[0] / SENSOR_PX[0], size_px[1] / SENSOR_PX[1])
    return SENSOR_PX[0] / 2 / half * scale * magnification(profile, zoom)


def camera_at(profile: Profile, zoom: float, size_px: tuple[int, int]) -> PerspectiveCamera:
    """True camera model at a zoom position."""
    optics = profile.optics
    u = (min(max(zoom, 1.0), ZOOM_STEPS) - 1) / (ZOOM_STEPS - 1)
    wide, tele = np.array(optics.centre_wide_px), np.array(optics.centre_tele_px)
    centre = (np.array(size_px) - 1) / 2 + size_px[0] * (wide + u * (tele - wide))
    focal = focal_px(profile, zoom, size_px)
    k1 = optics.k1_wide / magnification(profile, zoom)
    return PerspectiveCamera(
        size_px=size_px,
        fx=focal,
        fy=focal,
        cx=float(centre[0]),
        cy=float(centre[1]),
        distortion=(k1, -0.2 * k1, 0.0, 0.0, 0.0),
    )


def calibrated_zooms(profile: Profile) -> tuple[int, ...]:
    """Zoom positions of the true zoom table, evenly spread in log magnification."""
    top = profile.max_magnification
    shares = (np.geomspace(1.0, top, CALIBRATED_ZOOMS) - 1) / (top - 1)
    return tuple(sorted({round(1 + share * (ZOOM_STEPS - 1)) for share in shares.tolist()}))


def hfov_deg(profile: Profile, zoom: float, size_px: tuple[int, int]) -> float:
    """True horizontal field of view, deg."""
    return math.degrees(camera_at(profile, zoom, size_px).hfov_rad)
