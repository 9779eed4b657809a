"""Writes the regions that the accuracy tests run on: the first of every kind in the yard and the warehouse, as drawn.

python -m tests.bench.subset [--out tests/data/accuracy]

A folder per scene with ``fisheye.jpg``, the views of the scan, ``rig.yaml`` and ``regions.json``; all pictures grey.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import cv2
import numpy as np

from ptzd.calibration.file import dump_rig
from ptzd.geometry.sphere import pan_tilt
from tests.bench.cases import Case, cases
from tests.bench.conditions import CONDITIONS
from tests.bench.stage import RENDERED

FISHEYE_QUALITY, VIEW_QUALITY = 95, 88
CLEAN = CONDITIONS[0]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("tests/data/accuracy"))
    args = parser.parse_args()
    for scene in RENDERED:
        folder = args.out / scene
        folder.mkdir(parents=True, exist_ok=True)
        kinds: dict[str, Case] = {}
        for case in cases(scene, CLEAN):
            kinds.setdefault(case.kind, case)
        first = next(iter(kinds.values()))
        save(folder / "fisheye.jpg", first.fisheye, FISHEYE_QUALITY)
        (folder / "rig.yaml").write_text(dump_rig(first.rig, {"scene": scene, "by": "tests.bench.subset"}))
        listed = [describe(case, folder) for case in kinds.values()]
        (folder / "regions.json").write_text(json.dumps(listed, indent=1) + "\n")


def describe(case: Case, folder: Path) -> dict[str, object]:
    """Write a case's views and say what is in them."""
    views = []
    for index, (reading, picture) in enumerate(case.views):
        name = f"{case.name}_{index}.jpg"
        save(folder / name, picture, VIEW_QUALITY)
        place = {"pan_deg": reading.pan_deg, "tilt_deg": reading.tilt_deg, "zoom": reading.zoom}
        views.append({"image": name, **{key: round(value, 6) for key, value in place.items()}})
    pan, tilt = pan_tilt(case.truths)
    return {
        "name": case.name,
        "kind": case.kind,
        "box": [case.box.x, case.box.y, case.box.w, case.box.h],
        "inverse_range": case.inverse_range,
        "truths_deg": np.degrees(np.stack([pan, tilt], axis=1)).round(5).tolist(),
        "views": views,
    }


def save(path: Path, picture: np.ndarray, quality: int) -> None:
    cv2.imwrite(str(path), picture, [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1])


if __name__ == "__main__":
    main()
