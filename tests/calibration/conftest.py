"""Real corners and random rigs."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

from ptzd.calibration.boards import BoardPair, Seen
from ptzd.calibration.intrinsics import LensFit, calibrate_lens
from ptzd.calibration.lens import PERSPECTIVE
from ptzd.calibration.target import Target
from ptzd.calibration.views import BoardView

DATA = Path(__file__).parents[1] / "data" / "calibration"


def load_views(name: str, prefix: str = "") -> list[BoardView]:
    document = json.loads((DATA / name).read_text())
    target = Target(columns=document["columns"], rows=document["rows"], pitch_m=document["pitch_m"])
    return [
        BoardView(name=key, points_m=target.points_m(), pixels=np.array(pixels), about_m=target.about_m())
        for key, pixels in document["views"].items()
        if key.startswith(prefix)
    ]


def pairs_of(first: LensFit, second: LensFit, key) -> list[BoardPair]:
    partners = {key(view.name): view for view in second.views}

    def seen(fit: LensFit, view: BoardView) -> Seen:
        return Seen(lens=fit.lens, values=fit.values, camera=fit.camera(), view=view, head_from_camera=np.eye(3))

    return [
        BoardPair(name=key(view.name), fisheye=seen(first, view), ptz=seen(second, partners[key(view.name)]))
        for view in first.views
        if key(view.name) in partners
    ]


@pytest.fixture(scope="session")
def pairing():
    return pairs_of


@pytest.fixture(scope="session")
def fisheye_views() -> list[BoardView]:
    return load_views("fisheye_corners.json")


@pytest.fixture(scope="session")
def stereo_fits() -> tuple[LensFit, LensFit]:
    fits = [
        calibrate_lens(load_views("stereo_corners.json", side), (640, 480), PERSPECTIVE, held_out=False)
        for side in ("left", "right")
    ]
    return fits[0], fits[1]


@pytest.fixture(scope="session")
def stereo_pairs(stereo_fits) -> list[BoardPair]:
    return pairs_of(*stereo_fits, lambda name: name.removeprefix("left").removeprefix("right"))


@pytest.fixture(scope="session")
def real_data() -> Path:
    folder = os.environ.get("PTZD_DATA")
    if folder is None:
        pytest.skip("PTZD_DATA does not name the folder of the real data sets")
    return Path(folder)
