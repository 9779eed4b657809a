"""Every body recorded from real cameras, over a socket: read, or refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest
from aiohttp import web

from ptzd.devices.vapix import requests
from ptzd.devices.vapix.address import Address
from ptzd.devices.vapix.answers import Attributes, DeviceInfo, Parameters
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.credentials import Credentials, Secret
from ptzd.devices.vapix.witness import is_moving
from ptzd.errors import DeviceGarbled

DATA = Path(__file__).parents[2] / "data" / "axis_http"
BODIES = sorted(path for path in DATA.iterdir() if path.name != "LICENSE")
TYPES = {".txt": "text/plain", ".json": "application/json", ".xml": "text/xml"}
QUESTIONS = (
    requests.position(1), requests.limits(1), requests.speed(1), requests.parameters("PTZ"), requests.device_info(),
    requests.system_ready(), requests.event_session(), requests.attributes(1),
)  # fmt: skip


@pytest.fixture
async def ask(camera, clock):
    """Ask a question that is answered with a recorded body."""
    credentials = Credentials(user="ptzd", password=Secret("orange-Bicycle_77"))
    async with CameraClient(Address(url=camera.url, setting="ptz"), clock) as client:
        client.use(credentials)

        async def answered(request, path):
            async def recorded(_request):
                return web.Response(body=path.read_bytes(), content_type=TYPES[path.suffix])

            camera.faults[request.path] = recorded
            return await client.send(request)

        yield answered


def understood(path: Path) -> type | None:
    """What a body is; None for those that the client never asks for."""
    if path.suffix == ".txt":
        return Parameters
    return DeviceInfo if path.stem.startswith("basic_device_info") else None


@pytest.mark.parametrize("path", BODIES, ids=lambda path: path.name)
async def test_a_recorded_body_is_read_or_refused_by_name(ask, path):
    kind = understood(path)
    read, refused = [], []
    for question in QUESTIONS:
        try:
            read.append(await ask(question, path))
        except DeviceGarbled as refusal:
            refused.append((question.path, str(refusal)))
    assert [type(value) for value in read if value != Attributes()] == ([kind] if kind else [])
    assert [said for place, said in refused if place not in said or "\n" in said] == []


@pytest.mark.parametrize("path", sorted(DATA.glob("*.xml")), ids=lambda path: path.stem)
def test_events_of_the_rtsp_stream_are_none_of_the_websocket(path):
    with pytest.raises(DeviceGarbled, match="an event is not JSON"):
        is_moving(path.read_text(), "Channel_1")
