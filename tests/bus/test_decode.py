from __future__ import annotations

import json
import math
import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ptzd.bus.decode import (
    MAX_PAYLOAD_BYTES,
    goto_event,
    home_after_event,
    lease_event,
    move_event,
    patrol_event,
    readable_id,
    request_event,
    update_event,
)
from ptzd.control.events import (
    GotoAsked,
    HomeAfterAsked,
    LeaseAsked,
    LeaseWish,
    MoveAsked,
    PatrolAsked,
    PatrolWish,
    PayloadRefused,
    RequestReceived,
    UpdateReceived,
    ZoomWish,
)
from ptzd.model import Box, HomeAfter

GOOD = {"id": "a-1", "box": {"x": 1, "y": 2.5, "w": 8, "h": 30}}
FULL = {
    **GOOD,
    "frame": {"seq": 12},
    "range_m": {"min": 1, "max": 20},
    "zoom": {"hfov_deg": 10},
    "fill": 0.4,
    "hold_s": 3,
    "timeout_s": 9.5,
    "priority": 9,
    "label": "Tür 3",
    "by": "desk",
}


def told(document: object, token: int | None = 5) -> RequestReceived | PayloadRefused:
    return request_event(json.dumps(document).encode(), token)


def test_least_request_leaves_everything_to_the_settings():
    assert told(GOOD) == RequestReceived(token=5, id="a-1", box=Box(x=1.0, y=2.5, w=8.0, h=30.0))


def test_full_request_arrives_whole():
    event = told(FULL, None)
    assert event == RequestReceived(
        token=None, id="a-1", box=Box(x=1.0, y=2.5, w=8.0, h=30.0), frame_seq=12, range_m=(1.0, 20.0),
        zoom=ZoomWish.HFOV, hfov_deg=10.0, fill=0.4, hold_s=3.0, timeout_s=9.5, priority=9, label="Tür 3", by="desk",
    )  # fmt: skip


def test_a_wish_on_the_lease():
    taken = lease_event(b'{"owner":"desk"}', None)
    assert taken == LeaseAsked(token=None, wish=LeaseWish.TAKE, owner="desk")
    whole = lease_event(b'{"owner":"desk","wish":"ask","rank":8,"for_s":2}', 5)
    assert whole == LeaseAsked(token=5, wish=LeaseWish.ASK, owner="desk", rank=8, for_s=2.0)


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (b"{}", "$.owner"),
        (b'{"owner":"two words"}', "$.owner"),
        (b'{"owner":""}', "$.owner"),
        (b'{"owner":"desk","wish":"seize"}', "$.wish"),
        (b'{"owner":"desk","rank":9}', "$.rank"),
        (b'{"owner":"desk","for_s":0}', "$.for_s"),
        (b'{"owner":"desk","owner":"gate"}', "$..owner"),
        (b"", "$"),
    ],
)
def test_what_is_no_wish_is_refused_by_its_field(payload, field):
    event = lease_event(payload, 5)
    assert isinstance(event, PayloadRefused)
    assert event.field == field
    assert event.message.startswith("lease: ")


def test_a_place_to_go_to():
    assert goto_event('{"place":"Tor Süd 2"}'.encode(), None) == GotoAsked(token=None, place="Tor Süd 2")
    whole = goto_event(b'{"place":"gate","by":"desk","hold_s":0}', 5)
    assert whole == GotoAsked(token=5, place="gate", by="desk", hold_s=0.0)


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (b"{}", "$.place"),
        (b'{"place":""}', "$.place"),
        (b'{"place":7}', "$.place"),
        (b'{"place":"a\\u0007"}', "$.place"),
        (b'{"place":"' + b"x" * 65 + b'"}', "$.place"),
        (b'{"place":"gate","by":"two words"}', "$.by"),
        (b'{"place":"gate","hold_s":-1}', "$.hold_s"),
        (b'{"place":"gate","hold_s":1e9}', "$.hold_s"),
        (b'{"place":"gate","speed":1}', "$.speed"),
        (b"gate", "$"),
    ],
)
def test_what_is_no_place_to_go_to_is_refused_by_its_field(payload, field):
    event = goto_event(payload, 5)
    assert isinstance(event, PayloadRefused)
    assert event.field == field
    assert event.message.startswith("goto: ")


