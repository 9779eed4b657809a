from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from ptzd.cli import entry
from ptzd.control.states import mermaid
from ptzd.errors import DeviceError, PtzdError

CALIBRATION = str(Path(__file__).parents[2] / "config" / "rig.example.yaml")


@pytest.fixture
def pictures(tmp_path: Path) -> Path:
    """A fisheye picture, a view and their list, all grey: there is nothing to be found."""
    grey = np.full((480, 640), 128, np.uint8)
    cv2.imwrite(str(tmp_path / "fisheye.png"), grey)
    cv2.imwrite(str(tmp_path / "view.png"), grey)
    views = [{"image": "view.png", "pan_deg": 0.0, "tilt_deg": 0.0, "zoom": 1.0}]
    (tmp_path / "VIEWS.json").write_text(json.dumps(views))
    return tmp_path


def locate(folder: Path, *more: str, box: str = "300,220,40,40") -> int:
    return entry([
        "locate", "--calibration", CALIBRATION, "--fisheye", str(folder / "fisheye.png"), "--box", box,
        "--views", str(folder / "VIEWS.json"), *more,
    ])  # fmt: skip


def test_nothing_to_be_found_is_a_no_with_a_reason(pictures: Path, capsys) -> None:
    assert locate(pictures, "--json") == 1
    said = json.loads(capsys.readouterr().out)
    assert said["outcome"] == "no_texture"
    assert said["reason"]
    assert said["probability"] < 0.5
    assert locate(pictures) == 1
    assert capsys.readouterr().out.startswith("no_texture: ")


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda folder: (folder / "fisheye.png").unlink(), "fisheye.png: No such file"),
        (lambda folder: (folder / "fisheye.png").write_bytes(b"no picture"), "fisheye.png: not a picture"),
        (lambda folder: (folder / "view.png").write_bytes(b""), "view.png: not a picture"),
        (lambda folder: cv2.imwrite(str(folder / "view.png"), np.zeros((10, 20), np.uint8)), "view.png: 20×10 px"),
        (lambda folder: (folder / "VIEWS.json").unlink(), "VIEWS.json: No such file"),
        (lambda folder: (folder / "VIEWS.json").write_text("[]"), "VIEWS.json: no views"),
        (lambda folder: (folder / "VIEWS.json").write_text("{"), "VIEWS.json"),
        (lambda folder: (folder / "VIEWS.json").write_text('[{"image": "view.png"}]'), "missing required field"),
    ],
)
def test_files_that_cannot_be_used_are_named(pictures: Path, capsys, spoil, told: str) -> None:
    spoil(pictures)
    assert locate(pictures) == 65
    said = capsys.readouterr().err
    assert told in said
    assert len(said.splitlines()) == 1


@pytest.mark.parametrize(
    ("box", "more", "told"),
    [
        ("630,10,20,20", [], "--box"),
        ("300,220,4,40", [], "--box"),
        ("0,0,9,9", [], "image circle"),
        ("300,220,40,40", ["--range", "5,2"], "--range"),
        ("300,220,40,40", ["--range", "0,2"], "--range"),
        ("300,220,40,40", ["--draw", "out.nothing"], "out.nothing: no format"),
        ("300,220,40,40", ["--draw", "no/such/folder/out.png"], "out.png: the picture cannot be written"),
    ],
)
def test_values_that_make_no_sense_are_named(pictures: Path, capsys, box: str, more: list[str], told: str) -> None:
    assert locate(pictures, *more, box=box) == 65
    assert told in capsys.readouterr().err


def test_a_plan_lists_views_that_show_the_arc(capsys) -> None:
    plan = ["plan", "--calibration", CALIBRATION, "--box", "300,220,40,40", "--zoom", "1"]
    assert entry([*plan, "--json", "--range", "0.6,100"]) == 0
    near = json.loads(capsys.readouterr().out)
    assert {"pan_deg", "tilt_deg", "zoom", "hfov_deg"} == near[0].keys()
    assert all(view["hfov_deg"] == pytest.approx(60.0, abs=0.1) for view in near)
    assert entry([*plan[:-1], "5000", "--json", "--range", "0.6,100"]) == 0
    closer = json.loads(capsys.readouterr().out)
    assert len(closer) > len(near)
    assert entry([*plan, "--range", "5,inf"]) == 0
    assert capsys.readouterr().out.startswith("1: pan_deg ")


