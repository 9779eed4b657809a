"""Which poses of the head a zone takes, with the room that is kept around it."""

from __future__ import annotations

import math

import numpy as np

from ptzd.control.planning.grid import CELL_DEG, cells_of
from ptzd.geometry.head import HeadModel
from ptzd.geometry.outline import Outline
from ptzd.geometry.types import Array, Mask
from ptzd.geometry.zones import STEP_RAD, along, covers
from ptzd.model import HeadLimits

MARGIN_DEG = 0.5
"""Kept from a zone's border: the swing after braking, the encoder's step, what counts as arrived."""


def taken_by(outlines: tuple[Outline, ...], head: HeadModel, limits: HeadLimits, axes: Array) -> Mask:
    """Which cells hold a pose whose optical axis is in a zone or less than the margin away from it.

    Parameters
    ----------
    outlines : tuple of Outline
        Of the zone, in the head frame.
    head, limits
        Whose poses.
    axes : Array
        ``(rows, columns, 3)`` as by `cell_axes`.
    """
    inside = covers(outlines, axes.reshape(-1, 3)).reshape(axes.shape[:2])
    # what is thinner than a cell holds no middle of one, but its border passes through it
    pan, tilt = head.aim_all(along(outlines, STEP_RAD / 2))
    pan_deg, tilt_deg = head.pan.vapix_deg(pan), head.tilt.vapix_deg(tilt)
    low, high = limits.tilt_deg
    for turn_deg in (-360.0, 0.0, 360.0):
        pans = pan_deg + turn_deg / head.pan.scale
        within = (pans >= _pans(limits)[0]) & (pans <= _pans(limits)[1]) & (tilt_deg >= low) & (tilt_deg <= high)
        inside[cells_of(limits, pans[within], tilt_deg[within])] = True
    return _grown(inside, head, limits)


def _pans(limits: HeadLimits) -> tuple[float, float]:
    return (-180.0, 180.0) if limits.endless_pan else limits.pan_deg


def _grown(cells: Mask, head: HeadModel, limits: HeadLimits) -> Mask:
    """Every cell with a pose closer than the margin to one of a taken cell."""
    scale = max(head.pan.scale, head.tilt.scale)
    askew_deg = math.degrees(math.hypot(*head.camera_rotvec_rad))
    margin_deg = MARGIN_DEG + math.degrees(STEP_RAD) / 2 + askew_deg
    down = math.ceil(margin_deg / (head.tilt.scale * CELL_DEG)) + 1
    rows, columns = cells.shape
    by_rows = np.zeros_like(cells)
    for step in range(-down, down + 1):
        low, high = max(step, 0), min(rows + step, rows)
        by_rows[low:high] |= cells[low - step : high - step]
    tilt = np.abs(
        head.tilt.angle_rad(np.asarray(limits.tilt_deg[0] + (np.arange(rows) + 0.5) * CELL_DEG, dtype=np.float64))
    )
    nearest_pole = np.cos(np.minimum(tilt + math.radians(margin_deg + scale * CELL_DEG), math.pi / 2))
    aside = np.ceil(margin_deg / (head.pan.scale * CELL_DEG * np.maximum(nearest_pole, 1e-3))).astype(int) + 1
    grown = np.empty_like(cells)
    for row, reach in enumerate(np.minimum(aside, columns)):
        grown[row] = _aside(by_rows[row], int(reach), wraps=limits.endless_pan)
    return grown


def _aside(row: Mask, reach: int, *, wraps: bool) -> Mask:
    """Which cells have a taken one at most ``reach`` away, in one row."""
    padded = np.pad(row, reach, mode="wrap" if wraps else "constant")
    before = np.concatenate([[0], padded.cumsum()])
    return np.asarray(before[2 * reach + 1 :] > before[: len(row)])
