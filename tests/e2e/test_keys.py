"""Everything the real daemon publishes and answers, heard by a bare Zenoh session: it is what the schemas say."""

from __future__ import annotations

import asyncio

import jsonschema
import msgspec
import pytest
import zenoh
from zenoh.handlers import Callback

from ptzd.bus.asking import ask
from ptzd.bus.messages import IMAGE_ENCODING, MESSAGES, PUBLISHED, encoding, schema
from ptzd.bus.messages import Calibration as CalibrationMessage

RIG = "ptzd/demo/"


def check(message: type, document: object) -> None:
    """Decodes, fits the printed schema, and has no field that the message does not document."""
    payload = msgspec.json.encode(document)
    msgspec.json.decode(payload, type=message)
    jsonschema.Draft202012Validator(schema(message.__name__)).validate(document)
    assert set(document) <= set(message.__struct_fields__), message.__name__


def documented(key: str) -> str:
    """The entry of the table that a key belongs to."""
    return next(name for name in PUBLISHED if zenoh.KeyExpr(RIG + name).includes(zenoh.KeyExpr(key)))


@pytest.fixture
def everything(site):
    """Samples of every key below the rig."""
    samples: list[zenoh.Sample] = []
    heard = site.client._session.declare_subscriber(RIG + "**", Callback(samples.append, indirect=False))
    yield samples
    heard.undeclare()


async def test_every_published_key_is_what_its_schema_says(site, everything) -> None:
    await site.lock("walk-1", hold_s=3.0)
    await site.until(lambda: {documented(str(sample.key_expr)) for sample in list(everything)} == set(PUBLISHED))
    for sample in list(everything):
        key = str(sample.key_expr)
        message = PUBLISHED[documented(key)]
        if "/image/" in key:
            assert sample.encoding == zenoh.Encoding(IMAGE_ENCODING)
            assert sample.payload.to_bytes().startswith(b"\xff\xd8")
            check(message, msgspec.json.decode(sample.attachment.to_bytes()))
        else:
            assert sample.encoding == zenoh.Encoding(encoding(message.__name__))
            check(message, msgspec.json.decode(sample.payload.to_bytes()))


async def test_the_projects_client_reads_every_picture(site, everything) -> None:
    async def first(name: str):
        return await anext(site.client.images(name))

    waiting = [asyncio.create_task(first(name)) for name in ("fisheye", "ptz", "overlay")]
    await site.lock("walk-2")
    async with asyncio.timeout(60):
        fisheye, ptz, overlay = await asyncio.gather(*waiting)
    assert fisheye.attachment.pan_deg is None
    assert None not in (ptz.attachment.pan_deg, ptz.attachment.hfov_deg, ptz.attachment.moving)
    assert overlay.attachment.moving is False
    assert (overlay.attachment.w, overlay.attachment.h) == (ptz.attachment.w, ptz.attachment.h)


async def test_every_key_that_can_be_asked_is_answered_with_the_latest(site) -> None:
    await site.lock("walk-3")
    session = site.client._session
    for name, message in {**PUBLISHED, "calibration": CalibrationMessage, "log": MESSAGES["LogReply"]}.items():
        key = RIG + name.replace("*", "walk-3")
        if name == "roi/*/feedback":
            continue  # steps are told as they come, and nobody keeps them
        if name.startswith("image/"):
            (sample,) = await get(session, key)
            assert sample.payload.to_bytes().startswith(b"\xff\xd8")
            check(message, msgspec.json.decode(sample.attachment.to_bytes()))
        else:
            ((_, document),) = await ask(session, key, dict[str, object], 10.0)
            check(message, document)


async def get(session: zenoh.Session, key: str) -> list[zenoh.Sample]:
    loop, replies, ended = asyncio.get_running_loop(), [], asyncio.Event()
    session.get(key, Callback(replies.append, lambda: loop.call_soon_threadsafe(ended.set), indirect=False))
    await ended.wait()
    return [reply.ok for reply in replies]


async def test_a_stop_by_put_stops_the_head_by_the_truth(site) -> None:
    await site.request("walk-4", hold_s=60.0)
    await site.until_truth(lambda: site.moving)
    site.client._session.put(RIG + "control/stop", b"")
    result = await site.end_of("walk-4")
    assert result.outcome == "cancelled"
    await site.until_truth(lambda: not site.moving)
