"""Write a bench scene's scene.yaml: boxes of all sizes at random places, sorted into kinds by their range and texture.

    python scenes/boxes.py yard --out DIR [--count 36] [--seed 1] [--sheet sheet.png]

Nobody chooses a box by hand, so none is there because a matcher finds it. A box is kept when the PTZ camera can see the
surface at its centre. The kind follows from the truth: how far the inverse range over the box is from one plane, how
much of the box belongs to the surface of the centre, and how much texture there is.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import yaml
from place import document, sheet, write
from render import HERE
from unified import fisheye, grid

from ptzd.sim.scene import Scene, load_scene

LARGEST_ANGLE_DEG = 75.0
SIDES_PX = (16, 24, 32, 40, 48, 56)
SKY_M = 25.0
SKY_SHARE = 0.15
"""Of the boxes drawn on a painted sky, this share is kept: nobody points a camera there."""
BASELINE_SHARE = 0.02
"""Inverse range off the plane, times the baseline, from which a box is not planar: 1.1° of parallax."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int, default=36)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sheet", type=Path)
    args = parser.parse_args()
    rig = yaml.safe_load((HERE / args.scene / "rig.yaml").read_text())
    write(args.out / "scene.yaml", document(rig, [], []))
    scene = load_scene(args.out)
    regions = draw(scene, args.count, np.random.default_rng(args.seed))
    write(args.out / "scene.yaml", document(rig, [], regions))
    print({kind: sum(r["kind"] == kind for r in regions) for kind in sorted({r["kind"] for r in regions})})
    if args.sheet:
        cv2.imwrite(str(args.sheet), sheet(load_scene(args.out)))


def draw(scene: Scene, count: int, rng: np.random.Generator) -> list[dict]:
    """Draw boxes until enough can be seen from both cameras and none overlaps another by much."""
    width, height = scene.camera.size_px
    rays, valid = grid(fisheye())
    picture = cv2.cvtColor(scene.sample_fisheye(rays, valid), cv2.COLOR_BGR2GRAY)
    taken = np.zeros((height, width), bool)
    regions: list[dict] = []
    while len(regions) < count:
        w, h = (int(rng.choice(SIDES_PX) * rng.uniform(0.85, 1.15)) for _ in range(2))
        h = int(np.clip(h, w / 1.7, w * 1.7))
        x, y = int(rng.integers(0, width - w)), int(rng.integers(0, height - h))
        area = (slice(y, y + h), slice(x, x + w))
        if not valid[area].all() or taken[area].mean() > 0.15:
            continue
        centre, _ = fisheye().lift(np.array([x + w / 2, y + h / 2]))
        if centre[2] < np.cos(np.radians(LARGEST_ANGLE_DEG)) or not scene.visible_from_ptz(centre):
            continue
        if scene.truth(centre).range_m > SKY_M and rng.random() > SKY_SHARE:
            continue
        taken[area] = True
        kind = kind_of(scene, rays[area].reshape(-1, 3), picture[area], centre, min(w, h))
        regions.append({"name": f"{kind}_{len(regions)}", "x": x, "y": y, "w": w, "h": h, "kind": kind})
    return regions


def kind_of(scene: Scene, rays: np.ndarray, grey: np.ndarray, centre: np.ndarray, side: int) -> str:
    """Texture first, then size, then shape."""
    spread = float(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 1.0).std())
    if spread < 1.0:
        return "texture_free"
    if spread < 7.0:
        return "weak_texture"
    baseline = float(np.linalg.norm(scene.head_from_fisheye_translation_m))
    inverse_range = scene.fisheye_depth.inverse_range(rays) * baseline
    at_centre = float(scene.fisheye_depth.inverse_range(centre[None])[0]) * baseline
    plane, *_ = np.linalg.lstsq(rays, inverse_range, rcond=None)
    off = np.abs(rays @ plane - inverse_range)
    foreign = float((np.abs(inverse_range - at_centre) > 2 * BASELINE_SHARE).mean())
    if foreign > 0.5:
        return "occluded"
    if side < 20:
        return "small"
    if np.quantile(off, 0.9) < 0.1 * BASELINE_SHARE:
        return "planar"
    return "slightly_planar" if np.quantile(off, 0.9) < 0.5 * BASELINE_SHARE else "non_planar"


if __name__ == "__main__":
    main()
