"""A person who shows boards to a simulated rig, and the pictures its cameras take of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from ptzd.calibrate.capture import AROUND_DEG, FISHEYE, FRAMES, ZOOMS, tele_plan, wide_plan, write_mean, write_shots
from ptzd.calibrate.parts import Shot
from ptzd.calibration.target import Target
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, bearing, rotation_from_rotvec
from ptzd.geometry.types import Array, CameraModel
from ptzd.model import HeadLimits, HeadReading
from ptzd.sim.head import Pose
from ptzd.sim.imager import Exposure, Noise, PtzEye, encode, fisheye_picture
from ptzd.sim.optics import camera_at
from ptzd.sim.profile import profile
from ptzd.sim.rig_truth import fisheye_camera, head_model
from ptzd.sim.scene import load_scene

SIZE_PX = (640, 480)
FISHEYE_PRINT, PAIR_PRINT = 1.5, 3.0
"""Sizes of the prints that the fisheye and both cameras are shown, in sizes of the smallest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A chessboard in the world."""

    target: Target
    rotation: Array
    origin_m: Array

    def over(self, picture: NDArray[np.uint8], rays: Array) -> NDArray[np.uint8]:
        """The picture with the board in front of everything; rays ``(h, w, k, 3)``, k samples per pixel."""
        middle = rays.shape[2] // 2
        rows, columns = np.nonzero(self._at(rays[:, :, middle])[0])
        if len(rows) == 0:
            return picture
        part = np.s_[max(rows.min() - 2, 0) : rows.max() + 3, max(columns.min() - 2, 0) : columns.max() + 3]
        hit, dark = self._at(rays[part])
        share = hit.mean(axis=-1)
        shade = np.where(hit, np.where(dark, 30.0, 225.0), 0.0).sum(axis=-1) / np.maximum(hit.sum(axis=-1), 1)
        drawn = picture.copy()
        drawn[part] = np.rint(picture[part] * (1 - share) + shade * share)
        return drawn

    def _at(self, rays: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which rays ``(..., 3)`` meet the board, and which meet a dark square."""
        local, away = rays @ self.rotation, self.origin_m @ self.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = away[2] / local[..., 2]
            u = (local[..., 0] * depth - away[0]) / self.target.pitch_m
            v = (local[..., 1] * depth - away[1]) / self.target.pitch_m
            width, height = self.target.columns, self.target.rows
            hit = (depth > 0) & (u > -1.8) & (u < width + 0.8) & (v > -1.8) & (v < height + 0.8)
            inside = (u > -1) & (u < width) & (v > -1) & (v < height)
            return hit, inside & (np.mod(np.floor(u) + np.floor(v), 2) == 0)


def samples(camera: CameraModel, side: int = 2) -> tuple[Array, NDArray[np.bool_]]:
    """Rays ``(h, w, side², 3)`` of sub-pixels, and which pixels have all of them."""
    width, height = camera.size_px
    steps = (np.arange(side) + 0.5) / side - 0.5
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)[:, :, None, :]
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(1, 1, -1, 2)
    rays, valid = camera.lift(grid + offsets)
    return rays, np.asarray(valid.all(axis=-1))


def tilted(rng: np.random.Generator, target: Target, direction: Array, range_m: float) -> Board:
    """A board at a place, facing the camera up to a random tilt."""
    forward = direction / np.linalg.norm(direction)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    facing = np.column_stack([right, np.cross(forward, right), forward])
    turn = rotation_from_rotvec(rng.uniform(-1.0, 1.0, 3) * np.radians([32.0, 32.0, 25.0]))
    rotation = facing @ turn
    middle = target.points_m().mean(axis=0)
    return Board(target=target, rotation=rotation, origin_m=forward * range_m - rotation @ middle)


TELE_DEG = (10.0, -8.0)
"""Pan and tilt of the tele pictures."""


