"""`ptzd locate` on real pixels: the Middlebury motorcycle pair that comes with scikit-image, with its true disparity.

The left picture becomes a low-resolution fisheye, the right one a PTZ view; box, views and calibration go through
files. Facts of the pair: f = 994.978 px, left centre (311.193, 254.877), right centre 31.086 px further right,
baseline 0.193001 m, left (x, y) ↔ right (x - d, y), depth f·B / (d + 31.086).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import skimage
import yaml
from numpy.typing import NDArray

from ptzd.cli import entry
from ptzd.geometry.unified import UnifiedCamera

FOCAL_PX = 994.978
LEFT_CENTRE_PX = (311.193, 254.877)
SHIFT_PX = 31.086
RIGHT_CENTRE_PX = (LEFT_CENTRE_PX[0] + SHIFT_PX, LEFT_CENTRE_PX[1])
BASELINE_M = 0.193001
FISHEYE = UnifiedCamera(
    size_px=(400, 300), fx=760.0, fy=760.0, cx=199.5, cy=149.5, xi=1.1, max_angle_rad=math.radians(60)
)
"""About 362 px per radian at its centre: two and a half times coarser than the left picture."""
PLACES_PX = ((180, 200), (390, 320), (320, 270), (440, 200), (580, 180), (160, 70))
"""Where in the left picture the boxes lie."""
SIDE_PX = 30


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with fisheye.png, view.png, VIEWS.json and rig.yaml."""
    folder = tmp_path_factory.mktemp("motorcycle")
    data = Path(skimage.__file__).parent / "data"
    left, right = cv2.imread(str(data / "motorcycle_left.png")), cv2.imread(str(data / "motorcycle_right.png"))
    cv2.imwrite(str(folder / "fisheye.png"), through_the_lens(left))
    cv2.imwrite(str(folder / "view.png"), right)
    views = [{"image": "view.png", "pan_deg": 0.0, "tilt_deg": 0.0, "zoom": 1.0}]
    (folder / "VIEWS.json").write_text(json.dumps(views))
    (folder / "rig.yaml").write_text(yaml.safe_dump(calibration(right.shape[1], right.shape[0])))
    return folder


@pytest.fixture(scope="module")
def disparity() -> NDArray[np.float32]:
    with np.load(Path(skimage.__file__).parent / "data" / "motorcycle_disp.npz") as archive:
        return archive["arr_0"]


