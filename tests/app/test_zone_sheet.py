"""What `ptzd check` says and draws of zones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from ptzd.app.checking import check_files
from ptzd.app.loading import Loaded, load
from ptzd.app.zone_sheet import zone_sheet
from ptzd.cli import entry
from ptzd.errors import ConfigError

CALIBRATION = (Path(__file__).parents[2] / "config" / "rig.example.yaml").read_text()
ZONES = [
    {"name": "sun", "kind": "no_go", "frame": "head", "corners_deg": [[40, 30], [60, 30], [60, 50], [40, 50]]},
    {
        "name": "window",
        "kind": "privacy",
        "frame": "fisheye",
        "corners_px": [[360, 300], [420, 300], [420, 350], [360, 350]],
        "range_m": [8, 9],
    },
    {"name": "tree", "kind": "ignore", "frame": "fisheye", "corners_px": [[200, 200], [240, 200], [220, 240]]},
]


@pytest.fixture
def loaded(tmp_path: Path) -> Loaded:
    (tmp_path / "rig.yaml").write_text(CALIBRATION)
    settings = {
        "rig": "hall",
        "calibration": "rig.yaml",
        "fisheye": {"source": "files", "path": "pictures"},
        "ptz": {"url": "http://192.0.2.20", "user": "ptzd"},
        "zones": "zones.yaml",
    }
    (tmp_path / "zones.yaml").write_text(yaml.safe_dump({"zones": ZONES}))
    (tmp_path / "ptzd.yaml").write_text(yaml.safe_dump(settings))
    return load(tmp_path / "ptzd.yaml")


def picture(loaded: Loaded) -> np.ndarray:
    width, height = loaded.rig.fisheye.size_px
    return np.full((height, width, 3), 120, np.uint8)


def test_each_zone_is_a_line(loaded) -> None:
    told = [line for line in check_files(loaded) if line.startswith("zones")]
    assert [line.split()[1] for line in told] == ["sun:", "window:", "tree:"]
    assert "no_go, closes " in told[0]
    assert "at range 8 to 9 m" in told[1]
    assert "refuses boxes" in told[2]


def test_the_drawing_shows_every_zone_and_nothing_private(loaded) -> None:
    bare, over = zone_sheet(loaded, None), zone_sheet(loaded, picture(loaded))
    width, height = loaded.rig.fisheye.size_px
    assert bare.shape == over.shape
    assert over.shape[0] >= height
    assert over.shape[1] > width
    assert over[325, 390].max() == 0, "the middle of the private window"
    for colour in ((60, 60, 235), (220, 90, 180), (40, 180, 250)):
        assert (over[:, :width] == colour).all(axis=-1).any()


def test_a_picture_of_another_size_is_refused(loaded) -> None:
    with pytest.raises(ConfigError, match="the picture is 100×50 px, the calibration is for"):
        zone_sheet(loaded, np.zeros((50, 100, 3), np.uint8))


def test_on_the_command_line(loaded, tmp_path, capsys) -> None:
    cv2.imwrite(str(tmp_path / "frame.jpg"), picture(loaded))
    drawn = tmp_path / "zones.png"
    assert (
        entry(["check", "--config", str(loaded.path), "--zones", str(drawn), "--picture", str(tmp_path / "frame.jpg")])
        == 0
    )
    assert f"drawn into {drawn}" in capsys.readouterr().out
    assert cv2.imread(str(drawn)).shape[0] >= loaded.rig.fisheye.size_px[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--zones", "zones.tiff3"], "end it in .png or .jpg"),
        (["--zones", "z.png", "--picture", "missing.jpg"], "missing.jpg: No such file"),
        (["--zones", "z.png", "--picture", "zones.yaml"], "not a picture"),
    ],
)
def test_what_cannot_be_drawn_is_told_in_a_line(loaded, tmp_path, monkeypatch, capsys, arguments, says) -> None:
    monkeypatch.chdir(tmp_path)
    assert entry(["check", "--config", str(loaded.path), *arguments]) == 65
    error = capsys.readouterr().err
    assert says in error
    assert "Traceback" not in error


def test_without_zones_there_is_nothing_to_draw(loaded, tmp_path, capsys) -> None:
    (tmp_path / "zones.yaml").write_text("zones: []\n")
    assert entry(["check", "--config", str(loaded.path), "--zones", str(tmp_path / "z.png")]) == 78
    assert "there are none to draw" in capsys.readouterr().err


@pytest.mark.parametrize(
    "command",
    [
        ["calibrate", "capture", "--work", "work"],
        ["calibrate", "fisheye", "--live", "--board", "8x6", "--pitch", "0.04", "--work", "work"],
        ["check", "--timing"],
    ],
)
def test_what_could_not_keep_zones_does_not_begin(loaded, tmp_path, monkeypatch, capsys, command) -> None:
    monkeypatch.chdir(tmp_path)
    assert entry([*command, "--config", str(loaded.path)]) == 78
    error = capsys.readouterr().err
    assert "use a copy of the settings with `zones: []`" in error
    assert "sun" in error or "window" in error
    assert not (tmp_path / "work").exists() or not list((tmp_path / "work").iterdir())
