"""Every schema is one that the viewers' parser takes, and every topic has its own."""

import json
from importlib import resources

import pytest
from foxglove.messages import CompressedImage
from google.protobuf import descriptor_pb2
from jsonschema import Draft7Validator

from ptzd.errors import LogError
from ptzd.log.topics import IMAGES, TOPICS, topic

TYPES = {"object", "array", "string", "number", "integer", "boolean"}
FILES = sorted(
    item.name for item in resources.files("ptzd.log").joinpath("schemas").iterdir() if item.name.endswith(".json")
)


def breaches(schema, path="$", *, in_array=False):
    """What the parser of JSON schemas in Lichtblick and Foxglove refuses (design: flat, typed, no references)."""
    found = [f"{path}: {word}" for word in ("$ref", "anyOf", "allOf", "enum") if word in schema and word != "enum"]
    if "oneOf" in schema:
        numeric = all(isinstance(part.get("const"), int | float) for part in schema["oneOf"])
        return found if numeric else [*found, f"{path}: oneOf of other than numbers"]
    kind = schema.get("type")
    if kind not in TYPES:
        return [*found, f"{path}: type {kind}"]
    if path == "$" and kind != "object":
        found.append("$: root is no object")
    if kind == "array":
        if in_array:
            found.append(f"{path}: array of arrays")
        found += breaches(schema["items"], f"{path}[]", in_array=True)
    for name, part in schema.get("properties", {}).items():
        found += breaches(part, f"{path}.{name}")
    if kind == "string" and schema.get("format") == "binary" and schema.get("contentEncoding") != "base64":
        found.append(f"{path}: bytes without base64")
    return found


@pytest.mark.parametrize("name", FILES)
def test_viewers_take_the_schema(name):
    schema = json.loads(resources.files("ptzd.log").joinpath("schemas", name).read_text())
    Draft7Validator.check_schema(schema)
    assert breaches(schema) == []
    assert schema["title"] == name.removesuffix(".json")
    if name.startswith("ptzd."):
        kinds = [part["type"] for part in schema["properties"].values()]
        assert "object" not in kinds, "flat"


def test_every_topic_has_its_schema_and_every_schema_its_topic():
    used = {item.schema for item in TOPICS.values() if item.encoding == "json"}
    assert used == {name.removesuffix(".json") for name in FILES}
    for item in TOPICS.values():
        assert item.schema_bytes()


@pytest.mark.parametrize("name", IMAGES)
def test_the_descriptor_of_pictures_is_complete(name):
    found = descriptor_pb2.FileDescriptorSet.FromString(topic(name).schema_bytes())
    assert [file.name for file in found.file] == ["google/protobuf/timestamp.proto", "foxglove/CompressedImage.proto"]
    official = descriptor_pb2.FileDescriptorSet.FromString(CompressedImage.get_schema().data)
    theirs = next(file for file in official.file if file.package == "foxglove")

    def fields(file):
        (message,) = file.message_type
        return {(field.name, field.number, field.type, field.type_name, field.label) for field in message.field}

    assert fields(found.file[1]) == fields(theirs)


def test_an_unknown_topic_is_named():
    with pytest.raises(LogError, match="/dreams: no topic"):
        topic("/dreams")
