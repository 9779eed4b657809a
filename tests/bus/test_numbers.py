"""A number that is none is refused on either side, and never taken for an absent one."""

from __future__ import annotations

import json
import math
import typing

import jsonschema
import msgspec
import pytest
import zenoh

from ptzd.bus.by_hand import MoveRequest, PanTilt, Speed, ViewPose
from ptzd.bus.client import Client
from ptzd.bus.decode import decode
from ptzd.bus.encode import encode
from ptzd.bus.fields import BoxPx, Incoming
from ptzd.bus.messages import MESSAGES, LeaseRequest, RoiRequest, schema
from ptzd.cli import entry
from ptzd.errors import RequestRefused

BOX = (1.0, 2.0, 30.0, 40.0)
NONE_OF_THEM = [math.nan, math.inf, -math.inf]
INCOMING = [message for message in MESSAGES.values() if issubclass(message, Incoming)]
DESK = {"owner": "desk"}
PTZ_BOX = BoxPx(x=1, y=2, w=9, h=9)
ASKED = {"id": "a", "box": {"x": 0, "y": 0, "w": 9, "h": 9}}


def desk(**wish: typing.Any) -> MoveRequest:
    return MoveRequest(owner="desk", **wish)


def seen_at(zoom: float) -> ViewPose:
    return ViewPose(pan_deg=1, tilt_deg=2, zoom=zoom)


def optional(message: type[msgspec.Struct]) -> list[str]:
    """Fields that may be absent."""
    return [field.name for field in msgspec.structs.fields(message) if not field.required]


@pytest.mark.parametrize("number", NONE_OF_THEM)
@pytest.mark.parametrize(
    ("ask", "field"),
    [
        (lambda client, number: client.request(box=BOX, hold_s=number), "$.hold_s"),
        (lambda client, number: client.request(box=BOX, timeout_s=number), "$.timeout_s"),
        (lambda client, number: client.request(box=BOX, fill=number), "$.fill"),
        (lambda client, number: client.request(box=BOX, zoom=number), "$.zoom.hfov_deg"),
        (lambda client, number: client.request(box=BOX, range_m=(number, 3)), "$.range_m.min"),
        (lambda client, number: client.request(box=(1, number, 30, 40)), "$.box.y"),
        (lambda client, number: client.update("a", (1, 2, 30, number)), "$.box.h"),
        (lambda client, number: client.goto("gate", hold_s=number), "$.hold_s"),
        (lambda client, number: client.home_after(number), "$.after_s"),
        (lambda client, number: client.lease("desk", for_s=number).__aenter__(), "$.for_s"),
        (lambda client, number: client.move(desk(to=PanTilt(pan_deg=number, tilt_deg=0))), "$.to.pan_deg"),
        (lambda client, number: client.move(desk(speed=Speed(zoom_rate=number))), "$.speed.zoom_rate"),
        (lambda client, number: client.move(desk(box=PTZ_BOX, hfov_deg=number)), "$.hfov_deg"),
        (lambda client, number: client.move(desk(box=PTZ_BOX, fill=number)), "$.fill"),
        (lambda client, number: client.move(desk(box=PTZ_BOX, picture=seen_at(number))), "$.picture.zoom"),
    ],
)
async def test_no_message_of_the_client_carries_one(ask, field: str, number: float):
    """Refused before a session is looked for: none is open."""
    with pytest.raises(RequestRefused, match="finite") as caught:
        await ask(Client.open("tcp/127.0.0.1:1", rig="hall"), number)
    assert (caught.value.code, caught.value.field) == ("invalid", field)


async def test_a_farthest_range_without_end_is_said_by_inf_or_none(core, client):
    for farthest in (None, math.inf):
        await client.request(box=BOX, range_m=(2, farthest))
    assert [event.range_m for event in core.seen] == [(2.0, math.inf)] * 2
    for farthest in (math.nan, -math.inf):
        with pytest.raises(RequestRefused) as caught:
            await client.request(box=BOX, range_m=(2, farthest))
        assert caught.value.field == "$.range_m.max"
    assert len(core.seen) == 2