def test_a_word_on_the_patrol():
    begins = patrol_event(b'{"patrol":"night"}', None)
    assert begins == PatrolAsked(token=None, wish=PatrolWish.START, patrol="night")
    assert patrol_event(b'{"wish":"pause"}', 5) == PatrolAsked(token=5, wish=PatrolWish.PAUSE)


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (b'{"wish":"rest"}', "$.wish"),
        (b'{"patrol":7}', "$.patrol"),
        (b'{"patrol":"' + b"x" * 65 + b'"}', "$.patrol"),
        (b'{"patrol":"night","dwell_s":1}', "$.dwell_s"),
        (b"", "$"),
    ],
)
def test_what_is_no_word_on_the_patrol_is_refused_by_its_field(payload, field):
    event = patrol_event(payload, 5)
    assert isinstance(event, PayloadRefused)
    assert event.field == field
    assert event.message.startswith("patrol: ")


@pytest.mark.parametrize(
    ("payload", "after"),
    [
        (b'{"after_s":0}', HomeAfter(after_s=0.0)),
        (b'{"after_s":60.5}', HomeAfter(after_s=60.5)),
        (b'{"after_s":"never"}', HomeAfter(after_s=None)),
        (b'{"after_s":"settings"}', None),
    ],
)
def test_how_long_the_head_is_left_where_it_is(payload, after):
    assert home_after_event(payload, 5) == HomeAfterAsked(token=5, after=after)


@pytest.mark.parametrize(
    "payload", [b"{}", b'{"after_s":-1}', b'{"after_s":"soon"}', b'{"after_s":1e9}', b'{"after_s":null}']
)
def test_what_is_no_time_is_refused(payload):
    event = home_after_event(payload, 5)
    assert isinstance(event, PayloadRefused)
    assert (event.field, event.message[:12]) == ("$.after_s", "home_after: ")


def test_frame_by_time_and_range_without_an_end():
    event = told({**GOOD, "frame": {"t_capture_ns": 5}, "range_m": {"min": 2}, "zoom": "keep"})
    assert isinstance(event, RequestReceived)
    assert (event.frame_seq, event.frame_t_capture_ns) == (None, 5)
    assert event.range_m == (2.0, math.inf)
    assert event.zoom is ZoomWish.KEEP


def box(**changes: object) -> dict[str, object]:
    return {**GOOD, "box": {**GOOD["box"], **changes}}


@pytest.mark.parametrize(
    ("document", "field"),
    [
        ([], "$"),
        (None, "$"),
        ("hello", "$"),
        ({}, "$.id"),
        ({"id": "a"}, "$.box"),
        ({**GOOD, "colour": 1}, "$.colour"),
        (box(depth=1), "$.box.depth"),
        (box(w=7.9), "$.box.w"),
        (box(h=-8), "$.box.h"),
        (box(w=True), "$.box.w"),
        (box(x="1"), "$.box.x"),
        (box(x=None), "$.box.x"),
        (box(x=float("nan")), "$.box.x"),
        (box(y=float("-inf")), "$.box.y"),
        (box(x=1e300), "$.box.x"),
        ({**GOOD, "id": ""}, "$.id"),
        ({**GOOD, "id": "a" * 65}, "$.id"),
        ({**GOOD, "id": "a/b"}, "$.id"),
        ({**GOOD, "id": "*"}, "$.id"),
        ({**GOOD, "id": "a\n"}, "$.id"),
        ({**GOOD, "id": 3}, "$.id"),
        ({**GOOD, "frame": {}}, "$.frame"),
        ({**GOOD, "frame": {"seq": 1, "t_capture_ns": 2}}, "$.frame"),
        ({**GOOD, "frame": {"seq": -1}}, "$.frame.seq"),
        ({**GOOD, "frame": {"seq": 1.5}}, "$.frame.seq"),
        ({**GOOD, "frame": {"seq": 1 << 63}}, "$.frame.seq"),
        ({**GOOD, "range_m": {"min": 3, "max": 3}}, "$.range_m.max"),
        ({**GOOD, "range_m": {"min": 0, "max": 3}}, "$.range_m.min"),
        ({**GOOD, "range_m": {"max": 3}}, "$.range_m.min"),
        ({**GOOD, "range_m": {"min": 1, "max": float("inf")}}, "$.range_m.max"),
        ({**GOOD, "zoom": "max"}, "$.zoom"),
        ({**GOOD, "zoom": 3}, "$.zoom"),
        ({**GOOD, "zoom": {"hfov_deg": 0}}, "$.zoom.hfov_deg"),
        ({**GOOD, "zoom": {"hfov": 10}}, "$.zoom.hfov"),
        ({**GOOD, "fill": 0.04}, "$.fill"),
        ({**GOOD, "fill": 0.96}, "$.fill"),
        ({**GOOD, "hold_s": -1}, "$.hold_s"),
        ({**GOOD, "timeout_s": 0}, "$.timeout_s"),
        ({**GOOD, "priority": 10}, "$.priority"),
        ({**GOOD, "priority": 1.5}, "$.priority"),
        ({**GOOD, "label": "x" * 65}, "$.label"),
        ({**GOOD, "label": "\x1b[2J"}, "$.label"),
    ],
)
def test_refusal_names_the_path(document: object, field: str):
    event = told(document)
    assert isinstance(event, PayloadRefused)
    assert (event.code, event.field, event.token) == ("invalid", field, 5)
    assert "\n" not in event.message


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"hello",
        b"{",
        b'{"id": "a"',
        b"\xff\xfe",
        b'{"id": "\xff"}',
        b"\xef\xbb\xbf{}",
        b'{"id": "\\ud800"}',
        json.dumps(GOOD).encode() + b"}",
        b'{"id": "a", "box": {"x": 1,}}',
    ],
)
def test_what_is_not_json(payload: bytes):
    event = request_event(payload, 2)
    assert isinstance(event, PayloadRefused)
    assert event.code == "not_json"


