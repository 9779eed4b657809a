"""Anybody may hold a token, put on a key or answer a query: the client neither falls over nor is kept from stopping."""

from __future__ import annotations

import asyncio
import logging

import msgspec
import pytest
from zenoh.handlers import Callback

from ptzd.bus.client import Client
from ptzd.bus.keys import Keys, check_id
from ptzd.bus.messages import Feedback, Status, encoding
from ptzd.control.events import ControlReceived
from ptzd.errors import BusError, RequestRefused
from ptzd.outgoing import ImageAttachment

GARBAGE = [b"", b"garbage", b"\xff\xfe", b"[" * 5000, b'{"id":3}', b"null", b"{bad"]
BAD_NAMES = ["", "a b", "a#b", "a?b", "a/b", "/", "*", "**", "$*", "\x1b[2J", "a\n", "x" * 65, "@a", "\u0430"]


@pytest.fixture
def nameless(endpoint, bus):
    return Client.open(endpoint, timeout_s=30)


@pytest.mark.parametrize("name", BAD_NAMES)
async def test_an_id_that_is_none_is_refused_before_a_key_is_made_of_it(client, name: str) -> None:
    box = (1, 2, 30, 40)
    for ask in (
        lambda: client.request(box=box, id=name),
        lambda: client.cancel(name),
        lambda: client.update(name, box),
        lambda: client.result(name, timeout_s=5),
        lambda: anext(client.feedback(name)),
    ):
        with pytest.raises(RequestRefused, match="an id is 1 to 64") as told:
            await ask()
        assert (told.value.code, told.value.field) == ("invalid", "$.id")
        assert str(told.value).isprintable()


@pytest.mark.parametrize("name", BAD_NAMES)
async def test_a_rig_or_prefix_that_is_none_is_refused_before_a_key_is_made_of_it(endpoint, bus, name: str) -> None:
    async with Client.open(endpoint, rig=name) as other:
        for ask in (other.status, lambda: other.control("stop"), other.calibration, lambda: anext(other.watch())):
            with pytest.raises(RequestRefused, match="rig ") as told:
                await ask()
            assert str(told.value).isprintable()
    prefix = name if name != "a/b" else "a//b"
    if len(name) < 65:  # a prefix has no such limit
        async with Client.open(endpoint, prefix=prefix) as other:
            with pytest.raises(RequestRefused, match="prefix "):
                await other.rigs()


def test_good_names_are_taken() -> None:
    check_id("A.b_c-9")
    assert Keys("site/a", "hall").of_request("x", "result") == "site/a/hall/roi/x/result"


@pytest.mark.parametrize(
    ("fields", "field"),
    [
        ({"label": "x" * 9000}, "$"),
        ({"label": "x" * 65}, "$.label"),
        ({"label": "a\x1b[31m"}, "$.label"),
        ({"box": (float("nan"), 2, 30, 40)}, "$.box.x"),
        ({"fill": 3.0}, "$.fill"),
        ({"range_m": (-1.0, None)}, "$.range_m.min"),
    ],
)
async def test_a_request_that_would_be_refused_or_dropped_is_named_before_it_is_sent(
    core, client, fields, field
) -> None:
    with pytest.raises(RequestRefused) as told:
        await client.request(**{"box": (1, 2, 30, 40), **fields})
    assert told.value.field == field
    assert core.seen == []


async def test_watching_goes_on_over_garbage_on_every_key(bus, core, client, raw, caplog) -> None:
    caplog.set_level(logging.WARNING, logger="ptzd.bus")
    watching = client.watch()
    async with asyncio.timeout(60):
        await anext(watching)
        for payload in GARBAGE:
            for key in ("status", "pose", "roi/a/feedback", "roi/a/result"):
                raw.put(f"ptzd/hall/{key}", payload)
        raw.delete("ptzd/hall/status")
        raw.put("ptzd/hall/roi/a/feedback", b'{"id":"a","t_ns":1,"step":"after"}')
        async for notice in watching:
            if isinstance(notice, Feedback):
                break
        assert isinstance(await anext(watching), Status)
    await watching.aclose()
    assert 1 <= len(caplog.records) <= 4


async def test_pictures_go_on_over_garbage_beside_them(bus, client, raw) -> None:
    seen = asyncio.create_task(anext(client.images("fisheye")))
    async with asyncio.timeout(60):
        while not bus.image_wanted("image/fisheye"):
            await client.status()
        for payload in (*GARBAGE, None):
            raw.put("ptzd/hall/image/fisheye", b"\xff\xd8", attachment=payload)
        while not seen.done():
            bus.publish_image("image/fisheye", b"good", ImageAttachment(seq=1, t_capture_ns=2, w=3, h=4))
            await client.status()
    assert seen.result().jpeg == b"good"


async def test_a_result_comes_through_garbage_and_results_of_others(bus, core, client, raw, result) -> None:
    accepted = await client.request(box=(1, 2, 30, 40), id="mine")
    waiting = asyncio.create_task(client.result(accepted.id, timeout_s=60))
    for payload in GARBAGE:
        raw.put("ptzd/hall/roi/mine/result", payload)
        raw.put("ptzd/hall/roi/mine/feedback", payload)
    raw.put("ptzd/hall/roi/mine/result", b'{"id":"other","outcome":"locked","reason":"","elapsed_ms":1,"views":1}')
    bus.perform(result("mine"))
    assert (await waiting).id == "mine"


async def test_garbage_beside_the_daemon_s_answer_is_passed_over(bus, core, client, raw) -> None:
    answers = [
        raw.declare_queryable("ptzd/hall/**", Callback(_answering(payload), indirect=False)) for payload in GARBAGE
    ]
    assert (await client.status()).state == "STARTING"
    assert await client.control("hold") == "hold done"
    for answer in answers:
        answer.undeclare()


def _answering(payload: bytes):
    def answer(query) -> None:
        with query:
            query.reply(str(query.key_expr), payload, encoding=encoding("Status"))

    return answer


async def test_garbage_alone_is_named(endpoint, bus, client, raw) -> None:
    answer = raw.declare_queryable("ptzd/other/status", Callback(_answering(b"garbage"), indirect=False))
    async with Client.open(endpoint, rig="other") as other:
        with pytest.raises(BusError, match="no message of a ptzd"):
            await other.status()
    answer.undeclare()


async def test_tokens_without_a_rig_behind_them_keep_nobody_from_anything(core, raw, nameless, until_alive) -> None:
    tokens = [raw.liveliness().declare_token(f"ptzd/{name}/alive") for name in ("aaa", "zzz", "\x1b[2Jevil")]
    async with nameless as other:
        await until_alive(other, "zzz")
        assert "\x1b[2Jevil" not in await other.rigs()
        assert await other.control("stop") == "stop done"
        assert (await other.status()).state == "STARTING"
    assert [event.verb for event in core.seen if isinstance(event, ControlReceived)] == ["stop"]
    for token in tokens:
        token.undeclare()


async def test_one_who_claims_to_know_all_does_not_keep_the_stop_from_the_rig(core, raw, nameless) -> None:
    def claim(query) -> None:
        with query:
            query.reply("ptzd/hall/control/stop", msgspec.json.encode({"outcome": "stopped"}))

    rogue = raw.declare_queryable("ptzd/**", Callback(claim, indirect=False), complete=True)
    async with nameless as other:
        await other.control("stop")
    (event,) = await core.until(1)
    assert event.verb == "stop"
    rogue.undeclare()