class Studio:
    """Draws the pictures of a person who shows boards to a simulated rig.

    Parameters
    ----------
    scene, kind : str
        Names of a scene and of a camera profile.
    work : Path
        Where the pictures go.
    target : Target
        The smallest of the chessboards; larger prints of it are used for other distances.
    seed : int
        Of places and noise.
    """

    def __init__(self, scene: str | Path, kind: str, work: Path, target: Target, seed: int) -> None:
        self._scene, self._profile = load_scene(scene), profile(kind)
        self._head = head_model(self._profile.mount, self._profile)
        self._lens = fisheye_camera(self._scene.camera, None)
        self._eye = PtzEye(self._scene, self._profile, self._head, noise_sigma=0.0, seed=seed)
        self._noise = {size: Noise(2.0, seed, size) for size in (self._lens.size_px, SIZE_PX)}
        self._rng = np.random.default_rng(seed)
        self._target, self._work = target, work
        self._rays: dict[float, Array] = {}
        self._empty = cv2.cvtColor(fisheye_picture(self._scene, self._lens), cv2.COLOR_BGR2GRAY).astype(np.uint8)
        self._lens_rays, self._lens_valid = samples(self._lens)

    def boards(self, count: int = 24) -> Path:
        """Fisheye pictures of a board all over the field; returns their folder."""
        target = replace(self._target, pitch_m=self._target.pitch_m * FISHEYE_PRINT)
        for number in range(count):
            angle, turn = math.radians(8.0 + 70.0 * math.sqrt(number / (count - 1))), number * 2.4
            side = math.sin(angle)
            direction = np.array([side * math.cos(turn), side * math.sin(turn), math.cos(angle)])
            board = tilted(self._rng, target, direction, float(self._rng.uniform(0.55, 0.8)))
            self._fisheye(f"boards/{number:02}.jpg", board)
        return self._work / "boards"

    def zooms(self, zooms: Sequence[int] = (1, 170, 420, 800, 1350), count: int = 12) -> Path:
        """PTZ pictures of a board at each zoom; returns their list."""
        shots = []
        for zoom in zooms:
            camera = camera_at(self._profile, zoom, SIZE_PX)
            reading = HeadReading(pan_deg=5.0, tilt_deg=-10.0, zoom=float(zoom))
            turned = self._head.head_from_camera(*self._head.pan_tilt_from_vapix(reading))
            for number in range(count):
                ray, _ = camera.lift(self._rng.uniform([160.0, 130.0], [480.0, 350.0]))
                range_m = camera.fx / 640.0 * 9.5 * self._target.pitch_m * float(self._rng.uniform(1.5, 2.2))
                board = tilted(self._rng, self._target, turned @ ray, range_m)
                shots.append(self._ptz(f"zoom/{zoom}_{number:02}.jpg", board, reading))
        return write_shots(self._work / "zoom.json", shots)

    def pairs(self, count: int = 12) -> Path:
        """Boards that both cameras see, the PTZ in three poses each; returns the list."""
        target = replace(self._target, pitch_m=self._target.pitch_m * PAIR_PRINT)
        R, T = self._scene.head_from_fisheye_rotation, self._scene.head_from_fisheye_translation_m
        shots = []
        for number in range(count):
            direction = bearing(math.radians(-50 + 100 * (number % 4) / 3), math.radians(-30 + 17 * (number // 4)))
            board = tilted(self._rng, target, direction, float(self._rng.uniform(1.3, 1.9)))
            seen = replace(board, rotation=R.T @ board.rotation, origin_m=R.T @ (board.origin_m - T))
            fisheye = self._fisheye(f"pairs/fisheye_{number:02}.jpg", seen)
            aim = self._head.vapix_from_pan_tilt(*self._head.aim(direction), 1.0)
            for turn, (across, up) in enumerate(((0.0, 0.0), (9.0, 6.0), (-9.0, -6.0))):
                tilt = float(np.clip(aim.tilt_deg + up, self._profile.tilt.low, self._profile.tilt.high))
                pan_deg, tilt_deg = self._profile.quantise(aim.pan_deg + across), self._profile.quantise(tilt)
                reading = HeadReading(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=1.0)
                shot = self._ptz(f"pairs/ptz_{number:02}_{turn}.jpg", board, reading)
                shots.append(msgspec.structs.replace(shot, fisheye=fisheye, place=number))
        return write_shots(self._work / "pairs.json", shots)

    def scene_only(self, zooms: Sequence[float] = ZOOMS) -> Path:
        """The fisheye's picture and the PTZ's at every pose of a capture, no board; returns the list."""
        limits = HeadLimits(
            pan_deg=(self._profile.pan.low, self._profile.pan.high),
            tilt_deg=(self._profile.tilt.low, self._profile.tilt.high),
            zoom=(1.0, self._profile.zoom.high),
        )
        write_mean(self._path(f"scene/{FISHEYE}"), [self._exposed(self._empty) for _ in range(FRAMES)])
        shots = []
        looks = [*wide_plan(limits, (-AROUND_DEG, AROUND_DEG)), *tele_plan(limits, zooms, TELE_DEG)]
        for number, wanted in enumerate(looks):
            pan_deg, tilt_deg = self._profile.quantise(wanted.pan_deg), self._profile.quantise(wanted.tilt_deg)
            reading = HeadReading(pan_deg=pan_deg, tilt_deg=tilt_deg, zoom=wanted.zoom)
            shot = self._ptz(f"scene/ptz_{number:03}.jpg", None, reading)
            shots.append(msgspec.structs.replace(shot, fisheye=f"scene/{FISHEYE}"))
        return write_shots(self._work / "scene.json", shots)

    def pointing_errors_deg(self, rig: Rig, step_px: int = 40) -> Array:
        """Angles between where a rig points for pixels at their true range and where the simulated one must, deg.

        A rig without metric scale is given the range in true baselines.
        """
        width, height = self._lens.size_px
        grid = np.stack(np.meshgrid(np.arange(20, width, step_px), np.arange(20, height, step_px)), -1).reshape(-1, 2)
        true, valid = self._lens.lift(grid)
        mine, also = rig.fisheye.lift(grid)
        T = self._scene.head_from_fisheye_translation_m
        scale = 1.0 if rig.metric else float(np.linalg.norm(T))
        errors = []
        for ray, own in zip(true[valid & also], mine[valid & also], strict=True):
            truth = self._scene.truth(ray)
            shift = rig.head_from_fisheye_translation * scale / truth.range_m
            reading = rig.aim(rig.head_from_fisheye_rotation @ own + shift, rig.zoom.zoom_range[0])
            points = self._head.head_from_camera(*self._head.pan_tilt_from_vapix(reading))[:, 2]
            errors.append(float(angle_between(points, truth.bearing_head)))
        return np.asarray(np.degrees(errors))

    def _fisheye(self, name: str, board: Board) -> str:
        drawn = board.over(self._empty, self._lens_rays)
        return self._write(name, np.where(self._lens_valid, drawn, self._empty).astype(np.uint8))

    def _ptz(self, name: str, board: Board | None, reading: HeadReading) -> Shot:
        pose = Pose(pan_deg=reading.pan_deg, tilt_deg=reading.tilt_deg, zoom=reading.zoom)
        drawn = cv2.cvtColor(self._eye.clean(Exposure(pose=pose, size_px=SIZE_PX)), cv2.COLOR_BGR2GRAY)
        if board is not None:
            if reading.zoom not in self._rays:
                self._rays = {reading.zoom: samples(camera_at(self._profile, reading.zoom, SIZE_PX))[0]}
            turned = self._head.head_from_camera(*self._head.pan_tilt_from_vapix(reading))
            in_camera = replace(board, rotation=turned.T @ board.rotation, origin_m=turned.T @ board.origin_m)
            drawn = in_camera.over(np.asarray(drawn, np.uint8), self._rays[reading.zoom])
        image = self._write(name, np.asarray(drawn, np.uint8))
        return Shot(image=image, pan_deg=reading.pan_deg, tilt_deg=reading.tilt_deg, zoom=reading.zoom)

    def _write(self, name: str, grey: NDArray[np.uint8]) -> str:
        self._path(name).write_bytes(self._exposed(grey))
        return name

    def _exposed(self, grey: NDArray[np.uint8]) -> bytes:
        """What a camera with noise makes of it."""
        height, width = grey.shape
        return encode(self._noise[width, height].on(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR).astype(np.uint8)), 92)

    def _path(self, name: str) -> Path:
        path = self._work / name
        path.parent.mkdir(parents=True, exist_ok=True)
        return path
