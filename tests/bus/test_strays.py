"""No word under the rig's keys vanishes in silence, and none that is no word moves anything."""

from __future__ import annotations

import asyncio
import json
import threading

import pytest
import zenoh
from zenoh.handlers import Callback

from ptzd.control.events import CancelReceived, ControlReceived, PayloadRefused, RequestReceived, UpdateReceived, Verb

DONE = (CancelReceived, ControlReceived, RequestReceived, UpdateReceived)


@pytest.fixture
def get(raw):
    async def ask(key: str) -> list[dict[str, object]]:
        loop, replies, ended = asyncio.get_running_loop(), [], asyncio.Event()
        callback = Callback(replies.append, lambda: loop.call_soon_threadsafe(ended.set), indirect=False)
        raw.get(key, callback, target=zenoh.QueryTarget.ALL)
        await ended.wait()
        return [json.loads((reply.ok or reply.err).payload.to_bytes()) for reply in replies]

    return ask


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("control/STOP", "did you mean control/stop?"),
        ("control/stopp", "did you mean control/stop?"),
        ("control/hom", "did you mean control/home?"),
        ("control/stop/now", "there is no such key"),
        ("control", "control/stop"),
        ("control/xyzzy", "(there are control/goto, "),
        ("control/*", "spell out the one that is meant"),
        ("roi/gate-3/cancle", "did you mean roi/gate-3/cancel?"),
        ("roi/gate-3", "roi/<id>/cancel"),
        ("Roi", "did you mean roi?"),
        ("stop", "control/stop"),
        ("status", "there is no such key"),
        ("roi/gate-3/result", "roi/<id>/update"),
    ],
)
async def test_a_put_that_nobody_takes_is_told_with_what_there_is(core, raw, key: str, says: str):
    raw.put(f"ptzd/hall/{key}", b"")
    event = next(event for event in await core.until(1) if isinstance(event, PayloadRefused))
    assert (event.token, event.id, event.about) == (None, None, None)
    assert says in event.message
    assert "\n" not in event.message


@pytest.mark.parametrize(
    "key", ["control/stop", "control/STOP", "roi", "roi/gate-3/update", "roi/gate-3/cancel", "status"]
)
async def test_a_delete_is_told_and_does_nothing(core, raw, key: str):
    raw.delete(f"ptzd/hall/{key}")
    (event,) = await core.until(1)
    assert isinstance(event, PayloadRefused)
    assert event.message == f"ptzd/hall/{key}: a delete does nothing; put or query it instead"


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("ptzd/hall/control/bogus", "there are control/goto, "),
        ("ptzd/*/control/Stop", "did you mean control/stop?"),
        ("ptzd/hall/image/fish", "did you mean image/fisheye?"),
        ("ptzd/hall/roi/gate-3/feedback", "roi/<id>/result"),
        ("ptzd/hall/statsu", "did you mean status?"),
    ],
)
async def test_a_query_that_nobody_answers_is_refused_with_what_there_is(core, get, key: str, says: str):
    (told,) = await get(key)
    assert told["code"] == "unknown_key"
    assert says in told["message"]
    assert core.seen == []


@pytest.mark.parametrize(
    "key", ["ptzd/hall/**", "ptzd/**", "ptzd/hall/control/*", "ptzd/*/control/*", "**/control/**", "ptzd/hall/*"]
)
async def test_who_looks_around_is_told_of_no_error_and_moves_nothing(core, get, key: str):
    assert not [told for told in await get(key) if told.get("code") == "unknown_key"]
    assert not [event for event in core.seen if isinstance(event, DONE)]


async def test_what_is_known_is_answered_once_and_told_as_nothing_else(core, bus, raw, get, result):
    bus.perform(result("gate-3"))
    assert len(await get("ptzd/hall/status")) == 1
    assert len(await get("ptzd/hall/roi/gate-3/result")) == 1
    for number, verb in enumerate(Verb, 1):
        assert await get(f"ptzd/*/control/{verb}") == [{"outcome": f"{verb} done"}]
        assert len(core.seen) == number
    raw.put("ptzd/*/control/stop", b"")
    raw.put("ptzd/hall/roi/gate-3/cancel", b"")
    seen = await core.until(len(Verb) + 2)
    assert all(isinstance(event, ControlReceived | CancelReceived) for event in seen)


async def test_questions_for_nothing_wait_in_no_operator_s_lane(core, bus, raw, get):
    held = threading.Event()
    bus._replies._ordinary.put(object(), lambda query: held.wait(100))
    asked = asyncio.ensure_future(get("ptzd/hall/control/bogus"))
    assert await get("ptzd/hall/control/stop") == [{"outcome": "stop done"}]
    assert not asked.done()
    held.set()
    assert (await asked)[0]["code"] == "unknown_key"


async def test_a_long_key_is_shown_in_part(core, raw):
    raw.put(f"ptzd/hall/{'x' * 3000}", b"")
    (event,) = await core.until(1)
    assert len(event.message) < 700
