"""Regions of a scene under one condition: the pictures, the calibration as the matcher is told it, and the truth."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import cv2
import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import rotation_from_rotvec
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, HeadReading
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.scene_file import Box as Region

VIEW_PX = (640, 480)
HFOV_DEG = (80.0, 65.0, 60.0, 50.0, 40.0, 13.2)
"""Fields of view of the zoom table, widest first; zoom is the index plus 1; 13.2° is 60° five times magnified."""
RANGE_M = (0.8, 100.0)
BAND_DEG = 1.0


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What is changed against the clean pictures."""

    name: str
    group: str = "clean"
    """Row of the summary; conditions of one group are also shown together."""
    paper: str = "-"
    """The paper's own figure for this experiment."""
    hfov_deg: float = 60.0
    fisheye_scale: int = 1
    noise: float = 0.0
    """One sigma, grey levels, on both pictures."""
    light: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None
    """Applied to the views, floats in [0, 255]."""
    occlusion: float = 0.0
    """Share of the region that something hides in the views."""
    extrinsics_deg: float = 0.0
    band_deg: float = BAND_DEG
    absent: bool = False
    """The box shows something that is nowhere in the views."""
    kinds: tuple[str, ...] = ()
    """Only regions of these kinds; empty = all that can be found."""
    narrow: float = 0.0
    """Search only this share of the true inverse range to either side, as while verifying a lock; 0 = all ranges."""
    aimed_deg: float | None = None
    """One view aimed at the truth with this error instead of the scan of the arc."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One region under one condition."""

    scene: str
    region: Region
    condition: Condition
    rig: Rig
    """As the matcher is told: wrong where the condition says so."""
    box: Box
    fisheye: np.ndarray
    views: list[tuple[HeadReading, np.ndarray]]
    truth: np.ndarray | None
    """(3,) direction in the head frame; None when nothing in the views is right."""
    inverse_range: tuple[float, float]
    seed: int = 1


@dataclass
class Stage:
    """A scene with its rig, its fisheye pictures and a memory of rendered views."""

    scene: Scene
    rigs: dict[int, Rig] = field(default_factory=dict)
    fisheyes: dict[int, np.ndarray] = field(default_factory=dict)
    views: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)

    def rig(self, scale: int) -> Rig:
        if scale not in self.rigs:
            self.rigs[scale] = _rig(self.scene, scale)
        return self.rigs[scale]

    def fisheye(self, scale: int) -> np.ndarray:
        if scale not in self.fisheyes:
            camera = self.rig(scale).fisheye
            width, height = camera.size_px
            rays, valid = camera.lift(np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1))
            colour = self.scene.sample_fisheye(rays, valid)
            self.fisheyes[scale] = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        return self.fisheyes[scale]

    def view(self, reading: HeadReading) -> np.ndarray:
        key = (round(reading.pan_deg, 6), round(reading.tilt_deg, 6), reading.zoom)
        if key not in self.views:
            rig = self.rig(1)
            camera = rig.camera(reading)
            width, height = camera.size_px
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            rays = rig.lift_from_view(pixels, reading)
            colour = self.scene.sample_ptz(rays, 1.0 / camera.fx)
            self.views[key] = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        return self.views[key]


@lru_cache(maxsize=8)
def stage(name: str) -> Stage:
    return Stage(scene=load_scene(name))


def _rig(scene: Scene, scale: int) -> Rig:
    c = scene.camera
    entries = []
    for index, hfov in enumerate(HFOV_DEG):
        focal = 0.5 * VIEW_PX[0] / np.tan(np.radians(hfov) / 2)
        entries.append(
            ZoomEntry(zoom=index + 1.0, fx=focal, fy=focal, cx=(VIEW_PX[0] - 1) / 2, cy=(VIEW_PX[1] - 1) / 2)
        )
    return Rig(
        fisheye=UnifiedCamera(
            size_px=(c.size_px[0] * scale, c.size_px[1] * scale),
            fx=c.fx * scale,
            fy=c.fy * scale,
            cx=(c.cx + 0.5) * scale - 0.5,
            cy=(c.cy + 0.5) * scale - 0.5,
            xi=c.xi,
            distortion=c.distortion,
            max_angle_rad=np.radians(c.max_angle_deg),
        ),
        zoom=ZoomTable(size_px=VIEW_PX, entries=tuple(entries)),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=scene.head_from_fisheye_rotation,
        head_from_fisheye_translation=scene.head_from_fisheye_translation_m,
        metric=True,
        uncertainty=Uncertainty(rotation_rad=np.radians(0.3), translation=0.005, head_rad=np.radians(0.05)),
    )


def cases(scene_name: str, condition: Condition) -> Iterator[Case]:
    """All regions of a scene that the condition applies to."""
    s = stage(scene_name)
    regions = [
        region
        for region in s.scene.regions
        if (region.kind in condition.kinds if condition.kinds else region.kind != "texture_free")
    ]
    for index in range(len(regions)):
        yield _case(s, regions, index, condition)


