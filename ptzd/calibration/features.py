"""Features of a scene matched between pictures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.calibration.detect import Grey
from ptzd.geometry.types import Array

MOST = 500
FEW = 150
"""With fewer features the picture is looked at again, softer and at less contrast: a long lens shows little detail."""
RATIO = 0.8
"""Lowe 2004: a match counts when the second best is this much worse."""
HOMOGRAPHY_PX = 3.0
MIN_INLIERS = 14
Descriptors = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True)
class Features:
    """Points of one picture and their descriptions."""

    pixels: Array
    """``(n, 2)`` px of the original picture."""
    descriptors: Descriptors
    """``(n, 128)``, square-rooted SIFT (Arandjelović & Zisserman 2012)."""


def find_features(grey: Grey, *, share: float = 1.0, most: int = MOST, contrast: float = 0.015) -> Features:
    """SIFT features of a picture, looked for at ``share`` of its size.

    Parameters
    ----------
    grey : Grey
        ``(h, w)`` uint8.
    share : float
        At most 1: the picture is shrunk first, to the sharpness of another camera's.
    most : int
        Strongest so many.
    contrast : float
        SIFT's contrast threshold.
    """
    small = grey if share == 1.0 else cv2.resize(grey, None, fx=share, fy=share, interpolation=cv2.INTER_AREA)
    points, descriptors = _sift(most, contrast).detectAndCompute(small, None)
    if len(points) < FEW:
        softer = cv2.GaussianBlur(small, (0, 0), 1.6)
        points, descriptors = _sift(most, contrast / 4).detectAndCompute(softer, None)
    if descriptors is None or len(points) == 0:
        return Features(pixels=np.zeros((0, 2)), descriptors=np.zeros((0, 128), np.float32))
    pixels = (np.array([point.pt for point in points]) + 0.5) / share - 0.5
    size = np.abs(descriptors).sum(axis=1, keepdims=True)
    return Features(pixels=pixels, descriptors=np.sqrt(descriptors / np.maximum(size, 1e-9)).astype(np.float32))


def _sift(most: int, contrast: float) -> Any:  # noqa: ANN401 - a cv2 object
    """SIFT whose doubled first octave keeps its pixel centres: without it every point is a quarter of a pixel off."""
    create: Any = cv2.SIFT_create  # type: ignore[attr-defined]
    return create(nfeatures=most, contrastThreshold=contrast, enable_precise_upscale=True)


def match(one: Features, other: Features, *, ratio: float = RATIO) -> NDArray[np.int64]:
    """Index pairs ``(m, 2)``: best both ways, and clearly better than the second."""
    if min(len(one.pixels), len(other.pixels)) < 2:
        return np.zeros((0, 2), np.int64)
    likeness = one.descriptors @ other.descriptors.T
    rows = np.arange(len(likeness))
    best = likeness.argmax(axis=1)
    top = likeness[rows, best]
    likeness[rows, best] = -1.0
    second = likeness.max(axis=1)
    likeness[rows, best] = top
    mutual = likeness.argmax(axis=0)[best] == rows
    clear = np.sqrt(np.maximum(2 - 2 * top, 0)) < ratio * np.sqrt(np.maximum(2 - 2 * second, 0))
    chosen = np.flatnonzero(mutual & clear)
    return np.stack([chosen, best[chosen]], axis=-1)


def match_turned(one: Features, other: Features) -> NDArray[np.int64]:
    """Matches ``(m, 2)`` between two pictures of one camera that only turned or zoomed: those of one homography."""
    pairs = match(one, other)
    if len(pairs) < MIN_INLIERS:
        return pairs[:0]
    cv2.setRNGSeed(1)
    first, second = one.pixels[pairs[:, 0]], other.pixels[pairs[:, 1]]
    matrix, inside = cv2.findHomography(first, second, cv2.RANSAC, HOMOGRAPHY_PX, maxIters=2000, confidence=0.999)
    if matrix is None or int(inside.sum()) < MIN_INLIERS:
        return pairs[:0]
    return pairs[np.asarray(inside).ravel() > 0]
