"""A place seen from two viewpoints, the fisheye's and the PTZ camera's, with the truth about it.

A scene knows no camera model: it draws what a grid of rays sees, so every model of ptzd.geometry can be put before it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.documents import read_regular
from ptzd.errors import SimulationError
from ptzd.sim.scene_cube import FACES, ColourCube, DepthCube, Floats, Mask, Pixels, colour_cube, depth_cube, face_rays
from ptzd.sim.scene_file import (
    Box,
    FisheyeCamera,
    PictureFiles,
    SceneFile,
    Triple,
    read_scene_file,
    scene_folder,
)

_SAME_RAY_RAD = np.radians(0.1)
"""A ray this close to a listed box's is the box's."""
_OCCLUSION_SLACK = 1.02
"""Ranges that differ by less are one surface; the nearest two surfaces of a real edge differ by more."""
_EQUIRECT_FACE_PX = 1024


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Where the PTZ has to look."""

    bearing_head: Floats
    """(3,) unit direction in the frame `head`."""
    range_m: float
    """From the fisheye to the surface."""
    sigma_rad: float
    """Standard deviation of the bearing; 0 where it is exact."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One scene, loaded; see :func:`load_scene`."""

    name: str
    file: SceneFile
    head_from_fisheye_rotation: Floats
    """(3, 3) rotation."""
    head_from_fisheye_translation_m: Floats
    """(3,) m: the fisheye's centre in the frame of the head."""
    fisheye_colour: ColourCube
    ptz_colour: ColourCube
    fisheye_depth: DepthCube | None
    ptz_depth: DepthCube | None
    fisheye_picture_from_frame: Floats
    """(3, 3) rotation."""
    ptz_picture_from_frame: Floats
    """(3, 3) rotation."""

    @property
    def camera(self) -> FisheyeCamera:
        """The fisheye that the boxes are given for."""
        return self.file.camera

    @property
    def demo_boxes(self) -> tuple[Box, ...]:
        """Boxes that show well what ptzd does."""
        return self.file.demo_boxes

    @property
    def regions(self) -> tuple[Box, ...]:
        """Boxes of all kinds, also such that cannot be found."""
        return self.file.regions

    def sample_fisheye(self, rays_fisheye: Floats, valid: Mask) -> Pixels:
        """Draw the fisheye's picture.

        Parameters
        ----------
        rays_fisheye : (H, W, 3)
            Unit rays in the frame `fisheye`; any value where `valid` is false.
        valid : (H, W) bool
            Pixels inside the image circle; the others come out black.

        Returns
        -------
        (H, W, 3) uint8
            BGR, filtered to the angle between neighbouring rays.
        """
        rays = np.where(valid[..., None], rays_fisheye, np.array([0.0, 0.0, 1.0]))
        picture = self.fisheye_colour.sample(_turn(self.fisheye_picture_from_frame, rays), _pixel_angles(rays, valid))
        picture[~valid] = 0
        return picture

    def sample_ptz(self, rays_head: Floats, pixel_angle_rad: float) -> Pixels:
        """Draw a picture of the PTZ camera.

        Parameters
        ----------
        rays_head : (H, W, 3)
            Unit rays in the frame `head`.
        pixel_angle_rad : float
            Angle between neighbouring pixels in the middle of the picture.

        Returns
        -------
        (H, W, 3) uint8
            BGR, filtered to that angle.
        """
        return self.ptz_colour.sample(_turn(self.ptz_picture_from_frame, rays_head), pixel_angle_rad)

    def truth(self, ray_fisheye: Floats) -> Truth:
        """Direction, in the frame of the head, of the surface that the fisheye sees along a (3,) unit ray.

        Raises
        ------
        SimulationError
            If the scene has no depth and the ray is not that of a listed box.
        """
        ray = np.asarray(ray_fisheye, np.float64)
        if self.fisheye_depth is None:
            return self._listed_truth(ray)
        s = float(self.fisheye_depth.inverse_range(ray[None])[0])
        direction = self.head_from_fisheye_rotation @ ray + s * self.head_from_fisheye_translation_m
        return Truth(bearing_head=direction / np.linalg.norm(direction), range_m=1 / s, sigma_rad=0.0)

    def visible_from_ptz(self, ray_fisheye: Floats) -> bool:
        """Whether nothing hides from the PTZ camera what the fisheye sees along a (3,) unit ray.

        Raises
        ------
        SimulationError
            As for :meth:`truth`. The boxes listed in a scene without depth are all visible.
        """
        truth = self.truth(ray_fisheye)
        if self.ptz_depth is None:
            return True
        point = (
            self.head_from_fisheye_rotation @ np.asarray(ray_fisheye, np.float64) * truth.range_m
            + self.head_from_fisheye_translation_m
        )
        free = float(self.ptz_depth.farthest_nearby(truth.bearing_head[None])[0])
        return float(np.linalg.norm(point)) * free < _OCCLUSION_SLACK

    def _listed_truth(self, ray: Floats) -> Truth:
        for box in (*self.file.demo_boxes, *self.file.regions):
            if box.truth is None:
                continue
            centre = np.array(box.truth.ray_fisheye)
            if np.linalg.norm(np.cross(centre, ray)) < np.sin(_SAME_RAY_RAD) and centre @ ray > 0:
                bearing = np.array(box.truth.bearing_head)
                return Truth(
                    bearing_head=bearing / np.linalg.norm(bearing),
                    range_m=box.truth.range_m,
                    sigma_rad=float(np.radians(box.truth.sigma_deg)),
                )
        message = f"scene {self.name} has no depth and no listed box at ray {np.round(ray, 4).tolist()}"
        raise SimulationError(message)


