"""Write a bench scene's scene.yaml: boxes of all sizes at random places, sorted into kinds by their range and texture.

    python scenes/boxes.py yard --out DIR [--seed 1] [--sheet sheet.png]

Nobody chooses a box by hand, so none is there because a matcher finds it. A box is kept when the PTZ camera can see the
surface at its centre and its kind is still wanted. The kind follows from the truth: how far the inverse range over the
box is from one plane, how much of the box belongs to the surface of the centre, how much texture there is, and whether
the fisheye's picture shows the same again nearby.
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
WANTED = {
    "planar": 6,
    "slightly_planar": 6,
    "non_planar": 6,
    "occluded": 3,
    "small": 4,
    "weak_texture": 3,
    "texture_free": 2,
    "repetitive": 3,
}
"""Boxes of each kind; a scene that has fewer of one gets fewer."""
DRAWS = 8000
SKY_M = 25.0
SKY_SHARE = 0.15
"""Of the boxes drawn on a painted sky, this share is kept: nobody points a camera there."""
ALIKE_PX = 60
ALIKE = 0.92
"""Correlation, within so many pixels to any side, from which the same is there again."""
BASELINE_SHARE = 0.02
"""Inverse range off the plane, times the baseline, that counts as another surface: 1.1° of parallax."""
FOREIGN_SHARE = 0.4
SMALL_PX = 20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--sheet", type=Path)
    args = parser.parse_args()
    print(place_drawn(args.scene, args.out, args.seed))
    if args.sheet:
        cv2.imwrite(str(args.sheet), sheet(load_scene(args.out)))


def place_drawn(name: str, out: Path, seed: int = 1) -> dict[str, int]:
    """Write scene.yaml beside the rendered faces in `out`; return how many boxes of each kind there are."""
    rig = yaml.safe_load((HERE / name / "rig.yaml").read_text())
    write(out / "scene.yaml", document(rig, [], []))
    regions = draw(load_scene(out), np.random.default_rng(seed))
    write(out / "scene.yaml", document(rig, [], regions))
    return {kind: sum(region["kind"] == kind for region in regions) for kind in WANTED}


def draw(scene: Scene, rng: np.random.Generator) -> list[dict]:
    """Draw boxes that both cameras see, none overlapping another by much, until there are enough of every kind."""
    width, height = scene.camera.size_px
    rays, valid = grid(fisheye())
    picture = cv2.cvtColor(scene.sample_fisheye(rays, valid), cv2.COLOR_BGR2GRAY)
    taken = np.zeros((height, width), bool)
    regions: list[dict] = []
    missing = dict(WANTED)
    for _ in range(DRAWS):
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
        kind = kind_of(scene, rays[area].reshape(-1, 3), picture, area, centre)
        if not missing[kind]:
            continue
        taken[area] = True
        missing[kind] -= 1
        regions.append({"name": f"{kind}_{len(regions)}", "x": x, "y": y, "w": w, "h": h, "kind": kind})
    return regions


def kind_of(scene: Scene, rays: np.ndarray, picture: np.ndarray, area: tuple[slice, slice], centre: np.ndarray) -> str:
    """Texture first, then whose surface it is, size, uniqueness and shape."""
    spread = float(cv2.GaussianBlur(picture[area].astype(np.float32), (0, 0), 1.0).std())
    baseline = float(np.linalg.norm(scene.head_from_fisheye_translation_m))
    inverse_range = scene.fisheye_depth.inverse_range(rays) * baseline
    at_centre = float(scene.fisheye_depth.inverse_range(centre[None])[0]) * baseline
    plane, *_ = np.linalg.lstsq(rays, inverse_range, rcond=None)
    off = float(np.quantile(np.abs(rays @ plane - inverse_range), 0.9)) / BASELINE_SHARE
    kinds = {
        "texture_free": spread < 1.0,
        "weak_texture": spread < 7.0,
        "occluded": (np.abs(inverse_range - at_centre) > BASELINE_SHARE).mean() > FOREIGN_SHARE,
        "small": min(picture[area].shape) < SMALL_PX,
        "repetitive": again_nearby(picture, area) > ALIKE,
        "planar": off < 0.1,
        "slightly_planar": off < 0.5,
        "non_planar": True,
    }
    return next(kind for kind, applies in kinds.items() if applies)


def again_nearby(picture: np.ndarray, area: tuple[slice, slice]) -> float:
    """Best correlation with the surroundings, a third of the box or more away."""
    rows, columns = area
    top, left = max(rows.start - ALIKE_PX, 0), max(columns.start - ALIKE_PX, 0)
    around = picture[top : rows.stop + ALIKE_PX, left : columns.stop + ALIKE_PX]
    response = cv2.matchTemplate(around, picture[area], cv2.TM_CCOEFF_NORMED)
    y, x = rows.start - top, columns.start - left
    high, wide = (max(side // 3, 6) for side in picture[area].shape)
    response[max(y - high, 0) : y + high + 1, max(x - wide, 0) : x + wide + 1] = -1.0
    return float(response.max())


if __name__ == "__main__":
    main()
