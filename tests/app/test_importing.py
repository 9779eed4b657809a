"""The camera's own presets become places: read over HTTP from the simulated camera, held against its own truth."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
import yaml

from ptzd.app.importing import as_places, import_presets
from ptzd.app.loading import load
from ptzd.app.simulate import DEFAULT_PASSWORD, write_config
from ptzd.cli import entry
from ptzd.devices.vapix.answers import CameraSaysNo, Reply, preset_names
from ptzd.devices.vapix.presets import StoredPreset
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.model import HeadReading
from ptzd.sim.rig import SimRig
from ptzd.sim.settings import SimSettings


@pytest.fixture
async def rig(tmp_path):
    """A simulated rig whose camera keeps three presets, and settings for it."""
    async with SimRig(SimSettings(scene="pair_hall")) as made:
        unit = made.camera.unit
        unit.presets[5] = type(unit.presets[1])(name="Tor Süd", pan=-30.5, tilt=-8.25, zoom=700)
        unit.presets[7] = type(unit.presets[1])(name="*star", pan=10.0, tilt=0.0, zoom=1)
        unit._write_presets()
        made.settings_path = write_config(made, tmp_path, bus="tcp/127.0.0.1:7447", password=DEFAULT_PASSWORD)
        yield made


async def test_they_look_where_the_camera_does_and_the_camera_is_not_moved(rig) -> None:
    loaded = load(rig.settings_path)
    orders = len(rig.camera.unit.orders)
    imported = await import_presets(loaded)
    assert imported.places.keys() == {"Home", "Tor Süd"}
    assert imported.left_out == (
        "preset 7 '*star' is left out: its name: '*star': a name is 1 to 64 printable characters, begins with a letter "
        "or a digit and does not end in a space",
    )
    assert len(rig.camera.unit.orders) == orders
    place = imported.places["Tor Süd"]
    seen = loaded.rig.head_from_camera(HeadReading(pan_deg=-30.5, tilt_deg=-8.25, zoom=700.0)) @ np.array(
        [0.0, 0.0, 1.0]
    )
    wanted = loaded.rig.head_from_fisheye_rotation @ bearing(*np.radians([place.azimuth_deg, place.elevation_deg]))
    assert np.degrees(angle_between(seen, wanted)) < 0.01


async def test_what_is_written_is_taken_as_presets_yaml(rig, tmp_path, capsys) -> None:
    out = tmp_path / "presets.yaml"
    assert await asyncio.to_thread(entry, ["presets", "--config", str(rig.settings_path), "--out", str(out)]) == 1
    said = capsys.readouterr()
    assert said.out == f"{out}: 2 places\n"
    assert said.err.startswith("preset 7 '*star' is left out: ")
    assert load(rig.settings_path).config.presets.places.keys() == {"Home", "Tor Süd"}
    assert await asyncio.to_thread(entry, ["presets", "--config", str(rig.settings_path), "--out", str(out)]) == 1
    assert "exists and stays as it is" in capsys.readouterr().err
    assert await asyncio.to_thread(entry, ["presets", "--config", str(rig.settings_path)]) == 1
    assert yaml.safe_load(capsys.readouterr().out)["places"].keys() == {"Home", "Tor Süd"}


def stored(number: int, name: str, **pose: float) -> StoredPreset:
    where = {"pan_deg": 0.0, "tilt_deg": 0.0, "zoom": 1.0, **pose}
    return StoredPreset(number=number, name=name, reading=HeadReading(**where))


async def test_what_cannot_be_a_place_is_told_and_the_rest_is_taken(rig) -> None:
    presets = [
        stored(1, "gate"),
        stored(2, "Gate"),
        stored(3, "gate"),
        StoredPreset(number=4, name="lost", reading=None),
        stored(5, "near", zoom=15_000.0),
        stored(6, "yard", pan_deg=20.0),
    ]
    found = as_places(load(rig.settings_path).rig, presets)
    assert found.places.keys() == {"gate", "yard"}
    assert [sentence.partition(" is left out: ")[0] for sentence in found.left_out] == [
        "preset 2 'Gate'", "preset 3 'gate'", "preset 4 'lost'", "preset 5 'near'",
    ]  # fmt: skip
    assert "too alike" in found.left_out[0]
    assert "zoom 15000 is outside what is calibrated" in found.left_out[3]


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("Preset Positions for camera 1\r\npresetposno1=Home\r\npresetposno12=a=b\r\n", {1: "Home", 12: "a=b"}),
        ("Preset Positions for camera 1\n", {}),
        ("", {}),
    ],
)
def test_names_by_number(text: str, names: dict[int, str]) -> None:
    assert preset_names(Reply(status=200, content_type="text/plain", text=text)) == names


def test_a_camera_without_them_says_so() -> None:
    with pytest.raises(CameraSaysNo, match="not supported"):
        preset_names(Reply(status=200, content_type="text/plain", text="Error:\nquery: not supported\n"))
