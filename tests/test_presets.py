"""``presets.yaml``: what is taken, and one sentence for what is not."""

from __future__ import annotations

import pytest

from ptzd.errors import ConfigError
from ptzd.presets import Place, Presets, nearest_names, parse_presets

GATE = {"azimuth_deg": 40, "elevation_deg": -10.5, "hfov_deg": 20}


def test_places_by_name() -> None:
    found = parse_presets({"places": {"gate": GATE, "Tor Süd 2": GATE}, "hold_s": 5}, "presets.yaml")
    place = Place(azimuth_deg=40.0, elevation_deg=-10.5, hfov_deg=20.0)
    assert found == Presets(places={"gate": place, "Tor Süd 2": place}, hold_s=5.0)


@pytest.mark.parametrize("document", [None, {}, {"places": {}}])
def test_nothing_is_no_places(document: object) -> None:
    assert parse_presets(document, "presets.yaml") == Presets()


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ([], "expected places by name, got list"),
        ({"places": ["gate"]}, "places: expected a mapping of names to places, got list"),
        ({"spots": {}}, ": Object contains unknown field `spots`"),
        ({"hold_s": -1}, ".hold_s: Expected `float` >= 0.0"),
        ({"places": {"gate": {**GATE, "hfov_deg": 0}}}, "places.gate.hfov_deg: Expected `float` > 0.0"),
        ({"places": {"gate": {**GATE, "elevation_deg": 91}}}, "places.gate.elevation_deg: Expected `float` <= 90.0"),
        ({"places": {"gate": {**GATE, "azimuth_deg": float("nan")}}}, "places.gate.azimuth_deg: Expected `float`"),
        ({"places": {"gate": {"azimuth_deg": 1, "hfov_deg": 2}}}, "places.gate: Object missing required field"),
        ({"places": {"gate": {**GATE, "tilt": 1}}}, "places.gate: Object contains unknown field `tilt`"),
        ({"places": {"gate": None}}, "places.gate: Expected `object`, got `null`"),
        ({"places": {1: GATE}}, "places: 1 is no text; put the name into quotes"),
        ({"places": {True: GATE}}, "places: True is no text; put the name into quotes"),
        ({"places": {"": GATE}}, "places: '': a name is 1 to 64 printable characters"),
        ({"places": {"$gate": GATE}}, "places: '$gate': a name is"),
        ({"places": {"gate ": GATE}}, "places: 'gate ': a name is"),
        ({"places": {"a\x1b[2J": GATE}}, "places: 'a\\x1b[2J': a name is"),
        ({"places": {"x" * 65: GATE}}, "places: 'xxxx"),
        ({"places": {"Gate": GATE, "gate": GATE}}, "places: 'gate' and 'Gate' are too alike to tell apart; rename one"),
        ({"places": {"Tür": GATE, "Tu\u0308r": GATE}}, "places: 'Tu\u0308r' and 'Tür' are too alike"),
        ({"places": {"gate  1": GATE, "gate 1": GATE}}, "places: 'gate 1' and 'gate  1' are too alike"),
        ({"places": {f"p{number}": GATE for number in range(1001)}}, "places: 1001 of them, at most 1000"),
    ],
)  # fmt: skip
def test_what_is_none_is_named_by_its_path(document: object, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_presets(document, "presets.yaml")
    said = str(error.value)
    assert said.startswith(f"presets.yaml{message}" if message[0] in ".:" else f"presets.yaml: {message}")
    assert "\n" not in said


def test_the_nearest_names_end_a_refusal() -> None:
    known = ["gate north", "gate south", "yard", "Tower"]
    assert nearest_names("gate nort", known).startswith("nearest: gate north")
    assert nearest_names("TOWER", known) == "nearest: Tower"
    assert nearest_names("q", known) == "there are gate north, gate south, yard and 1 more"
    assert nearest_names("q", []) == "there are none; write them into presets.yaml"
