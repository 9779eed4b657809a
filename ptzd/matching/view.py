"""The PTZ picture brought to the fisheye's angular resolution, as an ideal pinhole."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np

from ptzd.geometry.types import pixel_angle_rad
from ptzd.matching.arrays import Floats, Grey, Mask
from ptzd.matching.lookup import look_up
from ptzd.matching.patch import SMOOTHING

if TYPE_CHECKING:
    from ptzd.geometry.perspective import PerspectiveCamera
    from ptzd.geometry.types import Array

OVERSAMPLING = 2.0
"""Pixels of the working picture per grid step of the patch, at least, where the PTZ has them."""
MARGIN_SIGMAS = 3.0
"""Rim around an area of interest that the low-pass needs."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """Grey values of k hypotheses at n rays, all arrays (k, n)."""

    grey: Floats
    inside: Mask
    x: Floats
    y: Floats
    inverse_depth: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class WorkingView:
    """A low-passed PTZ picture without distortion."""

    image: Floats
    """(h, w) grey values; NaN where the PTZ picture has no pixel."""
    pixels_from_head: Array
    """(3, 3): homogeneous working px of a head-frame direction, ``K R``."""
    pixels_per_step: float
    """Working pixels per grid step of the patch, in the middle of the picture."""
    noise_gain: float
    """Sigma of a working pixel over sigma of a pixel of the PTZ's sensor."""
    gaps: bool
    """Whether there is a NaN."""
    _slopes: list[Floats] = field(default_factory=list)

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
        inverse = np.reciprocal(np.where(depth > 1e-6, depth, np.float32(np.nan)))
        x, y = homogeneous[:, 0] * inverse, homogeneous[:, 1] * inverse
        height, width = self.image.shape
        inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
        if not inside.all():
            x, y, inverse = (np.where(inside, part, np.float32(0.0)) for part in (x, y, inverse))
        grey = look_up(self.image, x, y)
        if self.gaps:
            unknown = np.isnan(grey)
            inside &= ~unknown
            grey[unknown] = 0.0
        return Samples(grey=grey, inside=inside, x=x, y=y, inverse_depth=inverse)

    def slopes(self, samples: Samples) -> tuple[Floats, Floats]:
        """Derivatives of the picture along x and y at samples, grey levels per working px."""
        if not self._slopes:
            known = np.nan_to_num(self.image)
            self._slopes.extend(
                cv2.sepFilter2D(known, cv2.CV_32F, kernel_x, kernel_y)
                for kernel_x, kernel_y in ((_SLOPE, _MEAN), (_MEAN, _SLOPE))
            )
        slope_x, slope_y = (look_up(slope, samples.x, samples.y) for slope in self._slopes)
        return slope_x, slope_y


_SLOPE = np.array([-0.5, 0.0, 0.5], np.float32)
_MEAN = np.array([0.25, 0.5, 0.25], np.float32)


def view_pixel_angle(camera: PerspectiveCamera) -> float:
    """Angle of the PTZ's pixel in the middle of its picture, rad."""
    return pixel_angle_rad(camera, ((camera.size_px[0] - 1) / 2, (camera.size_px[1] - 1) / 2))


def prepare_view(
    grey: Grey,
    camera: PerspectiveCamera,
    camera_from_head: Array,
    step_rad: float,
    oversampling: float = OVERSAMPLING,
    area_px: tuple[float, float, float, float] | None = None,
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
    area_px : (left, top, right, bottom), optional
        Only this part of the picture is wanted, px.
    """
    own_angle = 1.0 / math.sqrt(camera.fx * camera.fy)
    factor = max(int(step_rad / (oversampling * own_angle)), 1)
    ratio = step_rad / (own_angle * factor)
    sigma = math.sqrt(max((ratio * ratio - 1.0) / 12.0, 0.0) + (SMOOTHING * ratio) ** 2)
    left, top, right, bottom = _cells(area_px, grey.shape, factor, sigma)
    image: Floats = grey[top * factor : bottom * factor, left * factor : right * factor]
    if factor > 1:
        image = cv2.resize(image, (right - left, bottom - top), interpolation=cv2.INTER_AREA)
    low = cv2.GaussianBlur(image.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    focal = (camera.fx / factor, camera.fy / factor)
    centre = ((camera.cx + 0.5) / factor - 0.5 - left, (camera.cy + 0.5) / factor - 0.5 - top)
    if any(camera.distortion):
        low, centre = _straighten(low, camera, factor, (left, top))
    intrinsics = np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]])
    return WorkingView(
        image=low,
        pixels_from_head=intrinsics @ camera_from_head,
        pixels_per_step=ratio,
        gaps=any(camera.distortion),
        noise_gain=1.0 / (factor * sigma * math.sqrt(4.0 * math.pi)),
    )


def _cells(
    area: tuple[float, float, float, float] | None, shape: tuple[int, ...], factor: int, sigma: float
) -> tuple[int, int, int, int]:
    """Left, top, right, bottom of the area with its rim, in cells of ``factor`` px, inside the picture."""
    height, width = shape[0] // factor, shape[1] // factor
    if area is None:
        return 0, 0, width, height
    rim = MARGIN_SIGMAS * sigma + 2.0
    left, top = (min(max(int(v / factor - rim), 0), most - 8) for v, most in ((area[0], width), (area[1], height)))
    right = min(max(math.ceil(area[2] / factor + rim), left + 8), width)
    bottom = min(max(math.ceil(area[3] / factor + rim), top + 8), height)
    return left, top, right, bottom


def _straighten(
    image: Floats, camera: PerspectiveCamera, factor: int, corner: tuple[int, int]
) -> tuple[Floats, tuple[float, float]]:
    """Resample cells to the pinhole picture that just holds every one of them; also return its principal point."""
    height, width = image.shape
    focal = np.array([camera.fx, camera.fy]) / factor
    along_x, along_y = np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 17)
    rim = np.concatenate(
        [np.stack([along_x, np.full(17, edge)], axis=1) for edge in (0, height - 1)]
        + [np.stack([np.full(17, edge), along_y], axis=1) for edge in (0, width - 1)]
    )
    rays, valid = camera.lift((rim + corner + 0.5) * factor - 0.5)
    ideal = rays[valid, :2] / rays[valid, 2:] * focal
    low, high = np.floor(ideal.min(axis=0)), np.ceil(ideal.max(axis=0))
    size = np.minimum(high - low + 1, 2 * np.array([width, height])).astype(int)
    grid = np.stack(np.meshgrid(np.arange(size[0]) + low[0], np.arange(size[1]) + low[1]), axis=-1) / focal
    pixels, known = camera.project(np.concatenate([grid, np.ones((*grid.shape[:2], 1))], axis=-1))
    cells = (pixels + 0.5) / factor - 0.5 - corner
    known &= (cells >= -0.25).all(axis=-1) & (cells <= np.array([width, height]) - 0.75).all(axis=-1)
    maps = cells.astype(np.float32)
    straight = look_up(image, maps[..., 0], maps[..., 1])
    straight[~known] = np.nan
    return straight, (-float(low[0]), -float(low[1]))
