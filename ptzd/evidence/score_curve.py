"""How well the region agrees with a view at every place along its arc: the curve that a person judges a match by.

It is computed anew from the recorded pictures by the plainest of scores, the zero-mean normalised correlation of the
box's pixels moved along the arc at the found offset across it: a second opinion, not what the matcher decided on.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.control.events import MatchFinished
from ptzd.evidence.arcs import arc_of
from ptzd.evidence.story import Look
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import cross, rotation_from_rotvec
from ptzd.geometry.types import Array, in_picture, pixel_angle_rad

SIDE = 32
"""Samples along each side of the box."""
PLACES = 300
LEAST_IN_VIEW = 0.5
"""Share of the samples that must fall into the view for a place to have a score."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """Score over the arc."""

    inverse_range: Array
    """Shape (k,), in the inverse unit of T."""
    angle_deg: Array
    """Along the arc from infinitely far, shape (k,)."""
    score: Array
    """In [-1, 1]; NaN where too little of the region falls into the view."""


def score_along(rig: Rig, look: Look, fisheye: NDArray[np.uint8], view: NDArray[np.uint8]) -> Curve | None:
    """Curve of one look.

    Parameters
    ----------
    rig : Rig
        Calibration of the log.
    look : Look
        Which box, frame, view and interval.
    fisheye, view : array
        Grey pictures, shape (h, w).

    Returns
    -------
    Curve or None
        None where the box's centre is no ray of the fisheye or the arc is a point.
    """
    arc = arc_of(rig, look.job)
    if arc is None or arc.degenerate:
        return None
    x, y = np.meshgrid(np.linspace(0, 1, SIDE), np.linspace(0, 1, SIDE))
    box = look.job.box
    pixels = np.stack([box.x + x.ravel() * box.w, box.y + y.ravel() * box.h], axis=-1)
    rays, valid = rig.fisheye.lift(pixels)
    wanted = _sample(fisheye, pixels)
    camera = rig.camera(look.job.view.reading)
    finer = pixel_angle_rad(rig.fisheye, box.centre) / pixel_angle_rad(camera, (camera.cx, camera.cy))
    smooth = np.asarray(cv2.GaussianBlur(view, (0, 0), max(finer / 2.0, 0.3)), np.uint8)
    across = _offset(look)
    first, last = arc.angle_at([arc.s_min, arc.s_max]).tolist()
    angles = np.linspace(first, last, PLACES)
    inverse = np.clip(arc.inverse_range_at(angles), arc.s_min, arc.s_max)
    scores = np.full(PLACES, np.nan)
    for index, s in enumerate(inverse):
        turn = rotation_from_rotvec(cross(arc.bearing(s), arc.normal) * across)
        moved = (rays @ rig.head_from_fisheye_rotation.T + s * arc.translation) @ turn.T
        seen, ahead = rig.project_to_view(moved, look.job.view.reading)
        usable = valid & ahead & in_picture(camera, seen, 0.5)
        if usable.mean() >= LEAST_IN_VIEW:
            scores[index] = _correlation(wanted[usable], _sample(smooth, seen)[usable])
    return Curve(inverse_range=inverse, angle_deg=np.degrees(angles), score=scores)


def _offset(look: Look) -> float:
    if isinstance(look.answer, MatchFinished) and look.answer.result.candidates:
        return look.answer.result.candidates[0].offset_rad
    return 0.0


def _sample(grey: NDArray[np.uint8], pixels: Array) -> Array:
    x, y = np.ascontiguousarray(pixels.T, np.float32)[:, :, None]
    values = cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(values, np.float64).ravel()


def _correlation(one: Array, other: Array) -> float:
    one, other = one - one.mean(), other - other.mean()
    below = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(one @ other) / below if below > 0.0 else 0.0
