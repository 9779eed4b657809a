"""Measure how well the two viewpoints of a scene with depth agree.

    python scenes/check.py ptzd/sim/scenes/room [--patches 400]

Patches of 4 degrees seen from the fisheye are drawn a second time from the PTZ camera's picture through the depth; the
shift left between the two drawings, by phase correlation, is the error of depth, rig and sampling together.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from ptzd.sim.scene import Scene, load_scene

PATCH_PX = 64
PIXEL_RAD = np.radians(4.0) / PATCH_PX


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--patches", type=int, default=400)
    args = parser.parse_args()
    scene = load_scene(args.scene)
    rng = np.random.default_rng(1)
    shifts, correlations = [], []
    for _ in range(args.patches):
        axis = rng.normal(size=3)
        axis[2] = abs(axis[2])
        measured = residual(scene, axis / np.linalg.norm(axis))
        if measured:
            shifts.append(np.degrees(measured[0] * PIXEL_RAD))
            correlations.append(measured[1])
    print(f"{len(shifts)} textured patches seen whole from both viewpoints, of {args.patches}")
    for name, values in (("shift, deg", shifts), ("correlation", correlations)):
        print(f"{name}: median {np.median(values):.4f}, 5 % {np.percentile(values, 5):.4f}, "
              f"95 % {np.percentile(values, 95):.4f}")  # fmt: skip


def residual(scene: Scene, axis: np.ndarray) -> tuple[float, float] | None:
    """Shift in patch pixels and correlation; None where the patch is plain, dim or partly hidden."""
    right = np.cross([0, 1, 0], axis)
    right /= np.linalg.norm(right)
    t = (np.arange(PATCH_PX) - PATCH_PX / 2) * PIXEL_RAD
    rays = axis + t[None, :, None] * right + t[:, None, None] * np.cross(axis, right)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    s = scene.fisheye_depth.inverse_range(rays.reshape(-1, 3)).reshape(PATCH_PX, PATCH_PX, 1)
    turned = rays @ scene.head_from_fisheye_rotation.T
    points = turned / s + scene.head_from_fisheye_translation_m
    ranges = np.linalg.norm(points, axis=-1, keepdims=True)
    bearings = points / ranges
    free = scene.ptz_depth.farthest_nearby(bearings.reshape(-1, 3)).reshape(ranges.shape)
    if np.any(ranges * free > 1.02):
        return None
    pair = [scene.fisheye_colour.sample(rays, PIXEL_RAD * 2), scene.ptz_colour.sample(bearings, PIXEL_RAD * 2)]
    grey = [cv2.GaussianBlur(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY).astype(np.float32), (0, 0), 1.5) for p in pair]
    if grey[0].std() < 6 or grey[0].max() > 250:
        return None
    window = cv2.createHanningWindow((PATCH_PX, PATCH_PX), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(grey[0] - grey[0].mean(), grey[1] - grey[1].mean(), window)
    return float(np.hypot(dx, dy)), float(np.corrcoef(grey[0].ravel(), grey[1].ravel())[0, 1])


if __name__ == "__main__":
    main()
