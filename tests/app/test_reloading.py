"""Reading the settings again: what changes, what is refused by name, and what is refused whole."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
import yaml

from ptzd.app.loading import Loaded, load
from ptzd.app.reloading import Reloader, read_again
from ptzd.config import CORE_PARTS, WHILE_RUNNING, Config
from ptzd.errors import CalibrationError, ConfigError

CONFIG = Path(__file__).parents[2] / "config"
README = Path(__file__).parents[2] / "README.md"
SETTINGS = {
    "rig": "hall",
    "calibration": "rig.yaml",
    "fisheye": {"source": "files", "path": "pictures"},
    "ptz": {"url": "http://192.0.2.20", "user": "ptzd"},
}

Change = Callable[..., None]


@pytest.fixture
def running(tmp_path: Path) -> Loaded:
    (tmp_path / "rig.yaml").write_text((CONFIG / "rig.example.yaml").read_text())
    (tmp_path / "ptzd.yaml").write_text(yaml.safe_dump(SETTINGS))
    return load(tmp_path / "ptzd.yaml")


@pytest.fixture
def change(running: Loaded) -> Change:
    def write(**parts: object) -> None:
        changed = {
            name: {**SETTINGS.get(name, {}), **value} if isinstance(value, dict) else value
            for name, value in parts.items()
        }
        running.path.write_text(yaml.safe_dump({**SETTINGS, **changed}))

    return write


def test_the_same_file_again_changes_nothing(running: Loaded) -> None:
    found = read_again(running)
    assert (found.taken, found.refused) == ((), ())
    assert found.loaded == running
    assert str(found) == "settings read again: nothing changed"


def test_places_patrols_and_their_hours_change_while_it_runs(running: Loaded) -> None:
    place = {"azimuth_deg": 10.0, "elevation_deg": 0.0, "hfov_deg": 20.0}
    presets = {
        "places": {"gate": place},
        "patrols": {"night": [{"place": "gate", "dwell_s": 5.0}]},
        "time_zone": "Europe/Berlin",
        "schedule": [{"patrol": "night", "from": "22:00", "until": "06:00"}],
    }
    (running.path.parent / "presets.yaml").write_text(yaml.safe_dump(presets))
    found = read_again(running)
    assert found.taken == ("presets.places", "presets.patrols", "presets.time_zone", "presets.schedule")
    assert found.loaded.config == load(running.path).config
    assert str(read_again(found.loaded)) == "settings read again: nothing changed"
    (running.path.parent / "presets.yaml").write_text("places: {gate: 3}")
    with pytest.raises(ConfigError, match=r"presets.yaml: places.gate: Expected `object`"):
        read_again(found.loaded)


LAMP = {"name": "lamp", "kind": "no_go", "frame": "head", "corners_deg": [[30, 5], [36, 5], [36, 9], [30, 9]]}


def test_zones_need_a_restart_and_stay_where_they_are_when_the_search_looks_elsewhere(
    running: Loaded, change: Change
) -> None:
    change(zones=[LAMP])
    with_lamp = load(running.path)
    assert with_lamp.config.zones[0].range_m == (1.0, 100.0)
    change(zones=[LAMP], search={"range_m": [4.0, 50.0]})
    found = read_again(with_lamp)
    assert (found.taken, found.refused) == (("search.range_m",), ("zones",))
    assert found.loaded.config.zones == with_lamp.config.zones
    change(zones=[LAMP], home={"pan_deg": 33.0, "tilt_deg": 7.0})
    with pytest.raises(ConfigError, match=r"home .* is in the no_go zone lamp"):
        read_again(with_lamp)


def test_what_can_change_does_and_the_rest_is_named(running: Loaded, change: Change) -> None:
    change(
        rig="other",
        search={"accept_probability": 0.5, "range_m": [2.0, float("inf")]},
        queue={"size": 3, "results_kept_s": 5.0},
        log={"keep_days": 1.0, "directory": "elsewhere"},
        ptz={"poll_hz": 5.0},
        fisheye={"fps": 3.0},
    )
    found = read_again(running)
    assert found.taken == (
        "search.range_m", "search.accept_probability", "queue.size", "log.keep_days",
    )  # fmt: skip
    assert found.refused == (
        "rig", "fisheye.fps", "ptz.poll_hz", "queue.results_kept_s", "log.directory",
    )  # fmt: skip
    config = found.loaded.config
    assert config.search.range_m == (2.0, float("inf"))
    assert (config.queue.size, config.queue.results_kept_s) == (3, 600.0)
    assert (config.rig, config.ptz, config.fisheye) == (running.config.rig, running.config.ptz, running.config.fisheye)
    assert load_text(found.loaded.config_text) == config
    assert "needs a restart and stays as it was" in str(found)
    assert "\n" not in str(found)


def load_text(text: str) -> Config:
    return msgspec.convert(yaml.safe_load(text), Config)


def test_another_kind_of_fisheye_needs_a_restart(running: Loaded) -> None:
    other = {**SETTINGS, "fisheye": {"source": "http", "url": "http://192.0.2.10"}}
    running.path.write_text(yaml.safe_dump(other))
    found = read_again(running)
    assert not found.taken
    assert {"fisheye.source", "fisheye.url", "fisheye.path"} <= set(found.refused)
    assert found.loaded == running


def test_another_calibration_needs_a_restart(running: Loaded) -> None:
    path = Path(running.config.calibration)
    path.write_text(running.calibration_text + "# remounted\n")
    found = read_again(running)
    assert found.refused == ("calibration",)
    assert found.loaded == running


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("ptz: {fps: -1}", "ptzd.yaml"),
        (": no yaml :\n -", "not YAML"),
        (yaml.safe_dump({**SETTINGS, "search": {"accept_probability": 2.0}}), "search.accept_probability"),
        (yaml.safe_dump({**SETTINGS, "search": {"acceptance": 0.2}}), "acceptance"),
    ],
)
def test_a_wrong_file_is_refused_whole(running: Loaded, text: str, words: str) -> None:
    running.path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        read_again(running)


def test_a_change_that_does_not_fit_what_stays_is_refused_whole(running: Loaded, change: Change) -> None:
    change(limits={"pan_deg": [-180.0, 10.0]}, home={"pan_deg": 5.0})
    assert read_again(running).refused == ("limits.pan_deg",)
    change(ptz={"size_px": [1280, 720]})
    with pytest.raises(CalibrationError, match=r"ptz\.size_px"):
        read_again(running)
    narrow = {**SETTINGS, "limits": {"pan_deg": [-10.0, 10.0]}}
    running.path.write_text(yaml.safe_dump(narrow))
    limited = load(running.path)
    running.path.write_text(yaml.safe_dump({**SETTINGS, "home": {"pan_deg": 20.0}}))
    with pytest.raises(ConfigError, match=r"home\.pan_deg: 20\.0 is outside limits\.pan_deg"):
        read_again(limited)


def test_every_key_that_may_change_exists_and_readme_names_it() -> None:
    parts = {field.name: field.type for field in msgspec.structs.fields(Config)}
    for name in WHILE_RUNNING:
        part, _, key = name.partition(".")
        assert part in parts
        assert not key or key in {field.name for field in msgspec.structs.fields(parts[part])}
    assert set(CORE_PARTS) <= parts.keys()
    readme = README.read_text()
    assert [name for name in WHILE_RUNNING if f"`{name}`" not in readme] == []


class Manager:
    """What a service manager was told."""

    def __init__(self) -> None:
        self.told: asyncio.Queue[str] = asyncio.Queue()

    def reloading(self) -> None:
        self.told.put_nowait("reloading")

    def reloaded(self, status: str) -> None:
        self.told.put_nowait(status)


async def test_one_time_after_the_other_and_always_from_what_is_in_force(running: Loaded, change: Change) -> None:
    manager, asked, adopted = Manager(), asyncio.Event(), []
    working = asyncio.create_task(Reloader(running, asked, adopted.append, manager).run())

    async def outcome() -> str:
        asked.set()
        assert await manager.told.get() == "reloading"
        return await manager.told.get()

    async with asyncio.timeout(60):
        change(lock={"fill": 0.3}, ptz={"fps": 5.0})
        assert "changed lock.fill; needs a restart and stays as it was: ptz.fps" in await outcome()
        running.path.write_text("{")
        assert (await outcome()).startswith("settings not taken, the old ones stay: ")
        change(lock={"fill": 0.3})
        assert await outcome() == "settings read again: nothing changed"
    assert [loaded.config.lock.fill for loaded in adopted] == [0.3]
    working.cancel()
    await asyncio.gather(working, return_exceptions=True)
