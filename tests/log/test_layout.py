"""The Foxglove layout names topics and fields that the log has."""

import json
from pathlib import Path

import pytest

from ptzd.log.topics import TOPICS

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
