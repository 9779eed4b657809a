"""Whether the head moves, over WebSocket."""

import asyncio

import aiohttp
import pytest

from ptzd.sim.clock import VirtualClock
from ptzd.sim.events import TOKEN_LIFE_S, Tokens

STREAM = "/vapix/ws-data-stream"
TOPIC = "tns1:PTZController/tnsaxis:Move//."


def configure(topic: str = TOPIC) -> dict[str, object]:
    return {
        "apiVersion": "1.0",
        "context": "x",
        "method": "events:configure",
        "params": {"eventFilterList": [{"topicFilter": topic}]},
    }


async def connect(visitor, session: aiohttp.ClientSession) -> aiohttp.ClientWebSocketResponse:
    token = (await visitor.get("/axis-cgi/wssession.cgi")).text
    url = f"{visitor.rig.camera_url}{STREAM}?wssession={token}&sources=events"
    return await session.ws_connect(url.replace("http", "ws", 1))


async def next_state(socket: aiohttp.ClientWebSocketResponse) -> tuple[str, float]:
    message = await socket.receive_json(timeout=100)
    assert message["method"] == "events:notify"
    notification = message["params"]["notification"]
    assert notification["topic"] == "tns1:PTZController/tnsaxis:Move/Channel_1"
    assert notification["message"]["source"] == {"PTZConfigurationToken": "1"}
    return notification["message"]["data"]["is_moving"], notification["timestamp"] / 1000


async def test_the_state_comes_first_and_then_every_change_a_little_late(visitor):
    async with aiohttp.ClientSession() as session:
        socket = await connect(visitor, session)
        await socket.send_json(configure())
        reply = await socket.receive_json()
        assert reply == {"apiVersion": "1.0", "method": "events:configure", "data": {}, "context": "x"}
        assert (await next_state(socket))[0] == "0"
        await visitor.ptz(pan=30)
        moving, started_s = await next_state(socket)
        rest, stopped_s = await next_state(socket)
        await socket.close()
    assert (moving, rest) == ("1", "0")
    head = visitor.rig.camera.unit.head
    order = visitor.rig.camera.unit.orders[0]
    assert started_s > order.start_s
    plan = head.axes["pan"].plan_at(stopped_s)
    assert stopped_s > plan.end_s


async def test_digest_on_the_upgrade_works_too(visitor):
    url = (visitor.rig.camera_url + STREAM + "?sources=events").replace("http", "ws", 1)
    socket = await visitor.session.ws_connect(url)
    await socket.send_json(configure())
    assert "data" in await socket.receive_json()
    await socket.close()


@pytest.mark.parametrize("token", ["", "?wssession=wrong"])
async def test_without_a_good_token_there_is_a_challenge(visitor, token):
    url = (visitor.rig.camera_url + STREAM + token).replace("http", "ws", 1)
    async with aiohttp.ClientSession() as session:
        with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
            await session.ws_connect(url)
    assert refusal.value.status == 401


def test_a_token_is_good_once_and_for_fifteen_seconds():
    clock = VirtualClock()
    tokens = Tokens(clock)
    once, late = tokens.issue(), tokens.issue()
    assert tokens.redeem(once)
    assert not tokens.redeem(once)
    clock.advance(TOKEN_LIFE_S + 0.1)
    assert not tokens.redeem(late)


@pytest.mark.parametrize(("message", "code"), [
    ("{", 2101), ('{"method": "events:nothing"}', 2102), ('{"method": "events:configure"}', 2103),
    ('{"method": "events:configure", "params": {"eventFilterList": [{}]}}', 2103),
])  # fmt: skip
async def test_a_wrong_message_gets_its_code_and_the_door(visitor, message, code):
    async with aiohttp.ClientSession() as session:
        socket = await connect(visitor, session)
        await socket.send_str(message)
        assert (await socket.receive_json())["error"]["code"] == code
        assert (await socket.receive()).type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)


async def test_another_topic_brings_nothing(visitor):
    async with aiohttp.ClientSession() as session:
        socket = await connect(visitor, session)
        await socket.send_json(configure("tns1:Device//."))
        await socket.receive_json()
        await visitor.ptz(pan=1)
        with pytest.raises(TimeoutError):
            await socket.receive_json(timeout=0.5)
        await socket.close()


async def test_a_reboot_ends_the_stream(start):
    visitor = await start(boot_s=0.2)
    async with aiohttp.ClientSession() as session:
        socket = await connect(visitor, session)
        await socket.send_json(configure())
        visitor.rig.camera.reboot()
        async with asyncio.timeout(100):
            while not socket.closed:
                await socket.receive()
