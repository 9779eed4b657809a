"""The rig in three dimensions: frames, calibrations, and the scene with both cameras, the arc and the target's ray.

The frame ``world`` is the head's with its axes as 3D views expect them: x forward, y left, z up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ptzd.evidence.foxglove import CYAN, GREEN, YELLOW, Rgba, colour
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import rotvec_from_rotation
from ptzd.geometry.types import Array, CameraModel
from ptzd.geometry.unified import UnifiedCamera
from ptzd.log.notes import Json, stamp
from ptzd.model import HeadReading

WORLD_FROM_HEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
REACH = 10.0
"""Length of what has no range, in baselines."""
_ARC_STEP_RAD = math.radians(1.0)
_NO_TURN: Json = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def quaternion(rotation: Array) -> Json:
    """``foxglove.Quaternion`` of a rotation matrix (3, 3)."""
    rotvec = rotvec_from_rotation(rotation)
    angle = float(np.linalg.norm(rotvec))
    axis = rotvec / angle if angle > 0.0 else rotvec
    x, y, z = (axis * math.sin(angle / 2)).tolist()
    return {"x": x, "y": y, "z": z, "w": math.cos(angle / 2)}


def vector(values: Sequence[float] | Array) -> Json:
    """``foxglove.Vector3`` or ``Point3``."""
    x, y, z = (float(value) for value in values)
    return {"x": x, "y": y, "z": z}


def _transform(t_ns: int, parent: str, child: str, rotation: Array, translation: Sequence[float] | Array) -> Json:
    return {
        "timestamp": stamp(t_ns),
        "parent_frame_id": parent,
        "child_frame_id": child,
        "translation": vector(translation),
        "rotation": quaternion(rotation),
    }


def fixed_transforms(t_ns: int, rig: Rig) -> Json:
    """``foxglove.FrameTransforms`` of what does not move: head in the world, fisheye at the head."""
    rotation, translation = rig.head_from_fisheye_rotation, rig.head_from_fisheye_translation
    return {
        "transforms": [
            _transform(t_ns, "world", "head", WORLD_FROM_HEAD, (0.0, 0.0, 0.0)),
            _transform(t_ns, "head", "fisheye", rotation, translation),
        ]
    }


def camera_transform(t_ns: int, rig: Rig, reading: HeadReading) -> Json:
    """``foxglove.FrameTransforms`` of the PTZ camera at a reading."""
    turned = _transform(t_ns, "head", "camera", rig.head_from_camera(reading), (0.0, 0.0, 0.0))
    return {"transforms": [turned]}


def calibration(t_ns: int, frame_id: str, camera: CameraModel) -> Json | None:
    """``foxglove.CameraCalibration``; None for models that it cannot name."""
    if isinstance(camera, PerspectiveCamera):
        model, distortion = "plumb_bob", list(camera.distortion)
    elif isinstance(camera, KannalaBrandtCamera):
        model, distortion = "kannala_brandt", list(camera.distortion)
    elif isinstance(camera, UnifiedCamera) and camera.xi == 0.0:
        model, distortion = "plumb_bob", [*camera.distortion, 0.0]
    else:
        return None
    width, height = camera.size_px
    fx, fy, cx, cy = camera.fx, camera.fy, camera.cx, camera.cy
    return {
        "timestamp": stamp(t_ns),
        "frame_id": frame_id,
        "width": width,
        "height": height,
        "distortion_model": model,
        "D": distortion,
        "K": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "R": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "P": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }


def rig_scene(t_ns: int, rig: Rig) -> Json:
    """``foxglove.SceneUpdate`` that clears all and shows both cameras and the baseline."""
    fisheye = rig.head_from_fisheye_translation
    size = 0.1 * float(np.linalg.norm(fisheye))
    entity = _entity(t_ns, "rig") | {
        "spheres": [_sphere(fisheye, size, CYAN), _sphere((0.0, 0.0, 0.0), size, YELLOW)],
        "lines": [_line([fisheye, np.zeros(3)], CYAN)],
        "texts": [_text(fisheye, "fisheye"), _text((0.0, 0.0, 0.0), "PTZ")],
    }
    return {"deletions": [{"timestamp": stamp(t_ns), "type": 1, "id": ""}], "entities": [entity]}


def arc_scene(t_ns: int, rig: Rig, arc: EpipolarArc) -> Json:
    """``foxglove.SceneUpdate`` with the target's fisheye ray and the fan of head directions; the old target goes."""
    inverse = arc.steps(_ARC_STEP_RAD)
    fan = [along * _reach(arc, float(s)) for along, s in zip(arc.bearing(inverse), inverse, strict=True)]
    origin = arc.translation
    ray = [origin, origin + arc.rotated * REACH * float(np.linalg.norm(origin))]
    entity = _entity(t_ns, "arc") | {"lines": [_line(fan, YELLOW), _line(ray, CYAN)]}
    return {"deletions": [{"timestamp": stamp(t_ns), "type": 0, "id": "target"}], "entities": [entity]}


def target_scene(t_ns: int, bearing: Array, distance: float, text: str) -> Json:
    """``foxglove.SceneUpdate`` with the ray from the head to the target.

    Parameters
    ----------
    t_ns : int
        Ns since the epoch.
    bearing : Array
        Unit direction in the head frame, shape (3,).
    distance : float
        From the head, in the unit of T.
    text : str
        Shown at its end.
    """
    tip = bearing * distance
    entity = _entity(t_ns, "target") | {"lines": [_line([np.zeros(3), tip], GREEN)], "texts": [_text(tip, text)]}
    return {"deletions": [], "entities": [entity]}


def target_distance(arc: EpipolarArc, inverse_range: float) -> float:
    """Distance from the head of a target at an inverse range from the fisheye, at most :data:`REACH` baselines."""
    return _reach(arc, inverse_range)


def _reach(arc: EpipolarArc, inverse_range: float) -> float:
    longest = REACH * float(np.linalg.norm(arc.translation))
    inverse = float(arc.head_inverse_range(inverse_range))
    return min(longest, 1.0 / inverse) if inverse > 0.0 else longest


def _entity(t_ns: int, name: str) -> Json:
    parts = ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        "timestamp": stamp(t_ns),
        "frame_id": "head",
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
    } | {part: [] for part in parts}


def _pose(position: Sequence[float] | Array) -> Json:
    return {"position": vector(position), "orientation": _NO_TURN}


def _sphere(centre: Sequence[float] | Array, diameter: float, rgba: Rgba) -> Json:
    return {"pose": _pose(centre), "size": vector((diameter, diameter, diameter)), "color": colour(rgba)}


def _line(points: Sequence[Array], rgba: Rgba) -> Json:
    return {
        "type": 0,
        "pose": _pose((0.0, 0.0, 0.0)),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": [vector(point) for point in points],
        "color": colour(rgba),
        "colors": [],
        "indices": [],
    }


def _text(position: Sequence[float] | Array, text: str) -> Json:
    return {
        "pose": _pose(position),
        "billboard": True,
        "font_size": 12.0,
        "scale_invariant": True,
        "color": colour(YELLOW),
        "text": text,
    }
