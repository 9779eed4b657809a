"""The PTZ picture brought to the fisheye's angular resolution, as an ideal pinhole."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.matching.arrays import Floats, Grey, Mask
from ptzd.matching.patch import SMOOTHING, pixel_angle

if TYPE_CHECKING:
    from ptzd.geometry.perspective import PerspectiveCamera
    from ptzd.geometry.types import Array

OVERSAMPLING = 2.0
"""Pixels of the working picture per grid step of the patch, at least, where the PTZ has them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkingView:
    """A low-passed PTZ picture without distortion."""

    image: Floats
    """(h, w) grey values; NaN where the PTZ picture has no pixel."""
    pixels_from_head: Array
    """(3, 3): homogeneous working px of a head-frame direction, ``K R``."""
    pixels_per_step: float
    """Working pixels per grid step of the patch, in the middle of the picture."""

    def sample(self, warps: Array, rays: Floats) -> Samples:
        """Look up rays under many warps.

        Parameters
        ----------
        warps : float64 (k, 3, 3)
            Head-frame direction of a pre-rotated fisheye ray under each hypothesis.
        rays : float32 (n, 3)
            Pre-rotated fisheye rays.
        """
        matrices = (self.pixels_from_head @ warps).astype(np.float32)
        homogeneous = (matrices.reshape(-1, 3) @ rays.T).reshape(len(warps), 3, len(rays))
        depth = homogeneous[:, 2]
        in_front = depth > 1e-6
        inverse = 1.0 / np.where(in_front, depth, 1.0)
        x, y = homogeneous[:, 0] * inverse, homogeneous[:, 1] * inverse
        height, width = self.image.shape
        inside = in_front & (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        grey = cv2.remap(self.image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        unknown = np.isnan(grey)
        if unknown.any():
            inside &= ~unknown
            grey[unknown] = 0.0
        return Samples(grey=grey, inside=inside, x=x, y=y, inverse_depth=inverse)


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Grey values of k hypotheses at n rays, all arrays (k, n)."""

    grey: Floats
    inside: Mask
    x: Floats
    y: Floats
    inverse_depth: Floats


def view_pixel_angle(camera: PerspectiveCamera) -> float:
    """Angle of the PTZ's pixel in the middle of its picture, rad."""
    return pixel_angle(camera, ((camera.size_px[0] - 1) / 2, (camera.size_px[1] - 1) / 2))


def prepare_view(
    grey: Grey,
    camera: PerspectiveCamera,
    camera_from_head: Array,
    step_rad: float,
    oversampling: float = OVERSAMPLING,
) -> WorkingView:
    """Low-pass and shrink a PTZ picture so that it shows what a grid step of the fisheye shows.

    Parameters
    ----------
    grey : uint8 (h, w)
        The PTZ picture.
    camera : PerspectiveCamera
        At the picture's zoom.
    camera_from_head : float64 (3, 3)
        Rotation at the picture's pose.
    step_rad : float
        Angle of a grid step of the patch.
    oversampling : float
        Least number of working pixels per grid step, as far as the PTZ has them.
    """
    factor = max(int(step_rad / (oversampling * view_pixel_angle(camera))), 1)
    height, width = grey.shape[0] // factor, grey.shape[1] // factor
    image: Floats = grey
    if factor > 1:
        image = cv2.resize(grey[: height * factor, : width * factor], (width, height), interpolation=cv2.INTER_AREA)
    focal_x, focal_y = camera.fx / factor, camera.fy / factor
    centre = ((camera.cx + 0.5) / factor - 0.5, (camera.cy + 0.5) / factor - 0.5)
    ratio = step_rad / (view_pixel_angle(camera) * factor)
    sigma = math.sqrt(max((ratio * ratio - 1.0) / 12.0, 0.0) + (SMOOTHING * ratio) ** 2)
    low = cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    if any(camera.distortion):
        low, centre = _straighten(low, camera, factor, (focal_x, focal_y))
    intrinsics = np.array([[focal_x, 0.0, centre[0]], [0.0, focal_y, centre[1]], [0.0, 0.0, 1.0]])
    return WorkingView(image=low, pixels_from_head=intrinsics @ camera_from_head, pixels_per_step=ratio)


def _straighten(
    image: Floats, camera: PerspectiveCamera, factor: int, focal: tuple[float, float]
) -> tuple[Floats, tuple[float, float]]:
    """Resample to the pinhole whose picture just holds every pixel of the distorted one."""
    width, height = camera.size_px
    along_x, along_y = np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 17)
    rim = np.concatenate(
        [np.stack([along_x, np.full(17, edge)], axis=1) for edge in (0, height - 1)]
        + [np.stack([np.full(17, edge), along_y], axis=1) for edge in (0, width - 1)]
    )
    rays, valid = camera.lift(rim)
    ideal = rays[valid, :2] / rays[valid, 2:] * np.array(focal)
    low, high = np.floor(ideal.min(axis=0)), np.ceil(ideal.max(axis=0))
    size = np.minimum(high - low + 1, 2 * np.array(image.shape[::-1])).astype(int)
    grid = np.stack(np.meshgrid(np.arange(size[0]) + low[0], np.arange(size[1]) + low[1]), axis=-1) / np.array(focal)
    pixels, known = camera.project(np.concatenate([grid, np.ones((*grid.shape[:2], 1))], axis=-1))
    pixels = (pixels + 0.5) / factor - 0.5
    known &= (pixels >= -0.25).all(axis=-1) & (pixels <= np.array(image.shape[::-1]) - 0.75).all(axis=-1)
    maps = pixels.astype(np.float32)
    straight = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    straight[~known] = np.nan
    return straight, (-float(low[0]), -float(low[1]))