def through_the_lens(left: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The left picture as the fisheye sees it, averaged over each of its pixels."""
    fine = 4
    width, height = FISHEYE.size_px
    x, y = np.meshgrid(*((np.arange(size * fine) + 0.5) / fine - 0.5 for size in (width, height)))
    rays, valid = FISHEYE.lift(np.stack([x, y], axis=-1))
    ahead = valid & (rays[..., 2] > 0.1)
    depth = np.where(ahead, rays[..., 2], 1.0)
    map_x = np.where(ahead, LEFT_CENTRE_PX[0] + FOCAL_PX * rays[..., 0] / depth, -1).astype(np.float32)
    map_y = np.where(ahead, LEFT_CENTRE_PX[1] + FOCAL_PX * rays[..., 1] / depth, -1).astype(np.float32)
    seen = cv2.remap(left, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    return cv2.resize(seen, (width, height), interpolation=cv2.INTER_AREA)


def calibration(width: int, height: int) -> dict[str, object]:
    pinhole = {"zoom": 1, "fx": FOCAL_PX, "fy": FOCAL_PX, "cx": RIGHT_CENTRE_PX[0], "cy": RIGHT_CENTRE_PX[1]}
    axis = {"sign": 1, "scale": 1.0, "offset_deg": 0.0}
    return {
        "ptzd_calibration": 1,
        "fisheye": {
            "model": "unified", "size_px": list(FISHEYE.size_px), "xi": FISHEYE.xi, "distortion": [0.0] * 4,
            **{name: getattr(FISHEYE, name) for name in ("fx", "fy", "cx", "cy")}, "max_angle_deg": 60.0,
        },
        "ptz": {"size_px": [width, height], "zoom": [{**pinhole, "distortion": [0.0] * 5}]},
        "head": {"pan": axis, "tilt": axis},
        "rig": {"rotvec_deg": [0, 0, 0], "translation_m": [-BASELINE_M, 0, 0], "metric": True},
        "uncertainty": {"rotation_deg": 0.05, "translation_m": 0.001, "head_deg": 0.02},
    }  # fmt: skip


def centre_in_fisheye(place_px: tuple[int, int]) -> tuple[float, float]:
    """Where the fisheye sees a place of the left picture."""
    x, y = place_px
    ray = np.array([(x - LEFT_CENTRE_PX[0]) / FOCAL_PX, (y - LEFT_CENTRE_PX[1]) / FOCAL_PX, 1.0])
    pixel, valid = FISHEYE.project(ray / np.linalg.norm(ray))
    assert valid
    return float(pixel[0]), float(pixel[1])


def truth(x: int, y: int, shift_px: float) -> tuple[float, float, float]:
    """Pan and tilt, deg, at which the right camera sees what the left one sees at x, y; range from the left, m."""
    across = (x - shift_px - RIGHT_CENTRE_PX[0]) / FOCAL_PX
    down = (y - RIGHT_CENTRE_PX[1]) / FOCAL_PX
    depth_m = FOCAL_PX * BASELINE_M / (shift_px + SHIFT_PX)
    slant = math.hypot(1.0, (x - LEFT_CENTRE_PX[0]) / FOCAL_PX, (y - LEFT_CENTRE_PX[1]) / FOCAL_PX)
    tilt = math.atan2(-down, math.hypot(across, 1.0))
    return math.degrees(math.atan(across)), math.degrees(tilt), depth_m * slant


Locate = Callable[..., tuple[int, dict[str, Any]]]


@pytest.fixture
def locate(pair: Path, capsys: pytest.CaptureFixture[str]) -> Locate:
    """Runs the command on a place of the left picture; its exit code and what it printed."""

    def run(place_px: tuple[int, int], matcher: str, *more: str) -> tuple[int, dict[str, Any]]:
        u, v = centre_in_fisheye(place_px)
        code = entry([
            "locate", "--calibration", str(pair / "rig.yaml"), "--fisheye", str(pair / "fisheye.png"),
            "--box", f"{u - SIDE_PX / 2},{v - SIDE_PX / 2},{SIDE_PX},{SIDE_PX}", "--views", str(pair / "VIEWS.json"),
            "--matcher", matcher, "--range", "1.5,10", "--json", *more,
        ])  # fmt: skip
        return code, json.loads(capsys.readouterr().out)

    return run


def off_deg(said: dict[str, Any], pan_deg: float, tilt_deg: float) -> float:
    return math.hypot((said["pan_deg"] - pan_deg) * math.cos(math.radians(tilt_deg)), said["tilt_deg"] - tilt_deg)


@pytest.mark.parametrize("place_px", PLACES_PX)
def test_a_region_is_found_where_the_true_disparity_says(
    locate: Locate, disparity: NDArray[np.float32], place_px: tuple[int, int], tmp_path: Path
) -> None:
    drawn = tmp_path / "drawn.png"
    code, said = locate(place_px, "sweep", "--draw", str(drawn))
    pan_deg, tilt_deg, range_m = truth(*place_px, float(disparity[place_px[1], place_px[0]]))
    assert code == 0
    assert said["outcome"] == "found"
    assert off_deg(said, pan_deg, tilt_deg) < 0.15, "one pixel of the fisheye"
    assert said["range_m"] == pytest.approx(range_m, rel=0.05)
    assert said["vapix"] == {
        "pan": pytest.approx(said["pan_deg"], abs=1e-3),
        "tilt": pytest.approx(said["tilt_deg"], abs=1e-3),
    }
    assert said["view"] == 0
    assert said["probability"] >= 0.8
    assert said["score"] > 0.5
    assert 0 < said["sigma_deg"] < 0.2
    assert said["elapsed_ms"] > 0
    centre_x, centre_y = np.mean(said["box_px"], axis=0)
    assert centre_x == pytest.approx(place_px[0] - disparity[place_px[1], place_px[0]], abs=6)
    assert centre_y == pytest.approx(place_px[1], abs=6)
    assert {"view", "pan_deg", "tilt_deg", "score", "range_m"} <= said["candidates"][0].keys()
    assert cv2.imread(str(drawn)).shape == (500, 400 + 741, 3)


def test_the_papers_matcher_finds_some_and_is_never_surely_wrong(
    locate: Locate, disparity: NDArray[np.float32]
) -> None:
    found = 0
    for place_px in PLACES_PX:
        code, said = locate(place_px, "harris")
        pan_deg, tilt_deg, _ = truth(*place_px, float(disparity[place_px[1], place_px[0]]))
        assert (code == 0) == (said["outcome"] == "found")
        if code == 0:
            found += 1
            assert off_deg(said, pan_deg, tilt_deg) < 0.5
        else:
            assert said["outcome"] in {"not_found", "ambiguous", "no_texture"}
            assert said["reason"]
    assert found >= 1
