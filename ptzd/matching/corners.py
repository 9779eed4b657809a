"""Harris corners with sub-pixel places."""

from __future__ import annotations

import cv2
import numpy as np

from ptzd.matching.arrays import Floats

HARRIS_K = 0.04
WINDOW_STEPS = 3
CORNER_QUALITY = 0.01
"""Of the strongest response in the picture."""


def harris_corners(image: Floats, most: int, scale_px: float) -> Floats:
    """Find corners (Harris & Stephens 1988).

    Parameters
    ----------
    image : float32 (h, w)
        Grey values; NaN counts as flat.
    most : int
        Greatest number of corners, the strongest first.
    scale_px : float
        Pixels per step of the grid on which corners have to repeat: sets the window and the least distance.

    Returns
    -------
    float32 (m, 2)
        Places in px, to a fraction of a pixel by a parabola through the response.
    """
    known = np.nan_to_num(image, nan=float(np.nanmean(image)) if np.isfinite(image).any() else 0.0)
    response = cv2.cornerHarris(known, max(round(WINDOW_STEPS * scale_px), 2), 3, HARRIS_K)
    peak = float(response.max())
    if peak <= 0.0:
        return np.zeros((0, 2), np.float32)
    size = 2 * max(round(scale_px), 1) + 1
    local = cv2.dilate(response, np.ones((size, size), np.uint8))
    mask = (response >= local) & (response > CORNER_QUALITY * peak)
    mask[[0, -1]] = False
    mask[:, [0, -1]] = False
    rows, columns = np.nonzero(mask)
    order = np.argsort(-response[rows, columns], kind="stable")[:most]
    rows, columns = rows[order], columns[order]
    here = response[rows, columns]
    shift_x = _vertex(response[rows, columns - 1], here, response[rows, columns + 1])
    shift_y = _vertex(response[rows - 1, columns], here, response[rows + 1, columns])
    return np.stack([columns + shift_x, rows + shift_y], axis=1).astype(np.float32)


def _vertex(before: Floats, here: Floats, after: Floats) -> Floats:
    curvature = before - 2.0 * here + after
    shift = 0.5 * (before - after) / np.where(np.abs(curvature) > 0, curvature, 1.0)
    return np.clip(shift, -0.5, 0.5)
