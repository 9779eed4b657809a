"""What can change the last bits of a result: versions, CPU features, libraries, threads."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Mapping
from functools import cache
from importlib import metadata
from pathlib import Path

import cv2
import numpy as np

from ptzd import __version__
from ptzd.commit import commit

CPUINFO = Path("/proc/cpuinfo")
_PACKAGES = ("numpy", "opencv-python-headless", "scipy", "eclipse-zenoh", "aiohttp", "mcap", "msgspec", "simplejpeg")
_DISPATCH = ("OPENCV_CPU_DISABLE", "OPENCV_IPP", "NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE")
"""Variables with which libraries are told to use other code than what the CPU could run."""


def versions() -> dict[str, str]:
    """Version of everything that takes part in a decision."""
    found = {"ptzd": __version__, "commit": commit() or "unknown", "python": platform.python_version()}
    return found | {name: _version(name) for name in _PACKAGES}


def fingerprint() -> Mapping[str, str]:
    """Two machines with the same fingerprint compute the same bits."""
    build = hashlib.sha256(cv2.getBuildInformation().encode()).hexdigest()[:16]
    config = np.show_config(mode="dicts")
    numpy_config = config if isinstance(config, dict) else {}
    simd = numpy_config.get("SIMD Extensions", {}).get("found", [])
    blas = numpy_config.get("Build Dependencies", {}).get("blas", {})
    return {
        "machine": platform.machine(),
        "libc": " ".join(platform.libc_ver()),
        "cpu_model": _cpu_model(),
        "cpu": cv2.getCPUFeaturesLine(),
        "dispatch": " ".join(f"{name}={os.environ[name]}" for name in _DISPATCH if name in os.environ),
        "numpy_simd": " ".join(str(item) for item in simd),
        "opencv_build": build,
        "opencv_threads": str(cv2.getNumThreads()),
        "blas": f"{blas.get('name', '')} {blas.get('version', '')}",
        "blas_threads": os.environ.get("OPENBLAS_NUM_THREADS", str(len(os.sched_getaffinity(0)))),
    } | {name: _version(name) for name in _PACKAGES[:3]}


@cache
def _version(package: str) -> str:
    """Its version as installed when it was first asked for: what this process has loaded."""
    return metadata.version(package)


def _cpu_model() -> str:
    """What OpenBLAS picks its kernels by, as the kernel tells it; empty where it does not."""
    try:
        lines = CPUINFO.read_text().splitlines()
    except OSError:
        return ""
    told = dict(line.replace("\t", "").partition(":")[::2] for line in lines if ":" in line)
    return " ".join(told.get(name, "").strip() for name in ("model name", "CPU part")).strip()