def load_scene(name_or_dir: str | Path) -> Scene:
    """Load a scene that comes with ptzd by its name (room, pair_hall, pair_room), or any by its folder.

    Raises
    ------
    SimulationError
        If there is no such scene, a file of it is missing or cannot be decoded, or ``scene.yaml`` is wrong.
    """
    folder = scene_folder(name_or_dir)
    file = read_scene_file(folder)
    load_colour = _load_cube if file.kind == "cube" else _load_equirect
    return Scene(
        name=folder.name,
        file=file,
        head_from_fisheye_rotation=_rotation(file.head_from_fisheye.rotvec_deg),
        head_from_fisheye_translation_m=np.array(file.head_from_fisheye.translation_m),
        fisheye_colour=load_colour(folder, file.fisheye.colour),
        ptz_colour=load_colour(folder, file.ptz.colour),
        fisheye_depth=_load_depth(folder, file.fisheye),
        ptz_depth=_load_depth(folder, file.ptz),
        fisheye_picture_from_frame=_rotation(file.fisheye.picture_from_frame_rotvec_deg),
        ptz_picture_from_frame=_rotation(file.ptz.picture_from_frame_rotvec_deg),
    )


def _load_cube(folder: Path, pattern: str) -> ColourCube:
    return colour_cube(
        {name: _read(folder / pattern.format(face=name), cv2.IMREAD_COLOR).astype(np.uint8) for name in FACES}
    )


def _load_equirect(folder: Path, name: str) -> ColourCube:
    """Turn an equirectangular picture (its middle is forward, its top is up) into faces finer than itself."""
    picture = _read(folder / name, cv2.IMREAD_COLOR)
    height, width = picture.shape[:2]
    margin = 8
    wrapped = np.concatenate((picture[:, -margin:], picture, picture[:, :margin]), axis=1)
    faces = {}
    for face in FACES:
        x, y, z = np.moveaxis(face_rays(face, _EQUIRECT_FACE_PX), -1, 0)
        columns = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5 + margin
        rows = (np.arcsin(np.clip(y, -1, 1)) / np.pi + 0.5) * height - 0.5
        drawn = cv2.remap(
            wrapped, columns.astype(np.float32), rows.astype(np.float32), cv2.INTER_CUBIC, None, cv2.BORDER_REPLICATE
        )
        faces[face] = np.asarray(drawn, np.uint8)
    return colour_cube(faces)


def _load_depth(folder: Path, files: PictureFiles) -> DepthCube | None:
    if files.depth is None:
        return None
    faces = {name: _read(folder / files.depth.format(face=name), cv2.IMREAD_UNCHANGED) for name in FACES}
    return depth_cube({name: face.astype(np.float64) * files.depth_step for name, face in faces.items()})


def _read(path: Path, flags: int) -> NDArray[Any]:
    try:
        stored = np.frombuffer(read_regular(path), np.uint8)
    except OSError as error:
        raise SimulationError(f"{path}: {error.strerror}") from None
    picture = cv2.imdecode(stored, flags) if stored.size else None
    if picture is None:
        message = f"{path}: not a picture"
        raise SimulationError(message)
    return np.asarray(picture)


def _rotation(rotvec_deg: Triple) -> Floats:
    return np.asarray(cv2.Rodrigues(np.radians(np.array(rotvec_deg)))[0], np.float64)


def _turn(rotation: Floats, rays: Floats) -> Floats:
    if np.array_equal(rotation, np.eye(3)):
        return rays
    return np.asarray(cv2.transform(np.asarray(rays, np.float32), rotation.astype(np.float32)))


def _pixel_angles(rays: Floats, valid: Mask) -> Floats:
    """(H, W) geometric mean of the angles to the neighbours along x and y; the median where that is not valid."""
    steps = [np.linalg.norm(np.gradient(rays, axis=axis), axis=-1) for axis in (0, 1)]
    angles = np.sqrt(steps[0] * steps[1])
    inner = np.asarray(cv2.erode(valid.astype(np.uint8), np.ones((3, 3), np.uint8)), np.bool_)
    typical = float(np.median(angles[inner])) if inner.any() else 1e-3
    return np.asarray(np.where(inner, angles, typical))
