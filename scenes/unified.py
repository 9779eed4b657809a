"""The fisheye for which the scenes list their boxes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from ptzd.geometry.unified import UnifiedCamera

PARAMETERS: dict[str, Any] = yaml.safe_load((Path(__file__).resolve().parent / "camera.yaml").read_text())


def fisheye() -> UnifiedCamera:
    """The camera of camera.yaml."""
    model = {key: value for key, value in PARAMETERS.items() if key != "max_angle_deg"}
    model["size_px"] = tuple(model["size_px"])
    model["distortion"] = tuple(model["distortion"])
    return UnifiedCamera(**model, max_angle_rad=math.radians(PARAMETERS["max_angle_deg"]))


def grid(camera: UnifiedCamera) -> tuple[np.ndarray, np.ndarray]:
    """Rays (H, W, 3) and validity (H, W) of the whole picture."""
    width, height = camera.size_px
    x, y = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    return camera.lift(np.stack((x, y), axis=-1))
