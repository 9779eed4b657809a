"""The codec is exact for every event and command, and names what it cannot read."""

import dataclasses
import json
import math
import types
import typing
from enum import Enum

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ptzd.control.commands import Command, PublishFeedback
from ptzd.control.events import Event, FrameArrived, Snapshot
from ptzd.errors import LogError
from ptzd.log import codec
from ptzd.model import Box, FrameRef, HeadReading

POLLED = '{"reading": {"pan_deg": 1, "tilt_deg": 2, "zoom": 3}, "motion": "moving"}'
INTEGERS = st.integers(-(2**63), 2**63)
TEXT = st.text(max_size=12)
FREE = st.recursive(
    st.none() | st.booleans() | INTEGERS | TEXT | st.floats(allow_nan=False),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.dictionaries(TEXT.filter(lambda key: not key.startswith("$")), inner, max_size=3)
    ),
    max_leaves=6,
)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
PLAIN = {
    int: INTEGERS,
    float: st.floats(allow_nan=False),
    str: TEXT,
    bool: st.booleans(),
    Box: st.builds(Box, x=FINITE, y=FINITE, w=st.floats(8, 1e6), h=st.floats(8, 1e6)),
    HeadReading: st.builds(HeadReading, pan_deg=FINITE, tilt_deg=FINITE, zoom=FINITE),
}


def values_of(hint):
    """Strategy for a field's type hint."""
    if hint in PLAIN:
        return PLAIN[hint]
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in {typing.Union, types.UnionType}:
        return st.one_of(st.none() if part is type(None) else values_of(part) for part in arguments)
    if origin is tuple:
        endless = arguments[-1] is Ellipsis
        return (
            st.lists(values_of(arguments[0]), max_size=3).map(tuple)
            if endless
            else st.tuples(*map(values_of, arguments))
        )
    if origin is dict:
        return st.dictionaries(TEXT.filter(lambda key: not key.startswith("$")), FREE, max_size=3)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return st.sampled_from(list(hint))
    return instances(hint)


def instances(kind):
    hints = typing.get_type_hints(kind)
    return st.builds(kind, **{field.name: values_of(hints[field.name]) for field in dataclasses.fields(kind)})


def same(one, other):
    """Equality that tells 0.0 from -0.0, 1 from 1.0 and tuples from lists."""
    return repr(one) == repr(other)


@pytest.mark.parametrize("kind", [*codec.EVENTS.values(), *codec.COMMANDS.values()], ids=lambda kind: kind.__name__)
def test_every_class_comes_back_as_it_was(kind):
    @settings(max_examples=15, deadline=None)
    @given(instances(kind))
    def run(value):
        name, body = codec.encode(value)
        decode = codec.decode_event if issubclass(kind, Event) else codec.decode_command
        again = decode(name, body)
        assert again == value
        assert same(again, value)
        assert codec.encode(again) == (name, body)

    run()


def test_the_registry_holds_every_class():
    assert {kind.__name__ for kind in Event.__subclasses__()} == set(codec.EVENTS)
    assert {kind.__name__ for kind in Command.__subclasses__()} == set(codec.COMMANDS)


@given(st.floats(allow_nan=False))
def test_floats_keep_their_bits(number):
    event = Snapshot(state={"x": number})
    again = codec.decode_event(*codec.encode(event))
    assert math.copysign(1, again.state["x"]) == math.copysign(1, number)
    assert again.state["x"] == number


def test_a_body_is_plain_json():
    name, body = codec.encode(Snapshot(state={"range": math.inf, "pair": (1, 2.5)}))
    assert name == "Snapshot"
    assert json.loads(body) == {"state": {"range": {"$float": "inf"}, "pair": {"$tuple": [1, 2.5]}}}


@pytest.mark.parametrize(
    ("name", "body", "words"),
    [
        ("Dream", "{}", "'Dream' is unknown"),
        ("FrameArrived", "[]", "must be a JSON object"),
        ("FrameArrived", "{", "no JSON"),
        ("FrameArrived", "{}", "'frame' is missing"),
        (
            "FrameArrived",
            '{"frame": {"seq": 1, "t_capture_ns": 2, "colour": 3}}',
            "unknown field 'colour'",
        ),
        ("FrameArrived", '{"frame": {"seq": 1.5, "t_capture_ns": 2}}', "frame.seq: expected int, got float"),
        ("FrameArrived", '{"frame": {"seq": true, "t_capture_ns": 2}}', "seq: expected int, got bool"),
        ("FrameArrived", '{"frame": null}', "frame: expected an object"),
        ("ControlReceived", '{"token": null, "verb": "dance"}', "one of home, stop, hold, release"),
        (
            "HeadPolled",
            '{"reading":{"pan_deg":{"$float":"inf"},"tilt_deg":0,"zoom":1},"motion":"moving"}',
            "not finite",
        ),
        ("Snapshot", '{"state": {"x": {"$tuple": 3}}}', "state.x"),
        ("Snapshot", '{"state": [1]}', "a mapping"),
        ("Snapshot", '{"state": ' + "[" * 100_000 + "]" * 100_000 + "}", "no JSON"),
    ],
)
def test_what_cannot_be_read_is_named(name, body, words):
    with pytest.raises(LogError, match=words.replace("(", r"\(").replace("[", r"\[")) as caught:
        codec.decode_event(name, body)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("detail", [{"x": object()}, {"x": {1: 2}}, {"$float": "inf"}, {"x": {1, 2}}])
def test_what_cannot_be_written_is_named(detail):
    with pytest.raises(LogError, match=r"PublishFeedback\.detail"):
        codec.encode(PublishFeedback(id="a", step="note", detail=detail))


def test_a_field_with_a_default_may_be_absent():
    assert codec.decode_event("Snapshot", "{}") == Snapshot()


def test_integers_in_float_fields_become_floats():
    event = FrameArrived(frame=FrameRef(seq=0, t_capture_ns=2))
    assert codec.decode_event(*codec.encode(event)) == event
    polled = codec.decode_event("HeadPolled", POLLED)
    assert isinstance(polled.reading.pan_deg, float)
