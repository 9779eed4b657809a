from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from ptzd.app.loading import load, load_config, read_presets
from ptzd.config import parse_config
from ptzd.errors import CalibrationError, ConfigError
from ptzd.presets import Presets

EXAMPLES = Path(__file__).parents[2] / "config"
CALIBRATION = (EXAMPLES / "rig.example.yaml").read_text()
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


SUN = {"name": "sun", "kind": "no_go", "frame": "head", "corners_deg": [[40, 30], [60, 30], [60, 50], [40, 50]]}


def with_zones(folder: Path, zones: object) -> Path:
    (folder / "ptzd.yaml").write_text(yaml.safe_dump({**SETTINGS, "zones": zones}))
    return folder / "ptzd.yaml"


def test_zones_stand_in_the_settings_or_in_a_file_that_becomes_part_of_them(folder: Path) -> None:
    inside = load(with_zones(folder, [SUN]))
    (folder / "zones.yaml").write_text(yaml.safe_dump({"zones": [SUN]}))
    beside = load(with_zones(folder, "zones.yaml"))
    assert beside.config.zones == inside.config.zones
    assert yaml.safe_load(beside.config_text)["zones"][0]["name"] == "sun", "the log has the zones themselves"


def test_the_example_of_zones_is_taken(folder: Path) -> None:
    example = Path(__file__).parents[2] / "config" / "zones.example.yaml"
    (folder / "zones.yaml").write_text(example.read_text())
    zones = load(with_zones(folder, "zones.yaml")).config.zones
    assert {zone.kind for zone in zones} == {"no_go", "privacy", "ignore"}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"kind": "nogo"}, r"zones\[1\].kind: Invalid enum value 'nogo'"),
        ({"frame": "camera"}, r"zones\[1\].frame: Invalid value 'camera'"),
        ({"corners_deg": [[40, 30], [60, 30]]}, r"zones\[1\].corners_deg: .* length >= 3"),
        ({"corners_deg": [[40, 30], [60, 50], [60, 30], [40, 50]]}, r"zones\[1\] \(two\): the edge .* crosses"),
        ({"corners_deg": [[-90, 0], [0, 80], [90, 0], [0, -80]]}, r"zones\[1\] \(two\): .* split it into smaller ones"),
        ({"corners_deg": [[0, -5], [5, 100], [5, 0]]}, r"zones\[1\] \(two\): tilt beyond ±90°"),
        ({"corners_deg": [[40, 30], [60, 30], [40, float("nan")]]}, r"zones\[1\].corners_deg\[2\]\[1\]: nan"),
        ({"name": "sun"}, r"zones\[1\].name: sun is the name of zones\[0\] already"),
        ({"name": "two words"}, r"zones\[1\].name"),
        ({"range_m": [5, 2]}, r"zones\[1\].range_m: the first value must be below the second"),
        ({"range_m": [0, 2]}, r"zones\[1\].range_m: the nearest range must be above 0"),
        ({"corners_px": [[1, 2]]}, r"zones\[1\]: Object contains unknown field `corners_px`"),
        ({"corners_deg": [[-9, -9], [9, -9], [9, 9], [-9, 9]]}, r"zones: home .* is in the no_go zone two; move home"),
        (
            {"corners_deg": [[-9, -9], [9, -9], [9, 9], [-9, 9]], "kind": "privacy"},
            r"zones: home .* is in the privacy zone two; move home",
        ),
    ],
)
@pytest.mark.parametrize("file", [False, True])
def test_a_zone_that_is_none_is_named_in_one_line(folder: Path, change: dict, says: str, file: bool) -> None:
    zones = [SUN, {**SUN, "name": "two", **change}]
    (folder / "zones.yaml").write_text(yaml.safe_dump({"zones": zones}))
    with pytest.raises(ConfigError, match=says) as error:
        load(with_zones(folder, "zones.yaml" if file else zones))
    assert "\n" not in str(error.value)


def test_a_file_of_zones_that_is_not_there_or_holds_none_is_named(folder: Path) -> None:
    with pytest.raises(ConfigError, match=r"zones: .*missing.yaml cannot be read"):
        load(with_zones(folder, "missing.yaml"))
    (folder / "zones.yaml").write_text("zones: [\n")
    with pytest.raises(ConfigError, match=r"zones.yaml: line 2"):
        load(with_zones(folder, "zones.yaml"))
    (folder / "zones.yaml").write_text("[]\n")
    with pytest.raises(ConfigError, match=r"zones.yaml: \(top level\): Expected `object`"):
        load(with_zones(folder, "zones.yaml"))


PLACES = {"places": {"gate": {"azimuth_deg": 10, "elevation_deg": 0, "hfov_deg": 20}}}


def test_places_come_from_a_file_beside_or_from_the_settings_themselves(folder: Path) -> None:
    path = folder / "ptzd.yaml"
    assert load(path).config.presets.places == {}
    (folder / "presets.yaml").write_text(yaml.safe_dump(PLACES))
    beside = load(path)
    assert beside.config.presets.places["gate"].azimuth_deg == 10.0
    path.write_text(yaml.safe_dump({**SETTINGS, "presets": PLACES}))
    with pytest.raises(ConfigError, match=r"presets: there is .*presets.yaml too; put all of them into one of the two"):
        load(path)
    (folder / "presets.yaml").unlink()
    inside = load(path)
    assert inside.config.presets == beside.config.presets
    assert parse_config(yaml.safe_load(inside.config_text), "log").presets == inside.config.presets


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("places: {gate: {}, gate: {}}", "line 1, column 20: key 'gate' is given twice"),
        ("places: [", "not YAML"),
        ("places: {gate: {azimuth_deg: 1}}", "places.gate: Object missing required field"),
    ],
)
def test_a_file_of_places_that_is_none_is_named(folder: Path, text: str, said: str) -> None:
    (folder / "presets.yaml").write_text(text)
    with pytest.raises(ConfigError) as error:
        load(folder / "ptzd.yaml")
    assert str(error.value).startswith(f"{folder / 'presets.yaml'}: ")
    assert said in str(error.value)


@pytest.mark.parametrize("zone", ["Europe/Atlantis", "../etc/passwd", ""])
def test_a_time_zone_that_is_none_is_refused(folder: Path, zone: str) -> None:
    (folder / "presets.yaml").write_text(yaml.safe_dump({**PLACES, "time_zone": zone}))
    with pytest.raises(ConfigError, match=r"is not known on this machine; write e.g. Europe/Berlin"):
        load(folder / "ptzd.yaml")


def test_the_example_of_places_is_taken() -> None:
    presets = read_presets(EXAMPLES / "presets.example.yaml")
    assert presets is not None
    assert presets.places.keys() == {"gate", "loading bay"}
    assert presets.hold_s == Presets().hold_s
