"""`ptzd calibrate` on files: what it writes, and what it says about pictures that are no calibration."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from ptzd.calibrate.studio import Board, Studio, samples, tilted
from ptzd.calibration.detect import charuco_board
from ptzd.calibration.file import load_provenance, load_rig
from ptzd.calibration.lens import UNIFIED, WIDE_RAD
from ptzd.calibration.target import Target, TargetKind
from ptzd.cli import entry

TARGET = Target(columns=8, rows=6, pitch_m=0.03)
LENS = np.array([180.0, 180.0, 159.5, 119.5, 1.0, 0.0, 0.0, 0.0, 0.0])


def write(path: Path, grey: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), grey)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory) -> Path:
    """Twelve small fisheye pictures of a board."""
    folder, rng = tmp_path_factory.mktemp("boards"), np.random.default_rng(5)
    rays, _ = samples(UNIFIED.camera(LENS, (320, 240), WIDE_RAD), side=2)
    for index in range(12):
        angle, turn = 0.9 * np.sqrt(index / 11), 2.4 * index
        direction = np.array([np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)])
        board: Board = tilted(rng, TARGET, direction, 0.3)
        write(folder / f"{index}.png", board.over(np.full((240, 320), 120, np.uint8), rays))
    return folder


def said(capsys, *words: str) -> tuple[int, str]:
    code = entry(["calibrate", *words])
    return code, capsys.readouterr().err


def test_fisheye_writes_part_and_self_contained_report(pictures, tmp_path, capsys):
    words = ["fisheye", str(pictures), "--board", "8x6", "--pitch", "0.03", "--work", str(tmp_path), "--json"]
    assert entry(["calibrate", *words]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["rms_px"] < 0.3
    assert told["views"] >= 9
    page = (tmp_path / "fisheye.html").read_text()
    assert "data:image/jpeg;base64" in page
    assert "<svg" in page
    assert "rays reach" in page
    assert 0.0 < told["rays_share"] <= 1.0
    assert "http" not in page.replace("http://www.w3.org", "")
    assert (tmp_path / "fisheye.part.yaml").is_file()


def nothing_written(folder: Path) -> bool:
    return not list(folder.glob("*.yaml")) and not list(folder.glob("*.html"))


def test_wrong_board_size_is_told_what_is_seen(pictures, tmp_path, capsys):
    code, text = said(capsys, "fisheye", str(pictures), "--board", "9x6", "--work", str(tmp_path))
    assert code == 78
    assert "8×6" in text or "6×8" in text or "check the kind" in text
    assert nothing_written(tmp_path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda grey, index: np.full_like(grey, 128), "chessboard of 8×6 points in 0 of 12 only"),
        (lambda grey, index: cv2.resize(grey, (400, 300)) if index == 3 else grey, "not 320×240 px"),
    ],
    ids=["empty", "mixed"],
)
def test_useless_pictures_give_one_sentence_and_no_file(pictures, tmp_path, capsys, spoil, words):
    for index, path in enumerate(sorted(pictures.glob("*.png"))):
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        write(tmp_path / "in" / path.name, spoil(grey, index))
    code, text = said(capsys, "fisheye", str(tmp_path / "in"), "--board", "8x6", "--work", str(tmp_path))
    assert code == 78
    assert words in text
    assert nothing_written(tmp_path)


def test_one_picture_says_how_many_to_take(pictures, tmp_path, capsys):
    write(tmp_path / "in" / "one.png", cv2.imread(str(pictures / "0.png"), cv2.IMREAD_GRAYSCALE))
    code, text = said(capsys, "fisheye", str(tmp_path / "in"), "--board", "8x6", "--work", str(tmp_path))
    assert code == 78
    assert "take at least 10" in text
    assert nothing_written(tmp_path)


def test_no_folder_no_board_no_parts(tmp_path, capsys):
    assert "no such folder" in said(capsys, "fisheye", str(tmp_path / "none"), "--board", "8x6")[1]
    assert "--board" in said(capsys, "fisheye", str(tmp_path))[1]
    shots = tmp_path / "shots.json"
    shots.write_text('[{"image": "a.jpg", "pan_deg": 0, "tilt_deg": 0, "zoom": 1, "fisheye": "f.jpg"}]')
    code, text = said(capsys, "rig", str(shots), "--work", str(tmp_path), "--out", str(tmp_path / "rig.yaml"))
    assert code == 78
    assert "ptzd calibrate zoom" in text
    assert not (tmp_path / "rig.yaml").exists()


def test_boards_before_a_simulated_rig_give_its_rig_yaml(tmp_path):
    """The whole sequence with a lens, a zoom curve and a mounting that no default states."""
    studio = Studio("room", "dome", tmp_path, TARGET, 3)
    boards, zooms, pairs = studio.boards(16), studio.zooms((1,), 6), studio.pairs(5)
    work = ["--board", "8x6", "--work", str(tmp_path)]
    assert entry(["calibrate", "fisheye", str(boards), *work, "--pitch", "0.045"]) == 0
    assert entry(["calibrate", "zoom", str(zooms), *work, "--pitch", "0.03"]) == 0
    assert entry(["calibrate", "head", str(pairs), *work, "--pitch", "0.09"]) == 0
    out = ["--out", str(tmp_path / "rig.yaml")]
    assert entry(["calibrate", "rig", str(pairs), *work, "--pitch", "0.09", *out]) == 0
    rig = load_rig(tmp_path / "rig.yaml")
    errors = studio.pointing_errors_deg(rig)
    assert np.percentile(errors, 95) <= 0.2
    assert rig.metric
    made = load_provenance(tmp_path / "rig.yaml")
    parts = made["parts"]
    estimated = (made, parts["fisheye"], parts["ptz"]["zooms"][0], parts["head"])
    for covariance in (part["covariance"] for part in estimated):
        rows = np.array(covariance["rows"])
        assert rows.shape == (len(covariance["of"]),) * 2
        assert np.allclose(rows, rows.T)
        assert np.linalg.eigvalsh(rows).min() > -1e-9 * np.abs(rows).max()


def test_pictures_all_alike_are_refused(pictures, tmp_path, capsys):
    grey = cv2.imread(str(pictures / "0.png"), cv2.IMREAD_GRAYSCALE)
    for index in range(10):
        write(tmp_path / "in" / f"{index}.png", cv2.add(grey, index))
    code, text = said(capsys, "fisheye", str(tmp_path / "in"), "--board", "8x6", "--work", str(tmp_path))
    assert code == 78
    assert "all alike" in text
    assert "move the board through the whole picture" in text
    assert nothing_written(tmp_path)


def test_parallel_boards_are_refused(tmp_path, capsys):
    """Coplanar poses: the board moved on a table, never tilted."""
    rays, _ = samples(UNIFIED.camera(LENS, (320, 240), WIDE_RAD), side=2)
    for index, (x, y) in enumerate((x, y) for x in (-0.35, -0.22, -0.1) for y in (-0.2, -0.08, 0.04)):
        board = Board(target=TARGET, rotation=np.eye(3), origin_m=np.array([x, y, 0.24]))
        write(tmp_path / "in" / f"{index}.png", board.over(np.full((240, 320), 120, np.uint8), rays))
    code, text = said(capsys, "fisheye", str(tmp_path / "in"), "--board", "8x6", "--work", str(tmp_path))
    assert code == 78
    assert "tilt the board by 20 to 40 degrees" in text
    assert nothing_written(tmp_path)


def test_mirrored_charuco_pictures_are_refused(tmp_path, capsys):
    target = Target(kind=TargetKind.CHARUCO, columns=7, rows=5, pitch_m=0.04)
    sheet = charuco_board(target).generateImage((640, 480), None, 20, 1)
    for index in range(4):
        write(tmp_path / "in" / f"{index}.png", np.ascontiguousarray(np.roll(sheet, 4 * index, axis=0)[:, ::-1]))
    words = ("--board", "7x5", "--kind", "charuco", "--pitch", "0.04", "--work", str(tmp_path))
    code, text = said(capsys, "fisheye", str(tmp_path / "in"), *words)
    assert code == 78
    assert "mirrored; switch mirroring off" in text
    assert nothing_written(tmp_path)


def test_live_needs_settings_and_drift_its_logs(tmp_path, capsys):
    assert "--config" in said(capsys, "fisheye", "--live", "--board", "8x6", "--work", str(tmp_path))[1]
    assert "--calibration" in said(capsys, "drift", "--work", str(tmp_path))[1]
    assert "--config" in said(capsys, "drift", "--undo")[1]
