from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
import yaml

from ptzd import config as settings
from ptzd.config import Config, FilesSource, HttpSource, V4l2Source, parse_config
from ptzd.errors import ConfigError

FILE = Path(__file__).parents[1] / "config" / "ptzd.yaml"
LEAST = {
    "rig": "hall",
    "calibration": "rig.yaml",
    "fisheye": {"source": "files", "path": "pictures"},
    "ptz": {"url": "http://192.0.2.20", "user": "ptzd"},
}


def with_change(path: str, value: object) -> dict[str, object]:
    document = yaml.safe_load(yaml.safe_dump(LEAST))
    part = document
    *parents, last = path.split(".")
    for name in parents:
        part = part.setdefault(name, {})
    part[last] = value
    return document


def sources() -> dict[str, dict[str, object]]:
    """The fisheye part of the settings file as it stands, and each one that stands there commented out."""
    lines = FILE.read_text().splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("fisheye:"))
    end = next(number for number, line in enumerate(lines) if line.startswith("ptz:"))
    blocks: list[list[str]] = []
    for line in (line.removeprefix("# ") for line in lines[start:end]):
        if line.startswith("fisheye:"):
            blocks.append([])
        blocks[-1].append(line)
    parts = [yaml.safe_load("\n".join(block))["fisheye"] for block in blocks]
    return {part["source"]: part for part in parts}


def test_the_settings_file_is_taken() -> None:
    config = parse_config(yaml.safe_load(FILE.read_text()), str(FILE))
    assert isinstance(config.fisheye, V4l2Source)
    assert config.rig == "hall"


@pytest.mark.parametrize("kind", [V4l2Source, HttpSource, FilesSource])
def test_the_settings_file_shows_every_source_with_every_key(kind: type[msgspec.Struct]) -> None:
    part = sources()[kind.__struct_config__.tag]
    assert part.keys() == {"source", *kind.__struct_fields__}
    msgspec.convert(part, settings.FisheyeSource)


def test_the_settings_file_lists_every_key() -> None:
    document = yaml.safe_load(FILE.read_text())
    assert document.keys() == set(Config.__struct_fields__)
    for field in msgspec.structs.fields(Config):
        if isinstance(field.type, type) and issubclass(field.type, settings.Part):
            assert document[field.name].keys() == set(field.type.__struct_fields__), field.name


def test_the_settings_file_states_the_defaults() -> None:
    stated = parse_config(yaml.safe_load(FILE.read_text()), str(FILE))
    plain = parse_config(LEAST, "least")
    for field in msgspec.structs.fields(Config):
        if field.name in {"rig", "calibration", "fisheye", "ptz"}:
            continue
        if field.name == "log":
            one, other = (msgspec.structs.asdict(config.log) for config in (stated, plain))
            assert one | {"directory": ""} == other | {"directory": ""}
        else:
            assert getattr(stated, field.name) == getattr(plain, field.name), field.name
    for field in msgspec.structs.fields(settings.Ptz):
        if not field.required:
            assert getattr(stated.ptz, field.name) == field.default, field.name


@pytest.mark.parametrize(
    ("path", "value", "culprit"),
    [
        ("colour", 1, "(top level): Object contains unknown field `colour`"),
        ("ptz.speed", 1, "ptz: Object contains unknown field `speed`"),
        ("ptz.fps", 0, "ptz.fps: Expected `float` > 0"),
        ("ptz.poll_hz", 100, "ptz.poll_hz"),
        ("ptz.camera", 0, "ptz.camera"),
        ("ptz.camera", "1", "ptz.camera"),
        ("ptz.size_px", [640], "ptz.size_px"),
        ("rig", "a/b", "rig"),
        ("rig", "hall\n", "rig"),
        ("bus.prefix", "/ptzd", "bus.prefix"),
        ("bus.mode", "broker", "bus.mode"),
        ("fisheye.loop", "yes", "fisheye.loop"),
        ("search.max_rounds", 4, "search.max_rounds"),
        ("search.range_m", [0.0, 5.0], "search.range_m: the nearest range must be above 0"),
        ("search.range_m", [5.0, 5.0], "search.range_m: the first value must be below the second"),
        ("search.range_m", [float("nan"), 5.0], "search.range_m[0]: nan"),
        ("limits.tilt_deg", [10.0, -10.0], "limits.tilt_deg"),
        ("home.tilt_deg", 91.0, "home.tilt_deg: 91.0 is outside limits.tilt_deg (-90.0 to 90.0)"),
        ("home.zoom", 0.0, "home.zoom"),
        ("search.accept_probability", 0.99, "search.certain_probability"),
        ("lock.fill", 1.0, "lock.fill"),
        ("log.rotate_bytes", 10, "log.rotate_bytes"),
        ("queue.size", -1, "queue.size"),
    ],
)
def test_what_is_not_acceptable_is_named_by_its_path(path: str, value: object, culprit: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_config(with_change(path, value), "ptzd.yaml")
    assert str(error.value).startswith(f"ptzd.yaml: {culprit}")
    assert "\n" not in str(error.value)
    assert error.value.exit_code == 78


@pytest.mark.parametrize("document", [None, [], "text", 3])
def test_a_document_that_is_no_mapping(document: object) -> None:
    with pytest.raises(ConfigError, match="must hold a mapping"):
        parse_config(document, "ptzd.yaml")


def test_the_far_end_may_be_infinite() -> None:
    assert parse_config(with_change("search.range_m", [1.0, float("inf")]), "x").search.range_m[1] == float("inf")


def test_settings_do_not_change() -> None:
    config = parse_config(LEAST, "x")
    with pytest.raises(AttributeError):
        config.rig = "other"  # type: ignore[misc]
