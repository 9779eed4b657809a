"""Textured planes before a real rig, sampled through the camera models: the truth is exact."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import angle_between, bearing, rotation_from_rotvec
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.matching.job import MatchInputs
from ptzd.model import Box, Candidate, HeadReading

TEXTURE_PX = 2048
METRES_PER_TEXTURE = 4.0


def multi_scale_texture(seed: int, roughness: float = 1.0) -> np.ndarray:
    """A periodic random texture with power at every scale, uint8."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft2(rng.standard_normal((TEXTURE_PX, TEXTURE_PX)))
    fy, fx = np.fft.fftfreq(TEXTURE_PX)[:, None], np.fft.rfftfreq(TEXTURE_PX)[None, :]
    radius = np.hypot(fx, fy)
    radius[0, 0] = 1.0
    field = np.fft.irfft2(spectrum / radius**roughness * (radius > 4 / TEXTURE_PX))
    return np.clip(127 + 45 * field / field.std(), 0, 255).astype(np.uint8)


@dataclass(frozen=True, kw_only=True)
class Plane:
    """``normal · X = distance`` in the fisheye's frame, m, with a texture."""

    normal: np.ndarray
    distance: float
    texture: np.ndarray
    offset_m: tuple[float, float] = (0.0, 0.0)
    bounds_m: tuple[float, float, float, float] | None = None
    """Left, right, top, bottom of the part that exists, in the plane's own axes."""

    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        helper = np.array([0.0, 1.0, 0.0]) if abs(self.normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
        right = np.cross(helper, self.normal)
        right /= np.linalg.norm(right)
        return right, np.cross(self.normal, right)

    def hit(self, origin: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        slope = rays @ self.normal
        reach = (self.distance - origin @ self.normal) / np.where(np.abs(slope) > 1e-9, slope, 1e-9)
        points = origin + rays * reach[..., None]
        right, down = self.frame()
        u, v = points @ right + self.offset_m[0], points @ down + self.offset_m[1]
        good = reach > 1e-3
        if self.bounds_m is not None:
            left, far, top, bottom = self.bounds_m
            good &= (u > left) & (u < far) & (v > top) & (v < bottom)
        return np.where(good, reach, np.inf), u, v

    def grey(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        scale = TEXTURE_PX / METRES_PER_TEXTURE
        x, y = (u * scale) % TEXTURE_PX, (v * scale) % TEXTURE_PX
        return cv2.remap(
            self.texture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
        )


@dataclass(frozen=True, kw_only=True)
class World:
    """Planes, a rig before them, pictures and truth."""

    rig: Rig
    planes: tuple[Plane, ...]
    drawn: dict = field(default_factory=dict)
    """Views without noise, by their pose."""

    def _see(self, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
        nearest, picture = np.full(rays.shape[:-1], np.inf), np.full(rays.shape[:-1], 20.0)
        for plane in self.planes:
            reach, u, v = plane.hit(origin, rays)
            picture = np.where(reach < nearest, plane.grey(u, v), picture)
            nearest = np.minimum(nearest, reach)
        return picture

    def _draw(self, camera, origin, rotation, area: tuple[int, int, int, int], samples: int) -> np.ndarray:
        left, top, right, bottom = area
        fine = (np.arange(samples) + 0.5) / samples - 0.5
        x = (np.arange(left, right)[:, None] + fine).ravel()
        y = (np.arange(top, bottom)[:, None] + fine).ravel()
        rays, valid = camera.lift(np.stack(np.meshgrid(x, y), axis=-1))
        grey = np.where(valid, self._see(origin, rays @ rotation.T), 0.0)
        return grey.reshape(bottom - top, samples, right - left, samples).mean(axis=(1, 3))

    def fisheye(self, box: Box, noise: float = 0.0, seed: int = 0, margin: int = 8) -> np.ndarray:
        """Only the box and a margin are drawn."""
        width, height = self.rig.fisheye.size_px
        area = (
            max(int(box.x) - margin, 0),
            max(int(box.y) - margin, 0),
            min(int(box.x + box.w) + margin + 1, width),
            min(int(box.y + box.h) + margin + 1, height),
        )
        picture = np.full((height, width), 100.0)
        picture[area[1] : area[3], area[0] : area[2]] = self._draw(self.rig.fisheye, np.zeros(3), np.eye(3), area, 6)
        return with_noise(picture, noise, seed)

    def view(self, reading: HeadReading, noise: float = 0.0, seed: int = 1) -> np.ndarray:
        key = (reading.pan_deg, reading.tilt_deg, reading.zoom)
        if key not in self.drawn:
            self.drawn[key] = self._draw_view(reading)
        return with_noise(self.drawn[key], noise, seed)

    def _draw_view(self, reading: HeadReading) -> np.ndarray:
        camera = self.rig.camera(reading)
        rotation, shift = self.rig.head_from_fisheye_rotation, self.rig.head_from_fisheye_translation
        fisheye_from_camera = rotation.T @ self.rig.head_from_camera(reading)
        return self._draw(camera, -rotation.T @ shift, fisheye_from_camera, (0, 0, *camera.size_px), 3)

    def truth(self, pixel: tuple[float, float]) -> tuple[np.ndarray, float]:
        """Head-frame direction of what a fisheye pixel shows, and its inverse range."""
        ray, _ = self.rig.fisheye.lift(np.array(pixel))
        reach = min(float(plane.hit(np.zeros(3), ray)[0]) for plane in self.planes)
        direction = self.rig.head_from_fisheye_rotation @ ray + self.rig.head_from_fisheye_translation / reach
        return direction / np.linalg.norm(direction), 1.0 / reach

    def aimed(self, box: Box, off_deg: tuple[float, float] = (0.0, 0.0), zoom: float = 1.0) -> HeadReading:
        """Pose that looks at the box's centre, off by so many degrees of pan and tilt."""
        exact = self.rig.aim(self.truth(box.centre)[0], zoom)
        return HeadReading(pan_deg=exact.pan_deg + off_deg[0], tilt_deg=exact.tilt_deg + off_deg[1], zoom=zoom)

    def error_deg(self, box: Box, candidate: Candidate) -> float:
        return float(
            np.degrees(angle_between(self.truth(box.centre)[0], bearing(candidate.pan_rad, candidate.tilt_rad)))
        )

    def inputs(
        self, box: Box, reading: HeadReading, *, noise: float = 0.0, band_deg: float = 0.5, **changes
    ) -> MatchInputs:
        values = {
            "fisheye_grey": self.fisheye(box, noise),
            "view_grey": self.view(reading, noise),
            "rig": self.rig,
            "box": box,
            "reading": reading,
            "inverse_range": (0.0, 1.0),
            "band_rad": np.radians(band_deg),
            "seed": 1,
        }
        return MatchInputs(**{**values, **changes})


def with_noise(picture: np.ndarray, sigma: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(np.round(picture + rng.normal(0.0, 1.0, picture.shape) * sigma), 0, 255).astype(np.uint8)


def make_rig(
    rotvec_deg=(3.0, -5.0, 2.0), translation=(-0.5, -0.1, -0.05), distortion=(0.0,) * 5, size=(320, 240)
) -> Rig:
    focal = 0.5 * size[0] / np.tan(np.radians(30.0))
    centre = ((size[0] - 1) / 2, (size[1] - 1) / 2)
    entries = tuple(
        ZoomEntry(zoom=zoom, fx=focal * scale, fy=focal * scale, cx=centre[0], cy=centre[1], distortion=distortion)
        for zoom, scale in ((1.0, 1.0), (5000.0, 5.0), (9999.0, 10.0))
    )
    return Rig(
        fisheye=UnifiedCamera(
            size_px=(640, 480), fx=282.0, fy=282.0, cx=319.5, cy=239.5, xi=1.2, max_angle_rad=np.radians(92)
        ),
        zoom=ZoomTable(size_px=size, entries=entries),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=rotation_from_rotvec(np.radians(rotvec_deg)),
        head_from_fisheye_translation=np.array(translation),
        metric=True,
        uncertainty=Uncertainty(rotation_rad=np.radians(0.1), translation=0.003, head_rad=np.radians(0.03)),
    )


@pytest.fixture(scope="session")
def textures() -> list[np.ndarray]:
    return [multi_scale_texture(seed) for seed in range(3)]


@pytest.fixture(scope="session")
def world(textures) -> World:
    """A wall 3 m ahead, turned a little."""
    return World(rig=make_rig(), planes=(wall(textures[0]),))


def wall(texture: np.ndarray, distance: float = 3.0, normal=(0.2, -0.1, 1.0), **changes) -> Plane:
    direction = np.array(normal) / np.linalg.norm(normal)
    return Plane(normal=direction, distance=distance, texture=texture, **changes)


@pytest.fixture(scope="session")
def lab():
    """The makers, for tests that build their own world."""
    return SimpleNamespace(World=World, Plane=Plane, wall=wall, make_rig=make_rig, with_noise=with_noise)