@pytest.mark.parametrize("opening", [b"[", b'{"a":', b'{"id":"a","box":[', b'{"id":"a","zoom":{"a":'])
def test_deep_nesting_is_only_a_refusal(opening: bytes):
    event = request_event((opening + b"[" * MAX_PAYLOAD_BYTES)[:MAX_PAYLOAD_BYTES], None)
    assert isinstance(event, PayloadRefused)


def test_key_twice_is_refused():
    event = request_event(b'{"id":"a","box":{"x":1,"x":2,"y":1,"w":9,"h":9}}', 2)
    assert isinstance(event, PayloadRefused)
    assert (event.code, event.field) == ("invalid", "$..x")
    assert event.id is None


def test_one_megabyte_is_refused_without_a_look():
    event = request_event(b"{" * 1_000_000, 2)
    assert isinstance(event, PayloadRefused)
    assert (event.code, event.field, event.id) == ("too_large", "$", None)
    assert "1000000" in event.message


def test_overlong_numbers():
    for digits in (b"1" * 5000, b"1e400", b"-1e400", b"1" * 400):
        event = request_event(b'{"id":"a","box":{"x":' + digits + b',"y":1,"w":9,"h":9}}', 2)
        assert isinstance(event, PayloadRefused)
        assert (event.code, event.field) == ("invalid", "$.box.x")


def test_readable_id_of_a_refused_put_is_passed_on():
    event = told({**GOOD, "colour": 1}, None)
    assert isinstance(event, PayloadRefused)
    assert event.id == "a-1"
    assert readable_id(b'{"id": "a", "box": {"x": NaN}}') == "a"
    assert readable_id(b'{"id": "a", "id": "b"}') is None
    assert readable_id(b'{"id": "a/b"}') is None
    assert readable_id(b'{"id": 3}') is None
    assert readable_id(b'["id"]') is None


def test_update_becomes_an_event_or_a_refusal_that_ends_nothing():
    good = update_event(b'{"box":{"x":1,"y":2,"w":9,"h":9},"frame":{"seq":4}}', "a", 8)
    box = Box(x=1.0, y=2.0, w=9.0, h=9.0)
    assert good == UpdateReceived(id="a", box=box, frame_seq=4, token=8, told=True)
    bad = update_event(b'{"id":"a","box":{"x":1,"y":2,"w":9,"h":9}}', "a", None)
    assert isinstance(bad, PayloadRefused)
    assert (bad.field, bad.id, bad.token, bad.about) == ("$.id", None, None, "a")
    assert bad.message.startswith("update of a: ")


