"""What can change the last bits of a result: versions, CPU features, libraries, threads."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from importlib import metadata

import cv2
import numpy as np

from ptzd import __version__

_PACKAGES = ("numpy", "opencv-python-headless", "scipy", "eclipse-zenoh", "aiohttp", "mcap", "msgspec")


def versions() -> dict[str, str]:
    """Version of everything that takes part in a decision."""
    found = {"ptzd": __version__, "python": platform.python_version()}
    return found | {name: metadata.version(name) for name in _PACKAGES}


def fingerprint() -> Mapping[str, str]:
    """Two machines with the same fingerprint compute the same bits."""
    build = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()[:16]
    simd = np.show_config(mode="dicts")
    found = simd.get("SIMD Extensions", {}).get("found", []) if isinstance(simd, dict) else []
    return {
        "machine": platform.machine(),
        "cpu": cv2.getCPUFeaturesLine(),
        "numpy_simd": " ".join(str(item) for item in found),
        "opencv_build": build,
        "opencv_threads": str(cv2.getNumThreads()),
    } | {name: metadata.version(name) for name in _PACKAGES[:3]}
