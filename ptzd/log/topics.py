"""Topics of the log, with the schemas that make every file describe itself.

The project's own schemas are flat: root ``type: object``, every property with a ``type``, no references, no
alternatives, no nested arrays; that is what viewers can plot. Absent means unknown: nulls are left out of documents.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Literal

from ptzd.errors import LogError
from ptzd.log.protobuf import compressed_image_descriptor

FISHEYE_IMAGE = "/fisheye/image"
PTZ_IMAGE = "/ptz/image"
IMAGES = (FISHEYE_IMAGE, PTZ_IMAGE)
EVENT = "/event"
COMMAND = "/command"


@dataclass(frozen=True, slots=True, kw_only=True)
class Topic:
    """One channel of the log."""

    name: str
    schema: str
    encoding: Literal["json", "protobuf"] = "json"

    def schema_bytes(self) -> bytes:
        """Schema as MCAP stores it: JSON Schema text, or a serialised ``FileDescriptorSet``."""
        if self.encoding == "protobuf":
            return compressed_image_descriptor()
        return resources.files("ptzd.log").joinpath("schemas", f"{self.schema}.json").read_bytes()

    @property
    def schema_encoding(self) -> str:
        """MCAP's name of the schema language."""
        return "protobuf" if self.encoding == "protobuf" else "jsonschema"


TOPICS: Mapping[str, Topic] = {
    topic.name: topic
    for topic in (
        Topic(name=FISHEYE_IMAGE, schema="foxglove.CompressedImage", encoding="protobuf"),
        Topic(name=PTZ_IMAGE, schema="foxglove.CompressedImage", encoding="protobuf"),
        Topic(name=EVENT, schema="ptzd.Event"),
        Topic(name=COMMAND, schema="ptzd.Command"),
        Topic(name="/state", schema="ptzd.State"),
        Topic(name="/request", schema="ptzd.Request"),
        Topic(name="/result", schema="ptzd.Result"),
        Topic(name="/match", schema="ptzd.Match"),
        Topic(name="/pose", schema="ptzd.Pose"),
        Topic(name="/drift", schema="ptzd.Drift"),
        Topic(name="/motor", schema="ptzd.Motor"),
        Topic(name="/fisheye/annotations", schema="foxglove.ImageAnnotations"),
        Topic(name="/ptz/annotations", schema="foxglove.ImageAnnotations"),
        Topic(name="/fisheye/calibration", schema="foxglove.CameraCalibration"),
        Topic(name="/ptz/calibration", schema="foxglove.CameraCalibration"),
        Topic(name="/tf", schema="foxglove.FrameTransforms"),
        Topic(name="/scene", schema="foxglove.SceneUpdate"),
        Topic(name="/log", schema="foxglove.Log"),
    )
}


def topic(name: str) -> Topic:
    """Topic of this name.

    Raises
    ------
    LogError
        The log has no such topic.
    """
    if name not in TOPICS:
        raise LogError(f"{name}: no topic of the log; known are {', '.join(TOPICS)}")
    return TOPICS[name]