def test_hundred_thousand_mutations_never_break_the_decoder():
    rng = random.Random(20240817)
    seeds = [json.dumps(FULL).encode(), json.dumps(GOOD).encode(), json.dumps(FULL, ensure_ascii=False).encode()]
    shards = [
        b"NaN",
        b"1e999",
        b"[",
        b"]",
        b"{",
        b"}",
        b'"',
        b"\\u0000",
        b"\\ud800",
        b"\x00",
        b"\xff",
        b",",
        b"-",
        b"null",
    ]
    kinds = {"not_json": 0, "invalid": 0, "fine": 0}
    for _ in range(100_000):
        payload = bytearray(rng.choice(seeds))
        for _ in range(1 + int(rng.random() * 3)):
            at = int(rng.random() * (len(payload) + 1))
            payload[at : at + int(rng.random() * 7)] = rng.choice(shards) if rng.random() < 0.5 else rng.randbytes(1)
        event = request_event(bytes(payload), None)
        kinds[event.code if isinstance(event, PayloadRefused) else "fine"] += 1
    assert min(kinds.values()) > 100


LEAVES = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=70)
DOCUMENTS = st.fixed_dictionaries(
    {},
    optional={name: LEAVES | st.dictionaries(st.sampled_from("xywh"), LEAVES) for name in [*FULL, "other"]},
)


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(DOCUMENTS)
def test_what_passes_is_within_its_ranges(document: dict[str, object]):
    event = told({**GOOD, **document})
    if isinstance(event, PayloadRefused):
        assert event.code in {"invalid", "not_json"}
        assert event.field.startswith("$")
        return
    assert min(event.box.w, event.box.h) >= 8
    assert 0 <= event.priority <= 9
    assert len(event.label) <= 64
    assert event.fill is None or 0.05 <= event.fill <= 0.95


SEEN = {"pan_deg": 1.0, "tilt_deg": 2.0, "zoom": 3.0}


@pytest.mark.parametrize(
    ("asked", "wish"),
    [
        ({"to": {"pan_deg": 4.0, "tilt_deg": 1.0}}, "to"),
        ({"by": {"tilt_deg": -4.0}, "hfov_deg": 20.0}, "by"),
        ({"point": {"x": 3, "y": 4}, "picture": SEEN}, "point"),
        ({"box": {"x": 3, "y": 4, "w": 20, "h": 9}, "fill": 0.5}, "box"),
        ({"speed": {"pan_deg_s": 4.0, "zoom_rate": -1}}, "speed"),
        ({"lens": {"focus": "auto", "iris": 12}}, "lens"),
    ],
)
def test_each_way_to_move_becomes_an_event(asked, wish):
    event = move_event(json.dumps({"owner": "desk", **asked}).encode(), 5)
    assert (type(event), event.owner, event.token, event.wish) == (MoveAsked, "desk", 5, wish)


@pytest.mark.parametrize(
    ("asked", "field", "words"),
    [
        ({}, "$", "exactly one of to, by, point, box, speed, lens; there is none"),
        ({"by": {}, "speed": {}}, "$", "there is by and speed"),
        ({"speed": {}, "hfov_deg": 20.0}, "$.hfov_deg", "`hfov_deg` does not go with `speed`"),
        ({"by": {}, "picture": SEEN}, "$.picture", "`picture` does not go with `by`"),
        ({"box": {"x": 3, "y": 4, "w": 20, "h": 9}, "fill": 0.5, "hfov_deg": 9.0}, "$.fill", "give one"),
        ({"speed": {"zoom_rate": 1.5}}, "$.speed.zoom_rate", "<= 1"),
        ({"lens": {"focus": 0}}, "$.lens.focus", ""),
        ({"to": {"pan": 3}}, "$.to.pan", "unknown field"),
        ({"to": {"pan_deg": 3}}, "$.to.tilt_deg", "required"),
        ({"lens": {}}, "$.lens", "neither focus nor iris"),
    ],
)
def test_what_is_no_way_to_move_is_refused_with_its_place(asked, field, words):
    event = move_event(json.dumps({"owner": "desk", **asked}).encode(), None)
    assert (type(event), event.code) == (PayloadRefused, "invalid")
    assert words in event.message
    assert event.field == field
