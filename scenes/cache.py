"""Have the ray-traced scenes ready: render what is missing or older than its source.

    python scenes/cache.py [room yard warehouse] [--jobs 2]

They go to $XDG_CACHE_HOME/ptzd/scenes if that is set, else to build/scenes of the repository, where
`make bench-accuracy` looks for them. Pictures and boxes each belong to the digest of what they are made from: after a
change they are made anew.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:
    sys.path.insert(0, str(HERE))

from boxes import place_drawn  # noqa: E402  beside this file, whoever imports it
from place import place_listed  # noqa: E402
from render import render_scene  # noqa: E402

NAMES = ("room", "yard", "warehouse")
FACES_FROM = ("render.py", "room/macros.inc")
"""What the pictures depend on besides the scene's own rig.yaml, *.pov and *.inc."""
BOXES_FROM = ("boxes.py", "place.py", "camera.yaml", "unified.py")
"""What the boxes depend on besides the pictures and the scene's own regions.yaml."""


def root() -> Path:
    """Folder of all rendered scenes."""
    home = os.environ.get("XDG_CACHE_HOME")
    return Path(home) / "ptzd" / "scenes" if home else HERE.parent / "build" / "scenes"


def digest(paths: set[Path]) -> str:
    """Of names and contents."""
    total = hashlib.sha256()
    for path in sorted(paths):
        total.update(path.relative_to(HERE).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return total.hexdigest()


def stamps(name: str) -> dict[Path, str]:
    """Where the digests of the pictures and of the boxes are kept, and what they must be now."""
    own = set((HERE / name).iterdir())
    faces = {path for path in own if path.name != "regions.yaml"} | {HERE / shared for shared in FACES_FROM}
    boxes = own | faces | {HERE / shared for shared in BOXES_FROM}
    out = root() / name
    return {out / "faces.sha256": digest(faces), out / "boxes.sha256": digest(boxes)}


def folder(name: str, jobs: int = 1) -> Path:
    """Folder of a rendered scene, rendered first if need be.

    Raises
    ------
    SystemExit
        In one line, when it must be rendered and POV-Ray is not installed.
    """
    out = root() / name
    (faces, faces_now), (boxes, boxes_now) = stamps(name).items()
    if not kept(faces, faces_now):
        if shutil.which("povray") is None:
            raise SystemExit(f"scene {name} must be rendered and povray is not on the path: apt-get install povray")
        work = root() / f".faces-{name}-{faces_now[:12]}"
        render_scene(name, out, work, jobs=jobs)
        faces.write_text(faces_now)
        shutil.rmtree(work)
    if not kept(boxes, boxes_now):
        (place_listed if (HERE / name / "regions.yaml").is_file() else place_drawn)(name, out)
        boxes.write_text(boxes_now)
    return out


def kept(stamp: Path, now: str) -> bool:
    """Whether what the stamp stands for is there and as it must be."""
    return stamp.is_file() and stamp.read_text() == now


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=NAMES, help="scenes; default: all")
    parser.add_argument("--jobs", type=int, default=1, help="POV-Ray processes at once; each uses every core")
    args = parser.parse_args()
    for name in args.names:
        print(f"{name}: {folder(name, args.jobs)}")


if __name__ == "__main__":
    main()