@pytest.mark.parametrize(("low", "code", "views"), [(-5, 0, True), (40, 1, False)])
def test_a_plan_within_limits_says_what_they_hide(tmp_path, capsys, low: float, code: int, views: bool) -> None:
    settings = tmp_path / "ptzd.yaml"
    source = {"source": "files", "path": "pictures"}
    document = {
        "rig": "gate",
        "calibration": "rig.yaml",
        "fisheye": source,
        "ptz": {"url": "http://127.0.0.1:1", "user": "operator"},
        "limits": {"pan_deg": [low, 170]},
        "home": {"pan_deg": 60},
    }
    settings.write_text(yaml.safe_dump(document))
    plan = ["plan", "--calibration", CALIBRATION, "--box", "300,220,40,40", "--zoom", "5000", "--range", "0.6,100"]
    assert entry([*plan, "--json", "--config", str(settings)]) == code
    out, err = capsys.readouterr()
    assert all(view["pan_deg"] >= low for view in json.loads(out))
    assert bool(json.loads(out)) is views
    assert err.startswith("ptzd: no pose within the limits shows range ")
    assert " of the arc" in err
    assert len(err.splitlines()) == 1


@pytest.mark.parametrize("zoom", ["0", "20000"])
def test_a_zoom_that_is_not_calibrated_is_refused(capsys, zoom: str) -> None:
    assert entry(["plan", "--calibration", CALIBRATION, "--box", "300,220,40,40", "--zoom", zoom]) in {65, 78}
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert zoom in said


def test_schemas_are_listed_and_printed(capsys) -> None:
    assert entry(["schema"]) == 0
    names = capsys.readouterr().out.split()
    assert {"RoiRequest", "RoiResult", "Status"} <= set(names)
    for name in names:
        assert entry(["schema", name]) == 0
        assert json.loads(capsys.readouterr().out)["title"] == f"ptzd.{name}.v1"
    assert entry(["schema", "Nonsense"]) == 65
    assert "RoiRequest" in capsys.readouterr().err


def test_the_state_diagram(capsys) -> None:
    assert entry(["states"]) == 0
    assert capsys.readouterr().out == mermaid() + "\n"


def test_scenes_and_profiles_are_listed(capsys) -> None:
    assert entry(["sim", "--list"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert {"scene room", "scene pair_hall", "profile v5915"} <= set(said)


def test_check_without_cameras_says_what_the_settings_mean(tmp_path: Path, capsys) -> None:
    (tmp_path / "rig.yaml").write_text(Path(CALIBRATION).read_text())
    (tmp_path / "secret").write_text("swordfish\n")
    (tmp_path / "secret").chmod(0o644)
    (tmp_path / "ptzd.yaml").write_text(
        "rig: test\ncalibration: rig.yaml\nfisheye: {source: files, path: pictures}\n"
        "ptz: {url: 'http://127.0.0.1:9', user: operator, password_file: secret}\n"
    )
    assert entry(["check", "--config", str(tmp_path / "ptzd.yaml")]) == 0
    said = capsys.readouterr().out
    assert f"warning: ptz.password_file: every user can read {tmp_path / 'secret'} (mode 644)" in said
    assert "swordfish" not in said
    assert "640×480 px" in said
    assert "baseline     0.512 m" in said


@pytest.mark.parametrize(
    ("error", "code"),
    [(PtzdError("x"), 70), (DeviceError("x"), 69), (KeyboardInterrupt(), 130), (BrokenPipeError(), 0)],
)
def test_every_error_has_its_exit_code(monkeypatch, capsys, error: BaseException, code: int) -> None:
    def fail(arguments: object) -> int:
        raise error

    monkeypatch.setattr("ptzd.cli.offline.states", fail)
    assert entry(["states"]) == code
    said = capsys.readouterr().err
    assert said == ("ptzd: x\n" if isinstance(error, PtzdError) else "")


def test_debug_shows_the_traceback(monkeypatch, capsys) -> None:
    def fail(arguments: object) -> int:
        raise PtzdError("x")

    monkeypatch.setattr("ptzd.cli.offline.states", fail)
    assert entry(["--debug", "states"]) == 70
    assert "Traceback" in capsys.readouterr().err
