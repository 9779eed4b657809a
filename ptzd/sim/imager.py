"""What the simulated lenses see: pictures of true poses, with blur, noise and JPEG. Runs in worker threads."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.geometry.head import HeadModel
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import CameraModel
from ptzd.model import HeadReading
from ptzd.sim.head import Pose
from ptzd.sim.optics import camera_at
from ptzd.sim.profile import Profile
from ptzd.sim.scene import Scene

Pixels = NDArray[np.uint8]
Rays = NDArray[np.float32]

GRID_STEP_PX = 8
"""Rays are exact on this grid and linear in between: under 0.01 px for the distortions of the profiles."""
MAX_SMEAR_PX = 40.0
"""Longer smears look the same and cost more."""
_KEPT = 4
_NOISE_MARGIN_PX = 64


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """What one picture shows."""

    pose: Pose
    """True pose at the middle of the exposure."""
    size_px: tuple[int, int]
    sweep_px: tuple[float, float] = (0.0, 0.0)
    """How far the picture moves during the exposure, (x, y); 0 when the head rests."""
    defocus_px: float = 0.0
    """Sigma of the blur of a lens that has not focused yet."""
    gain: float = 1.0
    flipped: bool = False
    """The picture is turned by 180° (E-flip)."""


class Noise:
    """Seeded sensor noise: a pool of grey normal noise, cut out at another place for every picture."""

    def __init__(self, sigma: float, seed: int, size_px: tuple[int, int]) -> None:
        self.sigma = sigma
        self._random = np.random.default_rng(seed)
        shape = (size_px[1] + _NOISE_MARGIN_PX, size_px[0] + _NOISE_MARGIN_PX)
        grey = np.rint(self._random.normal(0.0, max(sigma, 1e-9), shape)).astype(np.int16)
        self._pool = cv2.merge([grey, grey, grey])

    def on(self, picture: Pixels) -> Pixels:
        """The picture with noise."""
        if self.sigma <= 0:
            return picture
        x, y = self._random.integers(0, _NOISE_MARGIN_PX, 2).tolist()
        height, width = picture.shape[:2]
        noisy = cv2.add(picture, self._pool[y : y + height, x : x + width], dtype=cv2.CV_8U)
        return np.asarray(noisy, np.uint8)


def encode(picture: Pixels, quality: int) -> bytes:
    """JPEG of a BGR picture."""
    done, data = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"cannot encode a picture of shape {picture.shape}")
    return bytes(data)


def quality_of(compression: int) -> int:
    """JPEG quality of VAPIX' compression 0…100."""
    return round(95 - 0.85 * compression)


class PtzEye:
    """Renders pictures of the PTZ camera.

    Parameters
    ----------
    scene : Scene
    profile : Profile
    head : HeadModel
        The true mount: VAPIX degrees to the frame `head`.
    noise_sigma : float
    seed : int
    """

    def __init__(self, scene: Scene, profile: Profile, head: HeadModel, *, noise_sigma: float, seed: int) -> None:
        self._scene = scene
        self._profile = profile
        self._head = head
        self._noise_sigma = noise_sigma
        self._seed = seed
        self._noise: dict[tuple[int, int], Noise] = {}
        self._rays: OrderedDict[tuple[float, tuple[int, int]], Rays] = OrderedDict()
        self._still: OrderedDict[tuple[Pose, tuple[int, int]], Pixels] = OrderedDict()
        self._lock = threading.Lock()

    def jpeg(self, exposure: Exposure, *, quality: int, rotation: int) -> bytes:
        """Noisy JPEG of an exposure, turned by a multiple of 90°."""
        with self._lock:
            clean = self.clean(exposure)
            noise = self._noise.get(exposure.size_px)
            if noise is None:
                noise = self._noise[exposure.size_px] = Noise(self._noise_sigma, self._seed, exposure.size_px)
            noisy = noise.on(clean)
        quarter_turns = (rotation // 90 + 2 * exposure.flipped) % 4
        return encode(np.ascontiguousarray(np.rot90(noisy, -quarter_turns)), quality)

    def clean(self, exposure: Exposure) -> Pixels:
        """The picture before noise."""
        if exposure.sweep_px == (0.0, 0.0):
            picture = self._still_at(exposure.pose, exposure.size_px)
        else:
            picture = smeared(self._render(exposure.pose, exposure.size_px), exposure.sweep_px)
        if exposure.defocus_px > 0.1:
            picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), exposure.defocus_px), np.uint8)
        if exposure.gain != 1.0:
            picture = np.asarray(cv2.convertScaleAbs(picture, alpha=exposure.gain), np.uint8)
        return picture

    def _still_at(self, pose: Pose, size_px: tuple[int, int]) -> Pixels:
        key = (pose, size_px)
        if key not in self._still:
            self._still[key] = self._render(pose, size_px)
            while len(self._still) > _KEPT:
                self._still.popitem(last=False)
        return self._still[key]

    def _render(self, pose: Pose, size_px: tuple[int, int]) -> Pixels:
        camera = camera_at(self._profile, pose.zoom, size_px)
        key = (round(pose.zoom, 2), size_px)
        if key not in self._rays:
            self._rays[key] = camera_rays(camera)
            while len(self._rays) > _KEPT:
                self._rays.popitem(last=False)
        reading = HeadReading(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom)
        head_from_camera = self._head.head_from_camera(*self._head.pan_tilt_from_vapix(reading))
        rays = np.asarray(cv2.transform(self._rays[key], head_from_camera.astype(np.float32)), np.float32)
        return self._scene.sample_ptz(rays, 1.0 / camera.fx)


def camera_rays(camera: PerspectiveCamera) -> Rays:
    """Rays ``(H, W, 3)`` of every pixel, in the camera's frame, of unit length to 1e-4."""
    width, height = camera.size_px
    columns, rows = -(-width // GRID_STEP_PX) + 1, -(-height // GRID_STEP_PX) + 1
    nodes = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1) * float(GRID_STEP_PX)
    coarse, valid = camera.lift(nodes)
    if not valid.all():
        raise ValueError("the lens distortion folds inside the picture")
    step = np.float32(1 / GRID_STEP_PX)
    x, y = np.meshgrid(np.arange(width, dtype=np.float32) * step, np.arange(height, dtype=np.float32) * step)
    return np.asarray(cv2.remap(coarse.astype(np.float32), x, y, cv2.INTER_LINEAR), np.float32)


def smeared(picture: Pixels, sweep_px: tuple[float, float]) -> Pixels:
    """The picture moved evenly by ``sweep_px`` while it was exposed."""
    length = min(math.hypot(*sweep_px), MAX_SMEAR_PX)
    scale = length / math.hypot(*sweep_px)
    half = math.ceil(length / 2)
    kernel = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for share in np.linspace(-0.5, 0.5, 4 * half + 1).tolist():
        column, row = half + share * scale * sweep_px[0], half + share * scale * sweep_px[1]
        kernel[round(row), round(column)] += 1
    return np.asarray(cv2.filter2D(picture, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REPLICATE), np.uint8)


def fisheye_picture(scene: Scene, camera: CameraModel) -> Pixels:
    """The fisheye's picture before noise."""
    width, height = camera.size_px
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(np.float64)
    rays, valid = camera.lift(pixels)
    return scene.sample_fisheye(rays, valid)
