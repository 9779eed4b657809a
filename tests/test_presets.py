"""``presets.yaml``: what is taken, and one sentence for what is not."""

from __future__ import annotations

import msgspec
import pytest

from ptzd.errors import ConfigError
from ptzd.presets import Place, Presets, Stay, Window, nearest_names, parse_presets

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
        ({"places": ["gate"]}, "places: expected a mapping by name, got list"),
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


STAY = {"place": "gate", "dwell_s": 5}


def presets(**parts: object) -> dict[str, object]:
    return {"places": {"gate": GATE, "yard": GATE}, "patrols": {"night": [STAY], "day": [STAY]}, **parts}


def test_patrols_and_their_hours() -> None:
    window = {"patrol": "night", "from": "22:00", "until": "06:00", "days": ["fri"]}
    found = parse_presets(presets(time_zone="Europe/Berlin", schedule=[window]), "presets.yaml")
    assert found.patrols["night"] == (Stay(place="gate", dwell_s=5.0),)
    assert found.schedule == (Window(patrol="night", begin="22:00", until="06:00", days=("fri",)),)
    assert parse_presets(msgspec.to_builtins(found), "log") == found, "a log has it in the same form"


@pytest.mark.parametrize(
    ("patrols", "message"),
    [
        ({"night": []}, "patrols.night: expected a list of stays"),
        ({"night": STAY}, "patrols.night: expected a list of stays"),
        ({"night": [STAY, {**STAY, "dwell_s": 0}]}, "patrols.night[1].dwell_s: Expected `float` > 0.0"),
        ({"night": [{**STAY, "dwell_s": -3}]}, "patrols.night[0].dwell_s: Expected `float` > 0.0"),
        ({"night": [{"place": "gate"}]}, "patrols.night[0]: Object missing required field `dwell_s`"),
        ({"night": [{**STAY, "place": "gte"}]}, "patrols.night[0].place: no place 'gte'; nearest: gate"),
        ({"night": [STAY], "Night": [STAY]}, "patrols: 'Night' and 'night' are too alike"),
        ([STAY], "patrols: expected a mapping by name, got list"),
    ],
)
def test_a_patrol_that_is_none_is_named_by_its_path(patrols: object, message: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_presets(presets(patrols=patrols), "presets.yaml")
    assert str(error.value).startswith(f"presets.yaml: {message}")


def hours(begin: str, until: str, *days: str, patrol: str = "night") -> dict[str, object]:
    return {"patrol": patrol, "from": begin, "until": until, "days": list(days)}


@pytest.mark.parametrize(
    ("schedule", "message"),
    [
        ([hours("22:00", "06:00", patrol="nigt")], "schedule[0].patrol: no patrol 'nigt'; nearest: night"),
        ([hours("25:00", "06:00")], "schedule[0]: '25:00' is no time of day; write HH:MM, 00:00 to 24:00"),
        ([hours("22:00", "6")], "schedule[0]: '6' is no time of day"),
        ([hours("22:00", "22:00")], "schedule[0]: from 22:00 until 22:00 is no window; a whole day is 00:00 to 24:00"),
        ([hours("24:00", "06:00")], "schedule[0]: from 24:00 until 06:00 is no window"),
        ([hours("22:00", "06:00", "fri", "fri")], "schedule[0].days: a day is given twice"),
        ([{**hours("22:00", "06:00"), "days": ["friday"]}], ".schedule[0].days[0]: Invalid enum value 'friday'"),
        (
            [hours("22:00", "06:00"), hours("05:00", "07:00", patrol="day")],
            "schedule[1]: patrol day from 05:00 until 07:00 overlaps with patrol night from 22:00 until 06:00",
        ),
        ([hours("20:00", "02:00", "sun"), hours("01:59", "03:00", "mon")], "schedule[1]: patrol night from 01:59"),
        ([hours("08:00", "12:00", "tue"), hours("08:00", "12:00", "mon", "tue")], "schedule[1]: patrol night from 08"),
    ],
)
def test_a_schedule_that_cannot_be_kept_is_refused(schedule: list[object], message: str) -> None:
    with pytest.raises(ConfigError) as error:
        parse_presets(presets(time_zone="Europe/Berlin", schedule=schedule), "presets.yaml")
    said = str(error.value)
    assert said.startswith(f"presets.yaml{message}" if message[0] == "." else f"presets.yaml: {message}")


def test_windows_may_meet_and_need_a_zone() -> None:
    schedule = [hours("22:00", "06:00"), hours("06:00", "22:00", patrol="day")]
    assert len(parse_presets(presets(time_zone="Europe/Berlin", schedule=schedule), "x").schedule) == 2
    with pytest.raises(ConfigError, match="time_zone: missing"):
        parse_presets(presets(schedule=schedule), "presets.yaml")


def test_the_nearest_names_end_a_refusal() -> None:
    known = ["gate north", "gate south", "yard", "Tower"]
    assert nearest_names("gate nort", known).startswith("nearest: gate north")
    assert nearest_names("TOWER", known) == "nearest: Tower"
    assert nearest_names("q", known) == "there are gate north, gate south, yard and 1 more"
    assert nearest_names("q", []) == "there are none; write them into presets.yaml"
