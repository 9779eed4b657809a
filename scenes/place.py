"""Write the room's scene.yaml: every listed thing becomes a box in the scene's own fisheye.

    python scenes/place.py room --out ptzd/sim/scenes/room [--sheet sheet.png]

The faces and depth faces must be there already (scenes/render.py). A thing whose box centre does not show it, or which
the PTZ camera cannot see, is reported.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np
import yaml
from render import HERE, INVERSE_DEPTH_STEP, viewpoints
from unified import PARAMETERS, fisheye, grid

from ptzd.sim.scene import Scene, load_scene

CREDIT = "Modelled for ptzd in POV-Ray; every texture is procedural. Same licence as ptzd."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("room")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sheet", type=Path, help="write the fisheye picture with the boxes here")
    args = parser.parse_args()
    rig = yaml.safe_load((HERE / args.room / "rig.yaml").read_text())
    listed = yaml.safe_load((HERE / args.room / "regions.yaml").read_text())
    place_listed(args.room, args.out)
    scene = load_scene(args.out)
    report(scene, {thing["name"]: np.array(thing["at"]) for thing in listed["regions"]}, rig)
    if args.sheet:
        cv2.imwrite(str(args.sheet), sheet(scene))


def place_listed(name: str, out: Path) -> None:
    """Write scene.yaml beside the rendered faces in `out`."""
    rig = yaml.safe_load((HERE / name / "rig.yaml").read_text())
    listed = yaml.safe_load((HERE / name / "regions.yaml").read_text())
    regions = [place(thing, rig) for thing in listed["regions"]]
    demo = [region for name in listed["demo"] for region in regions if region["name"] == name]
    write(out / "scene.yaml", document(rig, demo, regions))


def place(thing: dict, rig: dict) -> dict:
    """Box of a thing, centred on the projection of its place and rounded to whole pixels of position."""
    view = viewpoints(rig)[1]
    ray = view.povray_from_frame.T @ (np.array(thing["at"]) - view.location_m)
    pixel, valid = fisheye().project(ray)
    if not valid:
        message = f"{thing['name']} is outside the image circle"
        raise ValueError(message)
    w, h = thing["box"]
    x, y = (round(float(p - side / 2)) for p, side in zip(pixel, (w, h), strict=True))
    return {"name": thing["name"], "x": x, "y": y, "w": w, "h": h, "kind": thing["kind"]}


def document(rig: dict, demo: list[dict], regions: list[dict]) -> dict:
    def files(name: str) -> dict:
        pattern = {"colour": f"{name}_{{face}}.jpg", "depth": f"{name}_{{face}}_depth.png"}
        return pattern | {"depth_step": INVERSE_DEPTH_STEP}

    return {
        "title": rig["title"],
        "kind": "cube",
        "licence": "Apache-2.0",
        "credit": CREDIT,
        "head_from_fisheye": {**rig["head_from_fisheye"], "metric": True},
        "fisheye": files("fisheye"),
        "ptz": files("ptz"),
        "camera": PARAMETERS,
        "ptz_hfov_deg": 60.0,
        "demo_boxes": demo,
        "regions": regions,
    }


def write(path: Path, content: dict) -> None:
    class Plain(yaml.SafeDumper):
        def ignore_aliases(self, _: object) -> bool:
            return True

    text = yaml.dump(content, Dumper=Plain, sort_keys=False, width=118, default_flow_style=None)
    path.write_text(text, encoding="utf-8")


def report(scene: Scene, places: dict[str, np.ndarray], rig: dict) -> None:
    view = viewpoints(rig)[1]
    for box in scene.regions:
        ray = fisheye().lift(np.array(box.centre_px))[0]
        truth = scene.truth(ray)
        hit = view.location_m + view.povray_from_frame @ ray * truth.range_m
        gap = float(np.linalg.norm(hit - places[box.name]))
        seen = "" if scene.visible_from_ptz(ray) else "  HIDDEN from the PTZ"
        note = "  something else is in front" if gap > 0.2 else ""
        print(f"{box.name:26s} {box.kind:16s} range {truth.range_m:5.2f} m  gap {gap:5.2f} m{seen}{note}")


def sheet(scene: Scene) -> np.ndarray:
    picture = cv2.resize(scene.sample_fisheye(*grid(fisheye())), None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    for box in (*scene.regions, *scene.demo_boxes):
        colour = (0, 255, 0) if box in scene.demo_boxes else (0, 200, 255)
        corners = [(round(2 * x), round(2 * y)) for x, y in ((box.x, box.y), (box.x + box.w, box.y + box.h))]
        cv2.rectangle(picture, *corners, colour, 1)
        cv2.putText(picture, box.name, corners[0], cv2.FONT_HERSHEY_PLAIN, 0.8, colour)
    return picture


if __name__ == "__main__":
    main()
