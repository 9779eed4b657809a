"""A scene before cameras of any size: its rig, its fisheye pictures and a memory of rendered views."""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, HeadReading
from ptzd.sim.scene import Scene, load_scene
from ptzd.sim.scene_file import Box as Region

VIEW_PX = (640, 480)
HFOV_DEG = (80.0, 65.0, 60.0, 50.0, 40.0, 13.2)
"""Fields of view of the zoom table, widest first; zoom is the index plus 1; 13.2° is 60° five times magnified."""
STRIPE_ROWS = 256
RENDERED = ("yard", "warehouse")
"""Scenes that are not in the package."""

Size = tuple[int, int]


@dataclass
class Stage:
    """A scene and what was drawn of it so far."""

    scene: Scene
    rigs: dict[Size, Rig] = field(default_factory=dict)
    fisheyes: dict[Size, np.ndarray] = field(default_factory=dict)
    views: dict[tuple[float, ...], np.ndarray] = field(default_factory=dict)

    def rig(self, size_px: Size) -> Rig:
        """The scene's rig with its fisheye scaled to another width, rows added or cut evenly for the height."""
        if size_px not in self.rigs:
            self.rigs[size_px] = _rig(self.scene, size_px)
        return self.rigs[size_px]

    def box(self, region: Region, size_px: Size) -> Box:
        """The same box in the scaled fisheye."""
        scale, down = _scaling(self.scene, size_px)
        return Box(
            x=(region.x + 0.5) * scale - 0.5,
            y=(region.y + 0.5) * scale - 0.5 + down,
            w=region.w * scale,
            h=region.h * scale,
        )

    def fisheye(self, size_px: Size) -> np.ndarray:
        """Grey picture, drawn in stripes: the largest fisheye has ten million pixels."""
        if size_px not in self.fisheyes:
            camera = self.rig(size_px).fisheye
            width, height = camera.size_px
            stripes = []
            for top in range(0, height, STRIPE_ROWS):
                rows = np.arange(top, min(top + STRIPE_ROWS, height))
                rays, valid = camera.lift(np.stack(np.meshgrid(np.arange(width), rows), axis=-1))
                stripes.append(cv2.cvtColor(self.scene.sample_fisheye(rays, valid), cv2.COLOR_BGR2GRAY))
            self.fisheyes[size_px] = np.concatenate(stripes)
        return self.fisheyes[size_px]

    def view(self, reading: HeadReading) -> np.ndarray:
        key = (round(reading.pan_deg, 6), round(reading.tilt_deg, 6), reading.zoom)
        if key not in self.views:
            rig = self.rig(self.scene.camera.size_px)
            camera = rig.camera(reading)
            width, height = camera.size_px
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
            colour = self.scene.sample_ptz(rig.lift_from_view(pixels, reading), 1.0 / camera.fx)
            self.views[key] = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
        return self.views[key]


@lru_cache(maxsize=6)
def stage(name: str) -> Stage:
    """A scene of the package, of the cache of rendered ones, or of a folder."""
    return Stage(scene=load_scene(rendered(name) if name in RENDERED else name))


def rendered(name: str) -> Path:
    """Folder of a rendered scene, rendered first if it is not there yet."""
    scripts = str(Path(__file__).resolve().parents[2] / "scenes")
    if scripts not in sys.path:
        sys.path.insert(0, scripts)
    return Path(importlib.import_module("cache").folder(name))


def _scaling(scene: Scene, size_px: Size) -> tuple[float, float]:
    width, height = scene.camera.size_px
    scale = size_px[0] / width
    return scale, (size_px[1] - height * scale) / 2


def _rig(scene: Scene, size_px: Size) -> Rig:
    c = scene.camera
    scale, down = _scaling(scene, size_px)
    centre = ((VIEW_PX[0] - 1) / 2, (VIEW_PX[1] - 1) / 2)
    focals = [0.5 * VIEW_PX[0] / np.tan(np.radians(hfov) / 2) for hfov in HFOV_DEG]
    entries = [
        ZoomEntry(zoom=index + 1.0, fx=focal, fy=focal, cx=centre[0], cy=centre[1])
        for index, focal in enumerate(focals)
    ]
    return Rig(
        fisheye=UnifiedCamera(
            size_px=size_px,
            fx=c.fx * scale,
            fy=c.fy * scale,
            cx=(c.cx + 0.5) * scale - 0.5,
            cy=(c.cy + 0.5) * scale - 0.5 + down,
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
