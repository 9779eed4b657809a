"""JPEGs as cameras send them: real photographs of the scene ``pair_hall``, with a sensor's noise, of any size."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

PANORAMA = Path(__file__).parents[2] / "ptzd" / "sim" / "scenes" / "pair_hall" / "fisheye.png"
QUALITY = 90
NOISE_SIGMA = 4.0
"""Grey levels: an indoor camera's."""


def photos(width: int, height: int, count: int) -> list[bytes]:
    """JPEG bytes, each of another piece of the panorama."""
    panorama = cv2.imread(str(PANORAMA))
    assert panorama is not None, PANORAMA
    high = panorama.shape[0]
    wide = high * width // height
    doubled = np.hstack([panorama, panorama])
    chance = np.random.default_rng(1)
    made = []
    for number in range(count):
        left = number * panorama.shape[1] // count
        piece = cv2.resize(doubled[:, left : left + wide], (width, height), interpolation=cv2.INTER_CUBIC)
        noisy = np.clip(piece + chance.normal(0.0, NOISE_SIGMA, piece.shape), 0, 255).astype(np.uint8)
        made.append(cv2.imencode(".jpg", noisy, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes())
    return made