def _case(s: Stage, regions: list[Region], index: int, condition: Condition) -> Case:
    region = regions[index]
    seed = zlib.crc32(f"{s.scene.name} {region.name} {condition.name}".encode())
    rng = np.random.default_rng(seed)
    scale = condition.fisheye_scale
    true_rig = s.rig(scale)
    box = Box(
        x=(region.x + 0.5) * scale - 0.5, y=(region.y + 0.5) * scale - 0.5, w=region.w * scale, h=region.h * scale
    )
    ray, _ = true_rig.fisheye.lift(np.array(box.centre))
    truth = s.scene.truth(ray).bearing_head
    visible = s.scene.visible_from_ptz(ray)
    fisheye = s.fisheye(scale).astype(np.float64)
    if condition.absent:
        other = regions[(index + len(regions) // 3) % len(regions)]
        fisheye = _pasted(fisheye, box, other, scale)
    rig = _wrong(true_rig, condition.extrinsics_deg, rng)
    views = []
    for reading in _poses(rig, true_rig, ray, truth, condition, rng):
        picture = s.view(reading).astype(np.float64)
        if condition.occlusion > 0:
            picture = _occluded(picture, true_rig, reading, box, truth, s, condition.occlusion, rng)
        if condition.light is not None:
            picture = condition.light(picture, rng)
        views.append((reading, _noisy(picture, condition.noise, rng)))
    return Case(
        scene=s.scene.name,
        region=region,
        condition=condition,
        rig=rig,
        box=box,
        fisheye=_noisy(fisheye, condition.noise, rng),
        views=views,
        truth=truth if visible and not condition.absent else None,
        seed=seed % 1000,
        inverse_range=_interval(1.0 / s.scene.truth(ray).range_m, condition.narrow),
    )


def _interval(inverse_range: float, narrow: float) -> tuple[float, float]:
    if narrow == 0.0:
        return 1.0 / RANGE_M[1], 1.0 / RANGE_M[0]
    return max(inverse_range * (1.0 - narrow) - 0.01, 0.0), inverse_range * (1.0 + narrow) + 0.01


def _poses(rig: Rig, true_rig: Rig, ray: np.ndarray, truth: np.ndarray, condition: Condition, rng) -> list[HeadReading]:
    """Views along the arc, overlapping by half, from its far end; or the one aimed view."""
    zoom = HFOV_DEG.index(condition.hfov_deg) + 1.0
    if condition.aimed_deg is not None:
        shift = rng.normal(0.0, np.radians(condition.aimed_deg), 3)
        return [true_rig.aim(truth + shift, zoom)]
    arc = EpipolarArc.of(rig, ray, 1.0 / RANGE_M[1], 1.0 / RANGE_M[0])
    vfov = rig.camera(HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=zoom)).vfov_rad
    count = max(1, int(np.ceil(arc.length_rad / (0.5 * vfov))))
    ends = arc.angle_at([arc.s_min, arc.s_max])
    middle = ends[0] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    return [rig.aim(arc.bearing(float(s)), zoom) for s in arc.inverse_range_at(middle)]


def _wrong(rig: Rig, angle_deg: float, rng: np.random.Generator) -> Rig:
    if angle_deg == 0.0:
        return rig
    axis = rng.normal(size=3)
    turn = rotation_from_rotvec(np.radians(angle_deg) * axis / np.linalg.norm(axis))
    return Rig(
        fisheye=rig.fisheye,
        zoom=rig.zoom,
        head=rig.head,
        head_from_fisheye_rotation=turn @ rig.head_from_fisheye_rotation,
        head_from_fisheye_translation=rig.head_from_fisheye_translation,
        metric=rig.metric,
        uncertainty=rig.uncertainty,
    )


def _pasted(fisheye: np.ndarray, box: Box, other: Region, scale: int) -> np.ndarray:
    x, y, w, h = (round(v * scale) for v in (other.x, other.y, other.w, other.h))
    piece = fisheye[y : y + h, x : x + w]
    left, top = round(box.x) - 2, round(box.y) - 2
    wide, high = round(box.w) + 4, round(box.h) + 4
    out = fisheye.copy()
    out[top : top + high, left : left + wide] = cv2.resize(piece, (wide, high), interpolation=cv2.INTER_LINEAR)
    return out


def _occluded(picture, rig, reading, box, truth, s, share, rng) -> np.ndarray:
    """Cover one side of the region, as seen in the view, with another piece of the same view."""
    ray, _ = rig.fisheye.lift(np.array(box.centre))
    inverse_range = 1.0 / s.scene.truth(ray).range_m
    corners, _ = rig.fisheye.lift(np.array(box.corners))
    seen = corners @ rig.head_from_fisheye_rotation.T + inverse_range * rig.head_from_fisheye_translation
    pixels, valid = rig.project_to_view(seen, reading)
    if not valid.all():
        return picture
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    wide, high = right - left, bottom - top
    side = rng.integers(4)
    if side < 2:
        wide *= share
        left = left if side == 0 else right - wide
    else:
        high *= share
        top = top if side == 2 else bottom - high
    x0, y0, x1, y1 = (int(v) for v in np.clip(np.round([left, top, left + wide, top + high]), 0, [*VIEW_PX, *VIEW_PX]))
    if x1 <= x0 or y1 <= y0:
        return picture
    out = picture.copy()
    shift_x = int(rng.integers(80, VIEW_PX[0] - 80))
    shift_y = int(rng.integers(60, VIEW_PX[1] - 60))
    out[y0:y1, x0:x1] = np.roll(picture, (shift_y, shift_x), (0, 1))[y0:y1, x0:x1]
    return out


def _noisy(picture: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    if sigma > 0:
        picture = picture + rng.normal(0.0, sigma, picture.shape)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)
