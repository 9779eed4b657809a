"""Real pixels: the Middlebury motorcycle pair with its true disparity, and the two 360° pairs of the package.

The left motorcycle picture becomes a low-resolution fisheye, the right one a PTZ view; how, and the facts of the pair,
stand in ``tests/e2e/test_locate_motorcycle.py``. Boxes lie on a grid over the left picture, wherever the disparity is
known and nothing hides the place in the right picture.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import skimage

from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import bearing
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, HeadReading
from tests.bench.cases import Case, Condition, cases

MOTORCYCLE = "motorcycle"
REAL = (MOTORCYCLE, "pair_hall", "pair_room")
GRID_PX = 70
MARGIN_PX = 60
SIDES_PX = (24, 30, 36)
SPREAD = 1.0
"""Of the low-passed box, grey levels; plainer ones are not asked for."""
RANGE_M = (1.5, 10.0)


def real_cases(name: str) -> Iterator[Case]:
    """All boxes of a real pair, as they are."""
    return motorcycle() if name == MOTORCYCLE else cases(name, Condition(name="clean"))


def motorcycle() -> Iterator[Case]:
    facts = _facts()
    left, right, disparity = _pictures()
    fisheye = cv2.cvtColor(facts.through_the_lens(left), cv2.COLOR_BGR2GRAY)
    view = (HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0), cv2.cvtColor(right, cv2.COLOR_BGR2GRAY))
    height, width = disparity.shape
    places = [(x, y) for y in range(MARGIN_PX, height - MARGIN_PX, GRID_PX) for x in range(130, width - 60, GRID_PX)]
    for index, (x, y) in enumerate(places):
        side = SIDES_PX[index % len(SIDES_PX)]
        u, v = facts.centre_in_fisheye((x, y))
        patch = fisheye[round(v) - side // 2 : round(v) + side // 2, round(u) - side // 2 : round(u) + side // 2]
        if not _seen(disparity, x, y) or cv2.GaussianBlur(patch.astype(np.float32), (0, 0), 1.0).std() < SPREAD:
            continue
        pan_deg, tilt_deg, _ = facts.truth(x, y, float(disparity[y, x]))
        yield Case(
            scene=MOTORCYCLE,
            index=index,
            name=f"{x},{y}",
            kind="real",
            condition="clean",
            rig=_rig(facts, right.shape[1], right.shape[0]),
            box=Box(x=u - side / 2, y=v - side / 2, w=side, h=side),
            fisheye=fisheye,
            views=[view],
            truths=bearing(np.radians(pan_deg), np.radians(tilt_deg))[None],
            visible=True,
            inverse_range=(1.0 / RANGE_M[1], 1.0 / RANGE_M[0]),
            band_deg=0.3,
        )


def _seen(disparity: np.ndarray, x: int, y: int) -> bool:
    """Whether the disparity is known around a place and nothing nearer lies before it in the right picture."""
    around = disparity[y - 1 : y + 2, x - 1 : x + 2]
    if not np.isfinite(around).all():
        return False
    row = disparity[y]
    other = np.arange(len(row)) - row
    return not bool(((np.abs(other - (x - row[x])) < 1.0) & (row > row[x] + 2.0)).any())


def _rig(facts: ModuleType, width: int, height: int) -> Rig:
    cx, cy = facts.RIGHT_CENTRE_PX
    entry = ZoomEntry(zoom=1.0, fx=facts.FOCAL_PX, fy=facts.FOCAL_PX, cx=cx, cy=cy)
    return Rig(
        fisheye=facts.FISHEYE,
        zoom=ZoomTable(size_px=(width, height), entries=(entry,)),
        head=HeadModel(pan=Axis(), tilt=Axis()),
        head_from_fisheye_rotation=np.eye(3),
        head_from_fisheye_translation=np.array([-facts.BASELINE_M, 0.0, 0.0]),
        metric=True,
    )


@cache
def _pictures() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    data = Path(skimage.__file__).parent / "data"
    with np.load(data / "motorcycle_disp.npz") as archive:
        disparity = archive["arr_0"]
    return cv2.imread(str(data / "motorcycle_left.png")), cv2.imread(str(data / "motorcycle_right.png")), disparity


@cache
def _facts() -> ModuleType:
    path = Path(__file__).parents[1] / "e2e" / "test_locate_motorcycle.py"
    spec = importlib.util.spec_from_file_location("motorcycle_facts", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
