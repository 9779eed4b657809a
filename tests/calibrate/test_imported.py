"""`ptzd calibrate fisheye --from`: what it says of the rays, what it refuses, and the part it writes."""

from __future__ import annotations

import json
import math

import pytest

from ptzd.calibrate.parts import fisheye_of
from ptzd.cli import entry
from ptzd.errors import CalibrationError

FLAT = {
    "width": 640,
    "height": 480,
    "distortion_model": "equidistant",
    "d": [0, 0, 0, 0],
    "k": [310.5, 0, 322.25, 0, 309.25, 238.5, 0, 0, 1],
}
MEI = {
    "model_type": "MEI",
    "camera_name": "sky",
    "image_width": 640,
    "image_height": 480,
    "mirror_parameters": {"xi": 1.3},
    "distortion_parameters": {"k1": -0.12, "k2": 0.03, "p1": 0.0007, "p2": -0.0009},
    "projection_parameters": {"gamma1": 420.0, "gamma2": 421.0, "u0": 318.0, "v0": 242.0},
}


def dumped(tmp_path, values):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(values))
    return path


def imported(path, tmp_path, capsys, *words):
    code = entry(["calibrate", "fisheye", "--from", str(path), "--work", str(tmp_path), *words])
    return code, capsys.readouterr()


def test_import_tells_how_far_the_rays_reach_and_what_ends_them(tmp_path, capsys):
    path = dumped(tmp_path, {**FLAT, "k": [190, 0, 320, 0, 190, 240, 0, 0, 1]})
    code, told = imported(path, tmp_path, capsys)
    assert code == 0
    share = math.pi * (190 * math.pi / 2) ** 2 / (640 * 480)  # the circle, less what its top and bottom lose
    assert "rays reach 90.0° off the axis" in told.out
    assert "--max-angle 90 ends them" in told.out
    document = json.loads(imported(path, tmp_path, capsys, "--json")[1].out)
    assert 0.7 < document["rays_share"] < share
    page = (tmp_path / "fisheye.html").read_text()
    assert "rays reach 90.0°" in page
    assert "<svg" in page
    wider = told.out.split("up to ")[1].split()[0]
    assert "cover the whole picture" in imported(path, tmp_path, capsys, "--max-angle", wider)[1].out


def test_part_that_was_edited_is_judged_as_rig_yaml_is(tmp_path, capsys):
    assert imported(dumped(tmp_path, MEI), tmp_path, capsys)[0] == 0
    part = tmp_path / "fisheye.part.yaml"
    assert fisheye_of(tmp_path).size_px == (640, 480)
    part.write_text(part.read_text().replace("fy: 421.0", "fy: 42.1"))
    with pytest.raises(CalibrationError, match=r"fisheye\.fy: 42\.1 px does not go with fx"):
        fisheye_of(tmp_path)


def test_import_tells_where_coefficients_fold(tmp_path, capsys):
    path = dumped(tmp_path, {**FLAT, "d": [-0.5, 0.0, 0.0, 0.0]})
    out = imported(path, tmp_path, capsys)[1].out
    reach = math.degrees(math.sqrt(1.0 / 1.5))
    assert f"rays reach {0.999 * reach:.1f}°" in out
    assert "where the model's own coefficients end it" in out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--max-angle", "0"), "--max-angle 0"),
        (("--max-angle", "nan"), "--max-angle nan"),
        (("--size", "640"), "--size 640"),
        (("--live",), "not both"),
        (("--max-angle", "8"), "of another resolution"),
    ],
)
def test_import_refuses_what_is_asked_in_vain(tmp_path, capsys, words, said):
    code, told = imported(dumped(tmp_path, MEI), tmp_path, capsys, *words)
    assert code != 0
    assert said in told.err
    assert not (tmp_path / "fisheye.part.yaml").exists()
