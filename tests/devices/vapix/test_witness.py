from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest
from aiohttp import web
from hypothesis import given
from hypothesis import strategies as st

from ptzd.config import Limits
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.witness import is_moving
from ptzd.errors import DeviceError, DeviceGarbled, DeviceRefused
from ptzd.model import HeadReading

DATA = Path(__file__).parents[2] / "data" / "axis_http"
TOPIC = "tns1:PTZController/tnsaxis:Move/Channel_1"


def told(value: object, topic: str = TOPIC) -> str:
    notification = {"timestamp": 1, "topic": topic, "message": {"source": {}, "key": {}, "data": {"is_moving": value}}}
    return json.dumps({"apiVersion": "1.0", "method": "events:notify", "params": {"notification": notification}})


def test_what_the_camera_says_of_its_motion():
    assert is_moving(told("1"), "Channel_1") is True
    assert is_moving(told("0"), "Channel_1") is False
    assert is_moving(told("1"), "Channel_2") is None
    assert is_moving(told("maybe"), "Channel_1") is None
    assert is_moving(told("1", "tns1:PTZController/tnsaxis:PTZPresets/Channel_1"), "Channel_1") is None
    assert is_moving('{"apiVersion":"1.0","method":"events:configure","data":{}}', "Channel_1") is None


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    )
)
def test_a_value_of_any_kind_is_no_word_on_motion_or_one(value):
    assert is_moving(told(value), "Channel_1") in {None, True, False}
    assert is_moving(told([value]), "Channel_1") is None


def test_a_refused_subscription_and_other_formats_are_named():
    with pytest.raises(DeviceRefused, match="does not give its motion events"):
        is_moving('{"error":{"code":2103}}', "Channel_1")
    for path in DATA.glob("*.xml"):
        with pytest.raises(DeviceGarbled, match="not JSON"):
            is_moving(path.read_text(), "Channel_1")


@given(st.text(max_size=80))
def test_any_text_is_a_message_or_a_named_error(text):
    try:
        assert is_moving(text, "Channel_1") is None
    except DeviceError:
        return


class Events:
    """The event stream of a camera; ``say`` sends to whoever listens."""

    def __init__(self) -> None:
        self.sockets: list[web.WebSocketResponse] = []
        self.asked: list[dict] = []

    async def token(self, _request):
        return web.Response(text="token-1\r\n")

    async def serve(self, request):
        assert request.query["wssession"] == "token-1"
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        self.asked.append(await socket.receive_json())
        self.sockets.append(socket)
        await socket.send_str(told("0"))
        async for _ in socket:
            pass
        return socket

    async def say(self, text: str) -> None:
        await self.sockets[-1].send_str(text)


@pytest.fixture
def events(camera):
    events = Events()
    camera.faults |= {"/axis-cgi/wssession.cgi": events.token, "/vapix/ws-data-stream": events.serve}
    return events


async def test_the_cameras_word_ends_a_move_sooner(events, camera, settings_for, clock, eventually):
    camera.speed_deg_s = 20.0
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        await head.describe()
        await eventually(lambda: head._witness.listening)
        assert events.asked[0]["params"]["eventFilterList"] == [{"topicFilter": "tns1:PTZController/tnsaxis:Move//."}]
        move = asyncio.create_task(head.move(HeadReading(pan_deg=20, tilt_deg=0, zoom=1)))
        await eventually(lambda: camera.place()[0] > 1)
        await events.say(told("1"))
        await eventually(lambda: camera.place()[0] == 20)
        await events.say(told("0"))
        assert (await move).pan_deg == 20
        assert head._poses.rest.witnessed


async def test_a_stream_that_breaks_is_opened_again_and_costs_nothing(events, camera, settings_for, clock, eventually):
    async with VapixHead(settings_for(camera), Limits(), clock, jitter=lambda: 0.999) as head:
        await head.describe()
        await eventually(lambda: head._witness.listening)
        await events.sockets[-1].close()
        reading = HeadReading(pan_deg=5, tilt_deg=0, zoom=1)
        assert await head.move(reading) == reading
        await eventually(lambda: len(events.asked) == 2)


async def test_a_camera_without_events_is_asked_once(head, camera):
    await asyncio.sleep(0.1)
    assert sum("wssession" in path for path in camera.seen) == 1
