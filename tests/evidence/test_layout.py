"""The Foxglove layout names topics and fields that the log has."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from jsonschema import Draft7Validator
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from ptzd.log.reader import LogReader
from ptzd.log.topics import TOPICS

LOCK = Path(__file__).parents[1] / "golden" / "lock.mcap"
LAYOUT = json.loads((Path(__file__).parents[2] / "config" / "foxglove-layout.json").read_text())
PANELS = LAYOUT["configById"]


def leaves(node):
    return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])


def named_topics(value):
    """Every topic or path of a panel."""
    if isinstance(value, str):
        return [value] if value.startswith("/") else []
    parts = [*value.keys(), *value.values()] if isinstance(value, dict) else value if isinstance(value, list) else []
    return [name for part in parts for name in named_topics(part)]


def test_every_panel_is_placed_once():
    assert sorted(leaves(LAYOUT["layout"])) == sorted(PANELS)


@pytest.mark.parametrize("panel", PANELS)
def test_panels_name_what_the_log_has(panel):
    kind, _, _ = panel.partition("!")
    assert kind in {"Image", "3D", "StateTransitions", "Plot", "RosOut", "RawMessages"}
    for name in named_topics(PANELS[panel]):
        topic, _, field = name.partition(".")
        assert topic in TOPICS
        if field:
            assert field in json.loads(TOPICS[topic].schema_bytes())["properties"]


def test_both_pictures_show_their_annotations():
    shown = {
        panel["imageMode"]["imageTopic"]: set(panel["imageMode"]["annotations"])
        for panel in map(PANELS.get, ("Image!fisheye", "Image!ptz"))
    }
    assert shown == {"/fisheye/image": {"/fisheye/annotations"}, "/ptz/image": {"/ptz/annotations"}}


@pytest.fixture(scope="module")
def messages():
    """What each topic of a recorded lock holds."""
    found = {}
    with LogReader(LOCK) as log:
        for entry in log.entries():
            found.setdefault(entry.topic, []).append(entry)
    return found


@pytest.mark.parametrize("name", sorted({name for panel in PANELS.values() for name in named_topics(panel)}))
def test_every_path_of_the_layout_leads_to_something_in_a_recorded_lock(messages, name):
    topic, _, field = name.partition(".")
    if topic == "/fisheye/calibration":
        assert topic not in messages, "viewers have no name for this lens; the panel hides it"
        return
    assert messages[topic]
    if field:
        values = [json.loads(entry.data).get(field) for entry in messages[topic]]
        assert any(value is not None for value in values)


def test_every_document_of_a_recorded_lock_is_what_its_schema_says(messages):
    checked = 0
    for topic, entries in messages.items():
        if TOPICS[topic].encoding == "json":
            validator = Draft7Validator(json.loads(TOPICS[topic].schema_bytes()))
            for entry in entries:
                assert [error.message for error in validator.iter_errors(json.loads(entry.data))] == []
                checked += 1
    assert checked > 100


def test_annotations_have_the_time_of_a_picture_they_lie_on(messages):
    for stream in ("fisheye", "ptz"):
        shown = {entry.publish_ns for entry in messages[f"/{stream}/image"]}
        drawn = [entry for entry in messages[f"/{stream}/annotations"] if json.loads(entry.data)["points"]]
        assert drawn
        assert {entry.publish_ns for entry in drawn} <= shown


def test_independent_readers_decode_the_pictures_of_a_recorded_lock():
    """The protobuf reader of the MCAP project, from the schema inside the file alone."""
    with LOCK.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        pictures = [
            (channel.topic, decoded)
            for _, channel, _, decoded in reader.iter_decoded_messages(topics=["/fisheye/image", "/ptz/image"])
        ]
    assert {topic for topic, _ in pictures} == {"/fisheye/image", "/ptz/image"}
    for topic, picture in pictures:
        pixels = cv2.imdecode(np.frombuffer(picture.data, np.uint8), cv2.IMREAD_COLOR)
        assert pixels.shape == ((480, 640, 3) if topic == "/fisheye/image" else (240, 320, 3))
        assert picture.frame_id == ("fisheye" if topic == "/fisheye/image" else "camera")
