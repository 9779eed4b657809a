"""Looking grey values up at any number of places: ``remap`` takes tables of less than 32,767 rows and columns."""

from __future__ import annotations

import cv2
import numpy as np

from ptzd.matching.arrays import Floats

MOST_ROWS = 16_384
"""Rows of one call; OpenCV asserts that every side is below ``SHRT_MAX``, 32,767 (imgproc, ``remap``)."""


def look_up(picture: Floats, x: Floats, y: Floats) -> Floats:
    """Interpolate a picture bilinearly; beyond its rim the nearest pixel goes on.

    Parameters
    ----------
    picture : float32 or uint8 (h, w) or (h, w, channels)
        Sides below 32,767 px.
    x, y : float32 (k, n)
        Places, px; any k, n below 32,767.

    Returns
    -------
    (k, n) or (k, n, channels)
        Of the picture's type; the same whatever k, place by place.
    """
    blocks = [
        cv2.remap(
            picture,
            x[start : start + MOST_ROWS],
            y[start : start + MOST_ROWS],
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
        for start in range(0, len(x), MOST_ROWS)
    ]
    if len(blocks) == 1:
        return blocks[0]
    return np.concatenate(blocks) if blocks else np.zeros((*x.shape, *picture.shape[2:]), picture.dtype)
