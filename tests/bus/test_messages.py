from __future__ import annotations

import dataclasses
import json

import jsonschema
import msgspec
import pytest

from ptzd.bus.fields import BoxPx, Incoming
from ptzd.bus.messages import MESSAGES, Accepted, FrameName, RoiRequest, RoiResult, encoding, message_types, schema
from ptzd.errors import RequestRefused
from ptzd.model import Outcome, Result
from ptzd.outgoing import Outgoing


@pytest.mark.parametrize("name", message_types())
def test_schema_is_valid_and_names_its_version(name: str):
    document = schema(name)
    jsonschema.Draft202012Validator.check_schema(document)
    assert document["title"] == f"ptzd.{name}.v1"
    assert isinstance(json.dumps(document), str)
    assert encoding(name) == f"application/json;ptzd.{name}.v1"


def test_schema_judges_as_the_decoder_does():
    check = jsonschema.Draft202012Validator(schema("RoiRequest"))
    good = {"id": "a", "box": {"x": 0, "y": 0, "w": 8, "h": 8}, "frame": {"seq": 3}}
    assert check.is_valid(good)
    assert not check.is_valid({**good, "colour": 1})
    assert not check.is_valid({**good, "box": {"x": 0, "y": 0, "w": 7, "h": 8}})
    assert not check.is_valid({**good, "frame": {}})
    assert not check.is_valid({**good, "id": "a b"})
    request = RoiRequest(id="a", box=BoxPx(x=0, y=0, w=8, h=8), frame=FrameName(seq=3))
    assert check.is_valid(json.loads(msgspec.json.encode(request)))


def test_unknown_type_lists_what_there_is():
    with pytest.raises(RequestRefused, match="RoiRequest"):
        schema("Goal")


@pytest.mark.parametrize("message", MESSAGES.values())
def test_strict_towards_the_daemon_and_open_towards_the_apps(message: type[msgspec.Struct]):
    assert issubclass(message, Incoming | Outgoing)
    assert message.__struct_config__.frozen
    assert message.__struct_config__.forbid_unknown_fields == issubclass(message, Incoming)


def test_absent_means_unknown():
    result = RoiResult(id="a", outcome=Outcome.NOT_FOUND, reason="no", elapsed_ms=1, views=2)
    document = json.loads(msgspec.json.encode(result))
    assert document == {"id": "a", "outcome": "not_found", "reason": "no", "elapsed_ms": 1, "views": 2}
    later = msgspec.json.decode(b'{"id":"a","position":1,"new_field":3}', type=Accepted)
    assert later == Accepted(id="a", position=1)


@pytest.mark.parametrize("name", message_types())
def test_schemas_are_read_by_engines_without_look_around(name: str):
    assert "(?" not in json.dumps(schema(name))


@pytest.mark.parametrize("text", ["a\n", "a b", "", "x" * 65, "ü", "a/b"])
def test_schema_and_decoder_refuse_the_same_ids(text: str):
    document = {"id": text, "box": {"x": 0, "y": 0, "w": 8, "h": 8}}
    # `$` of a schema is the end alone; the validator's Python takes a newline before it.
    if not text.endswith("\n"):
        assert not jsonschema.Draft202012Validator(schema("RoiRequest")).is_valid(document)
    with pytest.raises(msgspec.ValidationError):
        msgspec.json.decode(msgspec.json.encode(document), type=RoiRequest)


def test_a_result_s_message_has_every_field_of_a_result_and_what_the_bus_knows_besides() -> None:
    result = Result(
        id="a", outcome=Outcome.LOCKED, reason="held", label="gate", elapsed_ms=4, views=2, pan_deg=1.0, tilt_deg=2.0,
        zoom=3.0, hfov_deg=4.0, box_ptz=((1.0, 2.0),), range_m=5.0, probability=0.9, sigma_deg=0.1,
    )  # fmt: skip
    assert None not in dataclasses.asdict(result).values(), "a field was added: give it a value here"
    metric, other = (
        json.loads(msgspec.json.encode(RoiResult.of(result, None, metric=metric))) for metric in (True, False)
    )
    assert metric == {**dataclasses.asdict(result), "outcome": "locked", "box_ptz": [{"x": 1.0, "y": 2.0}]}
    assert {**metric, "range_baselines": metric["range_m"]} == {**other, "range_m": other["range_baselines"]}
