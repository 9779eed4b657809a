"""What a program that can only put gets done, and what one that can only query is answered."""

from __future__ import annotations

import asyncio
import json

import msgspec
import pytest
import zenoh
from zenoh.handlers import Callback

from ptzd.bus.messages import IMAGE_ENCODING, UpdateReply
from ptzd.control.commands import PublishStatus, ReplyOutcome
from ptzd.control.events import CancelReceived, ControlReceived, PayloadRefused, UpdateReceived, Verb
from ptzd.model import GotoShown
from ptzd.outgoing import ImageAttachment, Pose

BOX = b'{"box":{"x":1,"y":2,"w":30,"h":40}}'


@pytest.fixture
def get(raw):
    async def ask(key: str, payload: bytes | None = None) -> list[zenoh.Reply]:
        loop, replies, ended = asyncio.get_running_loop(), [], asyncio.Event()
        end = Callback(replies.append, lambda: loop.call_soon_threadsafe(ended.set), indirect=False)
        raw.get(key, end, payload=payload)
        await ended.wait()
        return replies

    return ask


@pytest.mark.parametrize("payload", [b"", b"{}"])
@pytest.mark.parametrize("key", ["ptzd/hall/control", "ptzd/*/control"])
async def test_every_verb_by_put(core, raw, key: str, payload: bytes) -> None:
    for number, verb in enumerate(Verb, 1):
        raw.put(f"{key}/{verb}", payload)
        event = (await core.until(number))[-1]
        assert (type(event), event.token, event.verb) == (ControlReceived, None, verb)


async def test_a_put_that_looks_around_moves_nothing(core, raw) -> None:
    raw.put("ptzd/hall/**", b"")
    raw.put("ptzd/hall/control/*", b"")
    raw.put("ptzd/hall/control/hold", b"")
    async with asyncio.timeout(60):
        while not any(isinstance(event, ControlReceived) for event in core.seen):
            await core.until(len(core.seen) + 1)
    assert [event.verb for event in core.seen if isinstance(event, ControlReceived)] == [Verb.HOLD]
    assert not [event for event in core.seen if isinstance(event, CancelReceived | UpdateReceived)]


async def test_cancel_by_put(core, raw) -> None:
    raw.put("ptzd/hall/roi/gate-3/cancel", b"")
    (event,) = await core.until(1)
    assert (type(event), event.token, event.id) == (CancelReceived, None, "gate-3")


async def test_update_by_query_is_answered(core, get) -> None:
    (reply,) = await get("ptzd/hall/roi/gate-3/update", BOX)
    assert reply.ok.encoding == zenoh.Encoding("application/json;ptzd.UpdateReply.v1")
    assert json.loads(reply.ok.payload.to_bytes()) == {"outcome": "updated"}
    assert UpdateReply(outcome="updated").outcome == "updated"
    (event,) = core.seen
    assert isinstance(event, UpdateReceived)
    assert event.told


async def test_updates_by_query_are_answered_one_by_one(core, get) -> None:
    """Of puts only the newest waits; whoever asks is answered all the same."""
    replies = await asyncio.gather(*(get("ptzd/hall/roi/gate-3/update", BOX) for _ in range(20)))
    assert [reply.ok is not None for (reply,) in replies] == [True] * 20


@pytest.mark.parametrize(
    ("key", "payload", "about"),
    [
        ("roi/gate-3/update", b"{bad", "gate-3"),
        ("roi/gate-3/update", b'{"box":{"x":1,"y":2,"w":-3,"h":4}}', "gate-3"),
        ("roi/gate-3/update", b"x" * 9000, "gate-3"),
        ("roi/gate-3/cancel", b'{"why":1}', "gate-3"),
        ("roi/ü/update", BOX, None),
        ("roi/ü/cancel", b"", None),
        ("control/stop", b'{"now":true}', None),
        ("control/home", b"PRESS", None),
        ("control/home", b"x" * 9000, None),
        ("roi", b"\xff\xfe", None),
    ],
)
async def test_a_put_that_is_no_message_is_told_to_the_core_with_the_request_it_is_about(
    core, raw, key: str, payload: bytes, about: str | None
) -> None:
    raw.put(f"ptzd/hall/{key}", payload)
    (event,) = await core.until(1)
    assert isinstance(event, PayloadRefused)
    assert (event.token, event.id, event.about) == (None, None, about)


@pytest.mark.parametrize(
    ("active", "goto", "said"),
    [
        (None, None, "hold: nothing is locked; "),
        ("gate-3", None, "hold"),
        (None, GotoShown(place="gate", by="", since_ns=1), "hold"),
    ],
)
async def test_a_hold_says_when_there_is_nothing_to_hold(bus, get, active, goto, said) -> None:
    bus.perform(
        PublishStatus(
            state="IDLE", active=active, phase="", queue=(), fisheye="well", ptz="well", held=False, goto=goto
        )
    )
    asked = asyncio.ensure_future(get("ptzd/hall/control/hold"))
    events = bus.events()
    event = await anext(events)
    bus.perform(ReplyOutcome(token=event.token, outcome="hold"))
    await events.aclose()
    (reply,) = await asked
    told = json.loads(reply.ok.payload.to_bytes())["outcome"]
    assert told.startswith(said)
    assert (told == "hold") == (said == "hold")


async def test_the_pose_is_answered_with_the_latest(core, bus, get) -> None:
    (reply,) = await get("ptzd/hall/pose")
    assert json.loads(reply.err.payload.to_bytes())["code"] == "unavailable"
    for pan in (1.0, 2.0):
        bus.publish_pose(Pose(t_ns=5, pan_deg=pan, tilt_deg=0.0, zoom=1.0, moving=False, motion="stable"))
    (reply,) = await get("ptzd/hall/pose")
    assert _decoded(reply.ok.payload.to_bytes(), Pose).pan_deg == 2.0


@pytest.mark.parametrize("key", ["image/fisheye", "image/ptz", "image/overlay"])
async def test_a_picture_is_answered_with_what_it_shows(core, bus, get, key: str) -> None:
    (reply,) = await get(f"ptzd/hall/{key}")
    assert json.loads(reply.err.payload.to_bytes())["code"] == "unavailable"

    async def newest(asked: str):
        return asked.encode(), ImageAttachment(seq=3, t_capture_ns=4, w=640, h=480)

    bus.on_image_query(newest)
    (reply,) = await get(f"ptzd/hall/{key}")
    assert reply.ok.payload.to_bytes() == key.encode()
    assert reply.ok.encoding == zenoh.Encoding(IMAGE_ENCODING)
    assert _decoded(reply.ok.attachment.to_bytes(), ImageAttachment).seq == 3
    assert [reply for reply in await get("ptzd/hall/**") if reply.ok and "image" in str(reply.ok.key_expr)] == []


def _decoded(payload: bytes, message: type):
    return msgspec.json.decode(payload, type=message)
