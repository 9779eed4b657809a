"""The head's angles as rotations with derivatives: what is estimated of a head, and what is fixed by definition.

The frame `head` is defined by the head itself: its y axis is the pan axis, and pan 0 is where the camera reports 0. So
the pan offset is 0, the camera's turn about the tilt axis goes into the tilt offset, and five numbers are left
(Agapito, Hayman & Reid 2001, "Self-calibration of rotating and zooming cameras", with the angles known).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ptzd.calibration.bundle import rotations
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.types import Array

NEUTRAL = np.array([1.0, 1.0, 0.0, 0.0, 0.0])
PRIOR_SIGMA = np.array([0.003, 0.003, 0.5, 0.2, 0.5])
"""Encoders count true to a fraction of a percent; a camera sits on its axis to some degrees."""
_STEP = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Signs:
    """Directions of counting, +1 or -1."""

    pan: int = 1
    tilt: int = 1


ALL_SIGNS = tuple(Signs(pan=pan, tilt=tilt) for pan in (1, -1) for tilt in (1, -1))


def head_rotations(values: Array, signs: Signs, angles: Array) -> Array:
    """``head_from_camera`` ``(n, 3, 3)`` of reported pan and tilt ``(n, 2)``, rad."""
    zero = np.zeros(len(angles))
    pan = signs.pan * values[0] * angles[:, 0]
    tilt = signs.tilt * values[1] * angles[:, 1] + values[2]
    seat = rotations(np.array([[0.0, values[3], values[4]]]))[0]
    turned: Array = rotations(np.stack([zero, pan, zero], -1)) @ rotations(np.stack([tilt, zero, zero], -1)) @ seat
    return turned


def head_derivatives(values: Array, signs: Signs, angles: Array) -> Array:
    """Derivatives of `head_rotations` ``(5, n, 3, 3)`` by central differences."""
    steps = np.eye(len(values)) * _STEP
    return np.stack(
        [
            (head_rotations(values + step, signs, angles) - head_rotations(values - step, signs, angles)) / (2 * _STEP)
            for step in steps
        ]
    )


def head_model(values: Array, signs: Signs) -> HeadModel:
    """The head of the numbers."""
    return HeadModel(
        pan=Axis(sign=signs.pan, scale=float(values[0])),
        tilt=Axis(sign=signs.tilt, scale=float(values[1]), offset_rad=float(values[2])),
        camera_rotvec_rad=(0.0, float(values[3]), float(values[4])),
    )
