"""What is true of a simulated rig, and the calibration that states it (or states it wrongly on purpose). Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import yaml

from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.unified import UnifiedCamera
from ptzd.model import HeadReading
from ptzd.sim.optics import calibrated_zooms, camera_at
from ptzd.sim.profile import Mount, Profile
from ptzd.sim.scene import Scene
from ptzd.sim.scene_file import FisheyeCamera
from ptzd.sim.settings import SimSettings


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """Where the head has to look for a fisheye pixel."""

    bearing_head: tuple[float, float, float]
    """Unit vector in the frame `head`."""
    pan_deg: float
    """Direction in the frame `head`."""
    tilt_deg: float
    range_m: float
    """From the fisheye to the surface."""
    sigma_deg: float
    vapix: HeadReading
    """What the camera has to be told; zoom 1."""
    visible: bool
    """Whether nothing hides it from the PTZ."""


def head_model(mount: Mount, profile: Profile) -> HeadModel:
    """The true head: VAPIX degrees to the frame `head`."""
    sign = -1 if profile.reversed_mount else 1
    x, y, z = (math.radians(angle) for angle in mount.camera_rotvec_deg)
    return HeadModel(
        pan=Axis(sign=sign, scale=mount.pan_scale, offset_rad=math.radians(mount.pan_offset_deg)),
        tilt=Axis(sign=sign, scale=mount.tilt_scale, offset_rad=math.radians(mount.tilt_offset_deg)),
        camera_rotvec_rad=(x, y, z),
    )


def fisheye_camera(own: FisheyeCamera, size_px: tuple[int, int] | None) -> UnifiedCamera:
    """The scene's lens, at its own resolution or scaled to another width (the same shape)."""
    share = 1.0 if size_px is None else size_px[0] / own.size_px[0]
    return UnifiedCamera(
        size_px=size_px or own.size_px,
        fx=own.fx * share,
        fy=own.fy * share,
        cx=(own.cx + 0.5) * share - 0.5,
        cy=(own.cy + 0.5) * share - 0.5,
        xi=own.xi,
        distortion=own.distortion,
        max_angle_rad=math.radians(own.max_angle_deg),
    )


def direction(scene: Scene, camera: UnifiedCamera, head: HeadModel, x: float, y: float) -> Direction | None:
    """Truth of one fisheye pixel; None outside the image circle.

    Raises
    ------
    SimulationError
        When the scene does not know it (scenes without depth know their listed boxes only).
    """
    ray, valid = camera.lift(np.array([x, y]))
    if not valid:
        return None
    truth = scene.truth(ray)
    bearing = truth.bearing_head
    pan, tilt = head.aim(bearing)
    return Direction(
        bearing_head=(float(bearing[0]), float(bearing[1]), float(bearing[2])),
        pan_deg=math.degrees(math.atan2(bearing[0], bearing[2])),
        tilt_deg=math.degrees(math.asin(-bearing[1])),
        range_m=truth.range_m,
        sigma_deg=math.degrees(truth.sigma_rad),
        vapix=head.vapix_from_pan_tilt(pan, tilt, 1.0),
        visible=scene.visible_from_ptz(ray),
    )


def calibration_text(settings: SimSettings, scene: Scene, camera: UnifiedCamera, profile: Profile) -> str:
    """rig.yaml of the rig, with the errors that the settings ask for."""
    error = settings.calibration
    document = {
        "ptzd_calibration": 1,
        "fisheye": _fisheye(camera),
        "ptz": {"size_px": list(settings.ptz_size_px), "zoom": _zoom(settings, profile)},
        "head": _head(settings, profile),
        "rig": _rig(settings, scene),
        "uncertainty": {
            "rotation_deg": error.sigma_rotation_deg,
            "translation_m": error.sigma_translation_m,
            "head_deg": error.sigma_head_deg,
        },
        "provenance": {"source": f"simulated rig, scene {scene.name}, profile {profile.name}"},
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=150)


def _fisheye(camera: UnifiedCamera) -> dict[str, object]:
    return {
        "model": "unified",
        "size_px": list(camera.size_px),
        **{name: float(getattr(camera, name)) for name in ("fx", "fy", "cx", "cy", "xi")},
        "distortion": list(camera.distortion),
        "max_angle_deg": math.degrees(camera.max_angle_rad),
    }


def _zoom(settings: SimSettings, profile: Profile) -> list[dict[str, object]]:
    entries: list[dict[str, object]] = []
    for zoom in calibrated_zooms(profile):
        camera = camera_at(profile, zoom, settings.ptz_size_px)
        focal = camera.fx * (1 + settings.calibration.focal_share)
        entry: dict[str, object] = {"zoom": zoom, "fx": focal, "fy": focal, "cx": camera.cx, "cy": camera.cy}
        entries.append(entry | {"distortion": list(camera.distortion)})
    return entries


def _head(settings: SimSettings, profile: Profile) -> dict[str, object]:
    mount, error = settings.mount or profile.mount, settings.calibration
    sign = -1 if profile.reversed_mount else 1
    pan = {"sign": sign, "scale": mount.pan_scale, "offset_deg": mount.pan_offset_deg + error.pan_offset_deg}
    tilt = {"sign": sign, "scale": mount.tilt_scale, "offset_deg": mount.tilt_offset_deg + error.tilt_offset_deg}
    return {"pan": pan, "tilt": tilt, "camera_rotvec_deg": list(mount.camera_rotvec_deg)}


def _rig(settings: SimSettings, scene: Scene) -> dict[str, object]:
    wrong = cv2.Rodrigues(np.radians(np.array(settings.calibration.rotation_deg)))[0]
    rotvec = cv2.Rodrigues(np.asarray(wrong @ scene.head_from_fisheye_rotation))[0].ravel()
    translation = scene.head_from_fisheye_translation_m + np.array(settings.calibration.translation_m)
    return {
        "rotvec_deg": np.degrees(rotvec).tolist(),
        "translation_m": translation.tolist(),
        "metric": scene.file.head_from_fisheye.metric,
    }