@pytest.mark.parametrize("wait_s", [*NONE_OF_THEM, 0.0, -1.0])
async def test_a_wait_is_a_finite_time(wait_s: float):
    with pytest.raises(RequestRefused, match="timeout_s"):
        Client.open(timeout_s=wait_s)
    with pytest.raises(RequestRefused, match="timeout_s"):
        await Client.open(rig="hall").result("a", timeout_s=wait_s)


@pytest.mark.parametrize("option", ["--hold", "--timeout", "--fill", "--hfov"])
@pytest.mark.parametrize("number", ["inf", "nan", "-inf"])
def test_the_command_line_says_which(bus_endpoint: str, option: str, number: str, capsys):
    assert entry(["aim", "310,220,40,32", "--connect", bus_endpoint, "--rig", "hall", f"{option}={number}"]) == 65
    told = capsys.readouterr().err
    assert "finite" in told
    assert told.count("\n") == 1


def test_a_client_is_held_to_what_the_daemon_refuses():
    for loose, words in [
        ({"frame": {"seq": 1, "t_capture_ns": 2}}, "exactly one"),
        ({"frame": {}}, "exactly one"),
        ({"range_m": {"min": 3, "max": 2}}, "below the farthest"),
    ]:
        with pytest.raises(RequestRefused, match=words):
            encode(msgspec.convert({**ASKED, **loose}, RoiRequest))


def test_a_text_that_cannot_be_written_is_refused_by_its_characters():
    with pytest.raises(RequestRefused, match=r"udcff"):
        encode(RoiRequest(id="a", box=BoxPx(x=1, y=2, w=9, h=9), label="T\udcffr"))


def test_what_is_finite_is_written_as_it_is():
    sent = encode(LeaseRequest(owner="desk", for_s=2.5))
    assert json.loads(sent.payload) == {"owner": "desk", "for_s": 2.5}
    assert sent.encoding == "application/json;ptzd.LeaseRequest.v1"


@pytest.mark.parametrize("message", INCOMING)
def test_null_is_refused_by_decoder_and_schema_alike(message: type[Incoming]):
    """JavaScript and others write NaN and infinity as null: absent is said by absence."""
    judge = jsonschema.Draft202012Validator(schema(message.__name__))
    assert "null" not in json.dumps(schema(message.__name__))
    for name in optional(message):
        document = {**_least(message), name: None}
        with pytest.raises(RequestRefused) as caught:
            decode(json.dumps(document).encode(), message)
        assert (caught.value.code, caught.value.field) == ("invalid", f"$.{name}")
        assert not judge.is_valid(document)
        assert judge.is_valid(_least(message))


@pytest.mark.parametrize("document", [{"to": None}, {"lens": {"focus": None}}, {"by": {}, "hfov_deg": None}])
def test_null_inside_is_named_by_its_path(document: dict[str, typing.Any]):
    with pytest.raises(RequestRefused, match="leave the field out") as caught:
        decode(json.dumps({**DESK, **document}).encode(), MoveRequest)
    assert caught.value.field in {"$.to", "$.lens.focus", "$.hfov_deg"}


def _least(message: type[Incoming]) -> dict[str, typing.Any]:
    values = {
        "id": "a",
        "owner": "desk",
        "box": dict(zip("xywh", (1, 2, 9, 9), strict=True)),
        "place": "gate",
        "after_s": 3,
    }
    return {field.name: values[field.name] for field in msgspec.structs.fields(message) if field.required}


@pytest.fixture
def bus_endpoint(endpoint: str) -> typing.Iterator[str]:
    """Where somebody listens: the client connects before it is asked to send."""
    config = zenoh.Config()
    for key, value in {"listen/endpoints": [endpoint], "scouting/multicast/enabled": False}.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    yield endpoint
    session.close()
