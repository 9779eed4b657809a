"""The camera model every part of the geometry speaks to, and what follows from any such model."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ptzd.errors import GeometryError

Array = NDArray[np.float64]
"""Any real array; shapes are in the docstrings."""
Mask = NDArray[np.bool_]
"""Validity of each entry of an array beside it."""


class CameraModel(Protocol):
    """A central camera: every pixel of the valid set is one ray through one point.

    The camera frame is x right, y down, z along the optical axis; pixel (0, 0) is the centre of the top-left pixel.
    """

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture, px."""

    @property
    def limit_rad(self) -> float:
        """Largest angle off the optical axis that the model can lift and project, rad."""

    def lift(self, pixels: ArrayLike) -> tuple[Array, Mask]:
        """Rays ``(..., 3)`` of unit length for pixels ``(..., 2)``, and a mask; invalid entries are zero."""

    def project(self, rays: ArrayLike) -> tuple[Array, Mask]:
        """Pixels ``(..., 2)`` for rays ``(..., 3)`` of any length, and a mask; invalid entries are zero.

        The mask says that the ray is in the model's valid set, not that the pixel is inside the picture:
        see `in_picture`.
        """


def checked(value: ArrayLike, last: int, name: str) -> Array:
    """Return the value as a float64 array whose last axis has ``last`` entries.

    Raises
    ------
    GeometryError
        With the shape, when the last axis is of another length.
    """
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != last:
        raise GeometryError(f"{name}: expected shape (..., {last}), got {array.shape}")
    return array


def in_picture(camera: CameraModel, pixels: ArrayLike, margin_px: float = 0.0) -> Mask:
    """Tell which pixels lie in the picture, whose area is ``[-0.5, w - 0.5] x [-0.5, h - 0.5]``.

    Parameters
    ----------
    camera : CameraModel
        Whose picture.
    pixels : ArrayLike
        Shape ``(..., 2)``, px.
    margin_px : float
        Distance to keep from the border; 0.5 keeps bilinear sampling inside.
    """
    points = checked(pixels, 2, "pixels")
    width, height = camera.size_px
    low = margin_px - 0.5
    high = np.array([width, height]) - 0.5 - margin_px
    return np.asarray(((points >= low) & (points <= high)).all(axis=-1))


def pixel_angle_rad(camera: CameraModel, pixel: ArrayLike) -> float:
    """Return the angular size of a pixel: the square root of its solid angle, rad.

    Parameters
    ----------
    camera : CameraModel
        Which camera.
    pixel : ArrayLike
        Shape ``(2,)``, px.

    Raises
    ------
    GeometryError
        When the pixel's centre lies outside the valid set.
    """
    point = checked(pixel, 2, "pixel")
    rays, valid = camera.lift(point + np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5], [0.0, 0.0]]))
    if not valid[4]:
        raise GeometryError(f"pixel ({point[0]:g}, {point[1]:g}) lies outside the camera's valid set")
    # at the rim the half of the pixel that is inside stands for both
    reach = np.where(valid[:4, None], rays[:4], rays[4])
    sides = (reach[0::2] - reach[1::2]) * (2.0 / np.maximum(1.0 * valid[0:4:2] + valid[1:4:2], 1.0))[:, None]
    return math.sqrt(float(np.linalg.norm(np.cross(sides[0], sides[1]))))
