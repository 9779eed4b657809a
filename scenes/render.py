"""Render the room at both viewpoints and write the scene's package data.

    python scenes/render.py room --out ptzd/sim/scenes/room [--work DIR] [--scale 0.25] [--jobs 2]

Needs POV-Ray 3.7 on the path. A face that is already in the work folder is not rendered again.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
FOG_M = 4.0
"""Distance of the fog in room.pov: a depth pixel is 1 - exp(-range / FOG_M)."""
INVERSE_DEPTH_STEP = 1e-4
"""Stored depth: 1 / (distance along the face's axis) in units of this, per metre."""

FACES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]] = {
    "front": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "right": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "back": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "up": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "down": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}
"""Axes (right, down, forward) of each cube face in the viewpoint's frame (x right, y down, z forward)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Viewpoint:
    """One place to render from; `povray_from_frame` has determinant -1 because POV-Ray's y is up."""

    name: str
    location_m: Array
    povray_from_frame: Array
    face_px: dict[str, int]
    jpeg_quality: int


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("room", help="folder of the POV-Ray scene beside this script")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--work", type=Path, default=None, help="keeps the raw PNG faces (default: OUT/../.render)")
    parser.add_argument("--scale", type=float, default=1.0, help="of the face sizes, for a quick look")
    parser.add_argument("--jobs", type=int, default=1, help="POV-Ray processes at once; each uses every core")
    args = parser.parse_args()
    render_scene(args.room, args.out, args.work or args.out.parent / ".render", scale=args.scale, jobs=args.jobs)
    return 0


def render_scene(name: str, out: Path, work: Path, *, scale: float = 1.0, jobs: int = 1) -> None:
    """Render every face that is not in the work folder yet and write all of them as the scene stores them."""
    source = HERE / name
    rig = yaml.safe_load((source / "rig.yaml").read_text())
    for folder in (work, out):
        folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(jobs) as pool:
        faces = [
            pool.submit(make_face, source, view, face, work, out, scale, depth_px)
            for depth_px in (int(rig["depth_face_px"] * scale), 0)
            for view in viewpoints(rig)
            for face in FACES
        ]
        for made in faces:
            sys.stdout.write(made.result() + "\n")
            sys.stdout.flush()


def viewpoints(rig: dict) -> tuple[Viewpoint, Viewpoint]:
    """The head and the fisheye of a rig file, in POV-Ray's coordinates."""
    flip = np.diag([1.0, -1.0, 1.0])
    yaw, pitch, roll = np.radians(rig["head_yaw_pitch_roll_deg"])
    room_from_head = rotation([0, yaw, 0]) @ rotation([pitch, 0, 0]) @ rotation([0, 0, roll])
    pose = rig["head_from_fisheye"]
    head_from_fisheye = rotation(np.radians(pose["rotvec_deg"]))
    head_location = np.array(rig["head_location_m"], float)
    fisheye_location = head_location + flip @ room_from_head @ np.array(pose["translation_m"], float)
    return (
        Viewpoint(name="ptz", location_m=head_location, povray_from_frame=flip @ room_from_head, **rig["ptz"]),
        Viewpoint(
            name="fisheye",
            location_m=fisheye_location,
            povray_from_frame=flip @ room_from_head @ head_from_fisheye,
            **rig["fisheye"],
        ),
    )


def rotation(rotvec_rad: Array | list[float]) -> Array:
    return np.asarray(cv2.Rodrigues(np.asarray(rotvec_rad, float))[0])


def make_face(source: Path, view: Viewpoint, face: str, work: Path, out: Path, scale: float, depth_px: int) -> str:
    """Render one face (a depth face where `depth_px` is not 0) and write it as the scene stores it."""
    size = depth_px or int(view.face_px[face] * scale)
    stem = f"{view.name}_{face}" + ("_depth" if depth_px else "")
    raw = work / f"{stem}_{size}.png"
    if not raw.exists():
        render(source, view, face, size, depth=bool(depth_px), raw=raw)
    pixels = cv2.imread(str(raw), cv2.IMREAD_UNCHANGED)
    if depth_px:
        target = out / f"{stem}.png"
        cv2.imwrite(str(target), encode_depth(pixels[..., 0]), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    else:
        target = out / f"{stem}.jpg"
        quality = [cv2.IMWRITE_JPEG_QUALITY, view.jpeg_quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
        cv2.imwrite(str(target), pixels[..., :3], quality)
    return f"{target.name} {size} px {target.stat().st_size / 1e3:.0f} kB"


def render(source: Path, view: Viewpoint, face: str, size: int, *, depth: bool, raw: Path) -> None:
    right, down, forward = (view.povray_from_frame @ np.array(axis, float) for axis in FACES[face])
    scene = raw.with_suffix(".pov")
    scene.write_text(
        "#version 3.7;\n"
        f"#declare Depth = {int(depth)};\n"
        f"#declare Cam_Location = {vector(view.location_m)};\n"
        f"#declare Cam_Right = {vector(right)};\n"
        f"#declare Cam_Down = {vector(down)};\n"
        f"#declare Cam_Forward = {vector(forward)};\n"
        '#include "room.pov"\n'
    )
    options = ["-A", "Bits_Per_Color=16", "File_Gamma=1.0"] if depth else ["+A0.25", "+AM1", "+R2", "-J"]
    partial = raw.with_suffix(".partial.png")
    command = ["povray", f"+I{scene}", f"+O{partial}", "+FN", f"+W{size}", f"+H{size}", f"+L{source}", "-D", "-GA"]
    subprocess.run([*command, *options], check=True, capture_output=True)
    partial.rename(raw)


def vector(v: Array) -> str:
    return "<" + ", ".join(f"{x:.15f}" for x in v) + ">"


def encode_depth(fog: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Fog of one face to inverse distance along the face's axis, in steps of INVERSE_DEPTH_STEP per metre."""
    if fog.min() == 0 or fog.max() == 65535:
        message = "a depth face has a pixel without a surface"
        raise ValueError(message)
    range_m = -FOG_M * np.log1p(fog.astype(np.float64) / -65535.0)
    n = fog.shape[0]
    u = (2 * np.arange(n) + 1) / n - 1
    cosine = 1 / np.sqrt(1 + u[None, :] ** 2 + u[:, None] ** 2)
    return np.round(1 / (range_m * cosine) / INVERSE_DEPTH_STEP).astype(np.uint16)


if __name__ == "__main__":
    raise SystemExit(main())
