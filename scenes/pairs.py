"""Package real 360-degree pairs as scenes, with the truth of their boxes found by careful matching.

    python scenes/pairs.py --data DIR --out ptzd/sim/scenes [--sheet DIR]

DIR holds image_up/*.png, image_down/*.png (equirectangular, one camera above the other) and LICENSE. The upper picture
becomes the fisheye's viewpoint, the lower one the PTZ camera's.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from place import write
from unified import PARAMETERS, fisheye, grid

from ptzd.sim.scene import load_scene

HERE = Path(__file__).resolve().parent
CREDIT = "360SD-Net real-world test images, (c) 2019 albert100121; see LICENSE. Baseline: about 0.2 m."
WINDOWS_PX = (5.0, 7.0, 9.0, 12.0)
"""Half-widths of the matching windows; Gaussian weight with half of that as standard deviation."""
LARGEST_SPREAD_PX = 0.35
LEAST_CORRELATION = 0.8


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """Both pictures with wrapped columns, and the column shift of the lower one against the upper one."""

    up: np.ndarray
    down: np.ndarray
    shift_px: float
    width: int
    height: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Match:
    """Row in the lower picture, with what speaks for it."""

    row: float
    spread_px: float
    correlation: float
    across_px: float


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sheet", type=Path, help="folder for pictures of the boxes beside their matches")
    args = parser.parse_args()
    config = yaml.safe_load((HERE / "pairs.yaml").read_text())
    for name, entry in config["scenes"].items():
        folder = args.out / name
        folder.mkdir(parents=True, exist_ok=True)
        for side, target in (("image_up", "fisheye.png"), ("image_down", "ptz.png")):
            shutil.copyfile(args.data / side / f"{entry['picture']}.png", folder / target)
        shutil.copyfile(args.data / "LICENSE", folder / "LICENSE")
        pair = load_pair(folder)
        print(f"{name}: columns of the lower picture are shifted by {pair.shift_px:+.3f} px")
        write(folder / "scene.yaml", document(pair, entry, config))
        if args.sheet:
            sheets(name, folder, args.sheet)


def load_pair(folder: Path) -> Pair:
    up, down = (cv2.imread(str(folder / name)) for name in ("fisheye.png", "ptz.png"))
    height, width = up.shape[:2]
    wrapped = [np.concatenate((p[:, -64:], p, p[:, :64]), axis=1).astype(np.float32) for p in (up, down)]
    return Pair(up=wrapped[0], down=wrapped[1], shift_px=column_shift(up, down), width=width, height=height)


def column_shift(up: np.ndarray, down: np.ndarray) -> float:
    """Median difference of the columns of matched features; also says that `up` is really the higher camera."""
    finder = cv2.SIFT_create(4000)
    found = [finder.detectAndCompute(cv2.cvtColor(p, cv2.COLOR_BGR2GRAY), None) for p in (up, down)]
    matches = cv2.BFMatcher(cv2.NORM_L2, crossCheck=True).match(found[0][1], found[1][1])
    moved = np.array(
        [np.subtract(found[1][0][m.trainIdx].pt, found[0][0][m.queryIdx].pt) for m in matches if m.distance < 200]
    )
    moved = moved[np.abs(moved[:, 0]) < 1.5]
    if np.median(moved[:, 1]) >= 0:
        message = "things should be higher in the picture of the lower camera: are the two exchanged?"
        raise ValueError(message)
    return float(np.median(moved[:, 0]))


def document(pair: Pair, entry: dict, config: dict) -> dict:
    picture_from_fisheye, picture_from_head = orientations(entry["column"], pair.width, config)
    down_from_up = rotation([0, 2 * np.pi * pair.shift_px / pair.width, 0])
    up_in_down = np.array([0, -config["baseline_m"], 0])
    pose = {
        "rotvec_deg": degrees(picture_from_head.T @ down_from_up @ picture_from_fisheye),
        "translation_m": rounded(picture_from_head.T @ up_in_down),
        "metric": True,
    }
    boxes = []
    for listed in entry["boxes"]:
        w, h = listed["box"]
        x, y = (round(p - side / 2) for p, side in zip(listed["at"], (w, h), strict=True))
        box = {"name": listed["name"], "x": x, "y": y, "w": w, "h": h, "kind": listed["kind"]}
        ray, _ = fisheye().lift(np.array([x + w / 2, y + h / 2]))
        truth = find_truth(pair, picture_from_fisheye @ ray, config["baseline_m"], listed["name"])
        if truth:
            bearing, range_m, sigma_deg = truth
            box["truth"] = {
                "ray_fisheye": rounded(ray),
                "bearing_head": rounded(picture_from_head.T @ bearing),
                "range_m": round(range_m, 3),
                "sigma_deg": sigma_deg,
            }
            boxes.append(box)
    return {
        "title": entry["title"],
        "kind": "equirect",
        "licence": "MIT",
        "credit": CREDIT,
        "head_from_fisheye": pose,
        "fisheye": {"colour": "fisheye.png", "picture_from_frame_rotvec_deg": degrees(picture_from_fisheye)},
        "ptz": {"colour": "ptz.png", "picture_from_frame_rotvec_deg": degrees(picture_from_head)},
        "camera": PARAMETERS,
        "ptz_hfov_deg": 60.0,
        "demo_boxes": [box for name in entry["demo"] for box in boxes if box["name"] == name],
        "regions": boxes,
    }


def orientations(column: float, width: int, config: dict) -> tuple[np.ndarray, np.ndarray]:
    """picture_from_fisheye and picture_from_head."""
    yaw = rotation([0, 2 * np.pi * ((column + 0.5) / width - 0.5), 0])
    pitch = rotation(np.radians([config["fisheye_pitch_deg"], 0, 0]))
    return yaw @ pitch, yaw @ rotation(np.radians(config["head_turn_deg"]))


def find_truth(pair: Pair, ray: np.ndarray, baseline_m: float, name: str) -> tuple[np.ndarray, float, float] | None:
    """Direction in the lower picture, range from the upper camera in metres, and standard deviation in degrees."""
    column = (np.arctan2(ray[0], ray[2]) / (2 * np.pi) + 0.5) * pair.width - 0.5
    row = (np.arcsin(ray[1]) / np.pi + 0.5) * pair.height - 0.5
    match = find_match(pair, column, row)
    good = match.spread_px < LARGEST_SPREAD_PX and match.correlation > LEAST_CORRELATION
    down = np.pi * ((match.row + 0.5) / pair.height - 0.5)
    up = np.arcsin(ray[1])
    inverse_range = (np.sin(up) - np.cos(up) * np.tan(down)) / baseline_m
    print(
        f"  {name:18s} moved {match.row - row:+7.2f} px  spread {match.spread_px:.2f}  across {match.across_px:+.2f}  "
        f"correlation {match.correlation:.3f}  range {1 / inverse_range:.2f} m{'' if good else '  REFUSED'}"
    )
    if not good or inverse_range <= 0:
        return None
    around = 2 * np.pi * ((column + pair.shift_px + 0.5) / pair.width - 0.5)
    bearing = np.array([np.sin(around) * np.cos(down), np.sin(down), np.cos(around) * np.cos(down)])
    sigma_deg = np.hypot(max(match.spread_px, 0.1), match.across_px) * 180 / pair.height
    return bearing, float(1 / inverse_range), round(float(sigma_deg), 3)


def find_match(pair: Pair, column: float, row: float) -> Match:
    """Match with every window, there and back; the spread is the largest departure from the median."""
    rows, votes, scores, across = [], [], [], []
    for half in WINDOWS_PX:
        there, score, _ = search(pair.up, pair.down, (column, row), pair.shift_px, (-40, 1), half)
        back, _, _ = search(pair.down, pair.up, (column + pair.shift_px, there), -pair.shift_px, (-1, 40), half)
        rows.append(there)
        votes.extend((there, there + row - back))
        scores.append(score)
        shifts = np.arange(-1, 1.01, 0.1)
        line = [
            search(pair.up, pair.down, (column, row), pair.shift_px + d, (there - row,) * 2, half)[1] for d in shifts
        ]
        across.append(shifts[int(np.argmax(line))])
    found = float(np.median(rows))
    return Match(
        row=found,
        spread_px=float(np.max(np.abs(np.array(votes) - found))),
        correlation=float(np.median(scores)),
        across_px=float(np.median(across)),
    )


def search(
    source: np.ndarray,
    target: np.ndarray,
    at: tuple[float, float],
    shift_px: float,
    rows: tuple[float, float],
    half: float,
) -> tuple[float, float, float]:
    """Best row of `target` for the window of `source` at (column, row), its correlation and that of the runner-up."""
    t = np.arange(-half, half + 0.5)
    weight = np.exp(-0.5 * (t[:, None] ** 2 + t**2) / (half / 2) ** 2)[..., None]
    patch = window(source, at[0], at[1], t)
    moves = np.arange(rows[0], rows[1] + 1e-9, 0.1) if rows[1] > rows[0] else np.array([rows[0]])
    scores = np.array([correlation(patch, window(target, at[0] + shift_px, at[1] + m, t), weight) for m in moves])
    k = int(np.argmax(scores))
    move = moves[k]
    if 0 < k < len(moves) - 1:
        a, b, c = scores[k - 1 : k + 2]
        move += 0.1 * 0.5 * (a - c) / (a - 2 * b + c)
    far = scores[np.abs(moves - move) > 3]
    return float(at[1] + move), float(scores[k]), float(far.max(initial=-1))


def window(picture: np.ndarray, column: float, row: float, t: np.ndarray) -> np.ndarray:
    x = np.broadcast_to(column + 64 + t[None, :], (len(t), len(t))).astype(np.float32)
    y = np.broadcast_to(row + t[:, None], (len(t), len(t))).astype(np.float32)
    return cv2.remap(picture, np.ascontiguousarray(x), np.ascontiguousarray(y), cv2.INTER_CUBIC)


def correlation(a: np.ndarray, b: np.ndarray, weight: np.ndarray) -> float:
    """Weighted zero-mean correlation over all three channels, each about its own mean."""
    total = weight.sum()
    a = a - (weight * a).sum(axis=(0, 1)) / total
    b = b - (weight * b).sum(axis=(0, 1)) / total
    return float((weight * a * b).sum() / np.sqrt((weight * a * a).sum() * (weight * b * b).sum() + 1e-9))


def rotation(rotvec_rad: list[float] | np.ndarray) -> np.ndarray:
    return cv2.Rodrigues(np.asarray(rotvec_rad, float))[0]


def degrees(matrix: np.ndarray) -> list[float]:
    return rounded(np.degrees(cv2.Rodrigues(matrix)[0].ravel()))


def rounded(values: np.ndarray) -> list[float]:
    return [round(float(v), 7) for v in values]


def sheets(name: str, folder: Path, out: Path) -> None:
    """Each box as the fisheye's viewpoint sees it, beside the PTZ camera's view centred on the truth."""
    out.mkdir(parents=True, exist_ok=True)
    scene = load_scene(folder)
    picture = cv2.resize(scene.sample_fisheye(*grid(fisheye())), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    rows = []
    for box in scene.regions:
        low, high = ((round(2 * x), round(2 * y)) for x, y in ((box.x, box.y), (box.x + box.w, box.y + box.h)))
        cv2.rectangle(picture, low, high, (0, 255, 0) if box in scene.demo_boxes else (0, 200, 255), 1)
        cv2.putText(picture, box.name, low, cv2.FONT_HERSHEY_PLAIN, 0.8, (255, 255, 255))
        ray, _ = fisheye().lift(np.array(box.centre_px))
        views = tangent(ray), tangent(scene.head_from_fisheye_rotation.T @ scene.truth(ray).bearing_head)
        left = scene.sample_fisheye(views[0], np.ones((200, 200), bool))
        right = scene.sample_ptz(views[1] @ scene.head_from_fisheye_rotation.T, 1e-3)
        both = np.hstack((left, right))
        for x in (100, 300):
            cv2.drawMarker(both, (x, 100), (0, 255, 0), cv2.MARKER_CROSS, 14, 1)
        cv2.putText(both, box.name, (4, 14), cv2.FONT_HERSHEY_PLAIN, 0.9, (255, 255, 255))
        rows.append(both)
    rows.extend(np.zeros_like(rows[0]) for _ in range(-len(rows) % 3))
    cv2.imwrite(str(out / f"{name}.png"), picture)
    cv2.imwrite(str(out / f"{name}_boxes.png"), np.vstack([np.hstack(rows[i : i + 3]) for i in range(0, len(rows), 3)]))


def tangent(axis: np.ndarray) -> np.ndarray:
    """Rays of a 200 x 200 view of 16 degrees."""
    right = np.cross([0, 1, 0], axis)
    right /= np.linalg.norm(right)
    t = (np.arange(200) - 100) * np.radians(16) / 200
    rays = axis + t[None, :, None] * right + t[:, None, None] * np.cross(axis, right)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


if __name__ == "__main__":
    main()
