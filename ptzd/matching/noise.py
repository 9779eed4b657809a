"""How noisy a picture is, and whether a region carries texture above that noise."""

from __future__ import annotations

import math

import cv2
import numpy as np

from ptzd.matching.arrays import Floats, Grey

TILE_PX = 16
TILES_PER_SIDE = 9
SIGMA_FLOOR = 0.7
"""Grey levels: rounding to 8 bit (0.29) and the quantisation of a JPEG of usual quality."""

_KERNEL = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], dtype=np.float32)


def noise_sigma(grey: Grey) -> float:
    """Estimate the sensor's noise from the quietest parts of a picture.

    Parameters
    ----------
    grey : uint8 (h, w)
        The picture.

    Returns
    -------
    float
        One sigma in grey levels, never below ``SIGMA_FLOOR``. Each tile is filtered with the difference of two
        Laplacians, which cancels ramps and straight edges (Immerkær 1996); a low quantile over the tiles passes over
        texture; tiles at the ends of the scale are left out.
    """
    height, width = grey.shape
    rows = np.linspace(0, max(height - TILE_PX, 0), TILES_PER_SIDE).astype(int)
    columns = np.linspace(0, max(width - TILE_PX, 0), TILES_PER_SIDE).astype(int)
    if min(height, width) < TILE_PX:
        return SIGMA_FLOOR
    windows = np.lib.stride_tricks.sliding_window_view(grey, (TILE_PX, TILE_PX))
    tiles = windows[rows[:, None], columns].reshape(-1, TILE_PX, TILE_PX)
    means = tiles.mean(axis=(1, 2))
    usable = tiles[(means > 8) & (means < 247)]
    if len(usable) == 0:
        return SIGMA_FLOOR
    stacked = usable.reshape(-1, tiles.shape[2])
    response = cv2.filter2D(stacked, cv2.CV_32F, _KERNEL).reshape(usable.shape)[:, 1:-1, 1:-1]
    powers = np.sort((response * response).mean(axis=(1, 2)))
    return max(math.sqrt(float(powers[len(powers) // 5])) / 6.0, SIGMA_FLOOR)


def texture_ratio(patch: Floats, sigma: float) -> float:
    """Texture of a region over the sensor's noise.

    Parameters
    ----------
    patch : float32 (h, w)
        Grey values of the region as the camera gave them.
    sigma : float
        Noise of one pixel, grey levels.

    Returns
    -------
    float
        Standard deviation of the smoothed region without its mean and slopes, noise subtracted, over the noise that
        the smoothing leaves; 0 for pure noise. Below 1 no matcher can tell this region from another.
    """
    smooth = cv2.GaussianBlur(patch, (0, 0), 1.0, borderType=cv2.BORDER_REFLECT_101)
    smooth = smooth - smooth.mean()
    variance = float(np.mean(smooth * smooth))
    # the two ramps are orthogonal on a grid: each takes its own share
    for profile in (smooth.mean(axis=0), smooth.mean(axis=1)):
        ramp = np.arange(len(profile)) - (len(profile) - 1) / 2
        variance -= float(profile @ ramp) ** 2 / float(ramp @ ramp) / len(profile)
    left = sigma / math.sqrt(4 * math.pi)
    return math.sqrt(max(variance - left * left, 0.0)) / left
