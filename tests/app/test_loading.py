from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from ptzd.app.loading import load, load_config
from ptzd.errors import CalibrationError, ConfigError

CALIBRATION = (Path(__file__).parents[2] / "config" / "rig.example.yaml").read_text()
SETTINGS = {
    "rig": "hall",
    "calibration": "calibrations/rig.yaml",
    "fisheye": {"source": "files", "path": "pictures"},
    "ptz": {"url": "http://192.0.2.20", "user": "ptzd", "password_file": "secret"},
    "log": {"directory": "log"},
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "calibrations").mkdir()
    (tmp_path / "calibrations" / "rig.yaml").write_text(CALIBRATION)
    (tmp_path / "secret").write_text("swordfish\n")
    (tmp_path / "ptzd.yaml").write_text(yaml.safe_dump(SETTINGS))
    return tmp_path


def test_relative_paths_are_relative_to_the_settings_file(folder: Path) -> None:
    config = load(folder / "ptzd.yaml").config
    assert config.calibration == str(folder / "calibrations" / "rig.yaml")
    assert config.ptz.password_file == str(folder / "secret")
    assert config.fisheye.path == str(folder / "pictures")
    assert config.log.directory == str(folder / "log")


def test_absolute_paths_stay(folder: Path) -> None:
    document = {**SETTINGS, "log": {"directory": "/var/lib/ptzd/log"}}
    (folder / "ptzd.yaml").write_text(yaml.safe_dump(document))
    assert load(folder / "ptzd.yaml").config.log.directory == "/var/lib/ptzd/log"


def test_what_goes_into_the_log_reads_back_and_holds_no_secret(folder: Path) -> None:
    loaded = load(folder / "ptzd.yaml")
    (folder / "again.yaml").write_text(loaded.config_text)
    assert load_config(folder / "again.yaml") == loaded.config
    assert "swordfish" not in loaded.config_text
    assert loaded.calibration_text == CALIBRATION


def test_a_calibration_without_uncertainty_is_refused(folder: Path) -> None:
    text = CALIBRATION[: CALIBRATION.index("uncertainty:")]
    (folder / "calibrations" / "rig.yaml").write_text(text)
    with pytest.raises(CalibrationError, match="uncertainty: missing"):
        load(folder / "ptzd.yaml")


def test_a_stream_of_another_size_than_calibrated_is_refused(folder: Path) -> None:
    document = {**SETTINGS, "ptz": {**SETTINGS["ptz"], "size_px": [1280, 720]}}
    (folder / "ptzd.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(CalibrationError, match=r"calibrated at 640×480, ptz\.size_px asks for 1280×720"):
        load(folder / "ptzd.yaml")


def test_a_home_outside_the_calibrated_zooms_is_refused(folder: Path) -> None:
    document = {**SETTINGS, "home": {"zoom": 9999.0}}
    (folder / "ptzd.yaml").write_text(yaml.safe_dump(document))
    text = CALIBRATION.replace("    - {zoom: 9999,", "    - {zoom: 9000,")
    (folder / "calibrations" / "rig.yaml").write_text(text)
    with pytest.raises(ConfigError, match=r"home\.zoom: 9999 is outside the calibrated zooms 1 to 9000"):
        load(folder / "ptzd.yaml")


@pytest.mark.parametrize("name", ["none.yaml", "."])
def test_a_file_that_cannot_be_read_is_named(folder: Path, name: str) -> None:
    with pytest.raises(ConfigError, match="--config FILE"):
        load(folder / name)


def test_a_calibration_that_is_a_folder_is_named(folder: Path) -> None:
    (folder / "ptzd.yaml").write_text(yaml.safe_dump({**SETTINGS, "calibration": "calibrations"}))
    with pytest.raises(CalibrationError, match=r"calibration: .*calibrations cannot be read"):
        load(folder / "ptzd.yaml")
