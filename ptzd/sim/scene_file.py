"""The file ``scene.yaml`` of a scene's folder: what it may hold, and reading it.

The keys are the fields of :class:`SceneFile`; an unknown or missing one is an error that names it.
"""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path
from typing import Literal

import msgspec

from ptzd.documents import DocumentError, parse_yaml, read_text
from ptzd.errors import SimulationError

Triple = tuple[float, float, float]


class RigPose(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """X_head = R X_fisheye + T."""

    rotvec_deg: Triple
    """R as axis times angle."""
    translation_m: Triple
    """T: the fisheye's centre in the frame of the head."""
    metric: bool
    """True if T is in metres (the real pairs: to the publisher's approximate figure), else |T| = 1."""


class PictureFiles(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The picture of one viewpoint."""

    colour: str
    """A file name; with ``{face}`` in it, six files."""
    depth: str | None = None
    """File names of six 16-bit pictures: inverse distance along the face's axis in units of `depth_step`."""
    depth_step: float = 1e-4
    """Per metre."""
    picture_from_frame_rotvec_deg: Triple = (0.0, 0.0, 0.0)
    """Turns rays of the viewpoint's frame into the frame the picture was made in."""


class FisheyeCamera(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The unified spherical model of the scene's own fisheye (geometry of `project`: see ptzd.geometry)."""

    size_px: tuple[int, int]
    """Width, height."""
    fx: float
    fy: float
    cx: float
    cy: float
    xi: float
    distortion: tuple[float, float, float, float]
    """k1, k2, p1, p2."""
    max_angle_deg: float
    """Largest angle from the axis inside the image circle."""


class BoxTruth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where a box's centre is, for a scene without depth."""

    ray_fisheye: Triple
    """Unit ray of the centre of the box."""
    bearing_head: Triple
    """Unit direction of the same surface in the frame of the head."""
    range_m: float
    """From the fisheye; as metric as the rig is."""
    sigma_deg: float
    """Standard deviation of `bearing_head` along the arc."""


class Box(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A named box in the picture of the scene's own fisheye, in continuous pixels."""

    name: str
    x: float
    y: float
    w: float
    h: float
    kind: str = "textured"
    """planar, slightly_planar, non_planar, occluded, small, weak_texture, texture_free, repetitive or textured."""
    truth: BoxTruth | None = None

    @property
    def centre_px(self) -> tuple[float, float]:
        """Centre (x, y)."""
        return self.x + self.w / 2, self.y + self.h / 2


class SceneFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of ``scene.yaml``."""

    title: str
    kind: Literal["cube", "equirect"]
    licence: str
    credit: str
    head_from_fisheye: RigPose
    fisheye: PictureFiles
    ptz: PictureFiles
    camera: FisheyeCamera
    ptz_hfov_deg: float
    """Horizontal field of view of a wide PTZ picture."""
    demo_boxes: tuple[Box, ...]
    regions: tuple[Box, ...] = ()


def scene_folder(name_or_dir: str | Path) -> Path:
    """Folder of a scene that comes with ptzd, by its name, or of any other, by its path.

    Raises
    ------
    SimulationError
        If there is no ``scene.yaml``; the message lists the names that exist.
    """
    ours = Path(str(files("ptzd.sim").joinpath("scenes")))
    for folder in (Path(name_or_dir), ours / name_or_dir):
        if (folder / "scene.yaml").is_file():
            return folder
    names = ", ".join(sorted(path.parent.name for path in ours.glob("*/scene.yaml")))
    message = f"no scene {str(name_or_dir)!r}: give one of {names}, or a folder with a scene.yaml"
    raise SimulationError(message)


def read_scene_file(folder: Path) -> SceneFile:
    """Read and check ``scene.yaml``.

    Raises
    ------
    SimulationError
        If it is not YAML or does not fit :class:`SceneFile`; the message names the file and the key.
    """
    path = folder / "scene.yaml"
    try:
        return msgspec.convert(parse_yaml(read_text(path)), SceneFile)
    except (OSError, DocumentError, msgspec.ValidationError) as error:
        message = f"{path}: {error}"
        raise SimulationError(message) from error
