"""Every refusal of the bus contract over a real session: a clear answer, nothing lost, nothing moved."""

from __future__ import annotations

import asyncio
import json

import pytest

from ptzd.errors import BusError, RequestRefused

BOX = {"x": 239.0, "y": 201.0, "w": 36.0, "h": 30.0}
REFUSED = {
    "not JSON": (b"{box", "not_json", "$"),
    "not UTF-8": (b'{"id": "\xff"}', "not_json", "$"),
    "no object": (b"[1, 2]", "invalid", "$"),
    "an unknown field": ({"id": "a", "box": BOX, "colour": 1}, "invalid", "$.colour"),
    "an unknown field of the box": ({"id": "a", "box": {**BOX, "z": 1}}, "invalid", "$.box.z"),
    "a missing field": ({"id": "a"}, "invalid", "$.box"),
    "a wrong type": ({"id": "a", "box": {**BOX, "x": "12"}}, "invalid", "$.box.x"),
    "NaN": (json.dumps({"id": "a", "box": {**BOX, "w": float("nan")}}).encode(), "invalid", "$.box.w"),
    "infinity": (json.dumps({"id": "a", "box": {**BOX, "x": float("inf")}}).encode(), "invalid", "$.box.x"),
    "a box outside": ({"id": "a", "box": {**BOX, "x": 630}}, "outside", "$.box.x"),
    "a box above": ({"id": "a", "box": {**BOX, "y": -4}}, "outside", "$.box.y"),
    "a box outside the image circle": ({"id": "a", "box": {"x": 0, "y": 0, "w": 10, "h": 10}}, "outside", "$.box"),
    "a box too small": ({"id": "a", "box": {**BOX, "h": 7.5}}, "invalid", "$.box.h"),
    "a frame too old": ({"id": "a", "box": BOX, "frame": {"t_capture_ns": 1}}, "stale_frame", "$.frame"),
    "a frame never seen": ({"id": "a", "box": BOX, "frame": {"seq": 10**9}}, "stale_frame", "$.frame"),
    "a frame named twice": ({"id": "a", "box": BOX, "frame": {"seq": 1, "t_capture_ns": 1}}, "invalid", "$.frame"),
    "an id with a slash": ({"id": "a/b", "box": BOX}, "invalid", "$.id"),
    "an id too long": ({"id": "a" * 65, "box": BOX}, "invalid", "$.id"),
    "a label too long": ({"id": "a", "box": BOX, "label": "x" * 65}, "invalid", "$.label"),
    "a priority too high": ({"id": "a", "box": BOX, "priority": 10}, "invalid", "$.priority"),
    "a fill too large": ({"id": "a", "box": BOX, "fill": 0.99}, "invalid", "$.fill"),
    "a range the wrong way round": ({"id": "a", "box": BOX, "range_m": {"min": 5, "max": 2}}, "invalid", "$.range_m"),
    "no time": ({"id": "a", "box": BOX, "timeout_s": 0}, "invalid", "$.timeout_s"),
    "a field of view nobody has": ({"id": "a", "box": BOX, "zoom": {"hfov_deg": 150}}, "invalid", "$.zoom"),
    "an unknown zoom": ({"id": "a", "box": BOX, "zoom": "max"}, "invalid", "$.zoom"),
}


async def ask(site, payload: bytes, key: str = "roi") -> list[dict[str, object]]:
    """Error replies of a raw query."""
    session = site.client._session
    replies = await asyncio.to_thread(lambda: list(session.get(f"ptzd/demo/{key}", payload=payload, timeout=2.0)))
    assert all(reply.ok is None for reply in replies)
    return [json.loads(reply.err.payload.to_bytes()) for reply in replies if "ptzd" in str(reply.err.encoding)]


async def test_every_refusal_names_its_field_and_moves_nothing(site) -> None:
    await site.until_truth(lambda: not site.moving)
    orders = site.orders
    for what, (payload, code, field) in REFUSED.items():
        raw = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        (error,) = await ask(site, raw)
        assert error["code"] == code, what
        assert error["field"].startswith(field), what
        assert error["message"], what
        assert "\n" not in error["message"], what
    with pytest.raises(RequestRefused) as unknown:
        await site.client.cancel("nobody")
    assert unknown.value.code == "unknown_id"
    assert (await site.client.status()).state == "IDLE"
    assert site.results == []
    assert site.orders == orders
    await site.lock("a")


async def test_a_megabyte_is_dropped_before_it_is_read(site) -> None:
    orders = site.orders
    monster = json.dumps({"id": "big", "box": BOX, "label": "x" * 1_000_000}).encode()
    assert await ask(site, monster) == []
    site.client._session.put("ptzd/demo/roi", monster)
    with pytest.raises((RequestRefused, BusError)):
        await site.client.request(box=site.box, id="big2", label="x" * 9000)
    assert (await site.client.status()).state == "IDLE"
    assert (site.results, site.orders) == ([], orders)
    await site.lock("small")


async def test_a_put_that_is_refused_has_a_result_when_it_has_an_id(site) -> None:
    orders, put = site.orders, site.client._session.put
    put("ptzd/demo/roi", json.dumps({"id": "wrong", "box": BOX, "colour": 1}).encode())
    put("ptzd/demo/roi", json.dumps({"id": "old", "box": BOX, "frame": {"seq": 10**9}}).encode())
    put("ptzd/demo/roi", b"nonsense")
    rejected, stale = await site.end_of("wrong"), await site.end_of("old")
    assert rejected.outcome == "rejected"
    assert "$.colour" in rejected.reason
    assert stale.outcome == "stale_frame"
    assert site.orders == orders
    site.asked.append("put")
    put("ptzd/demo/roi", json.dumps({"id": "put", "box": BOX, "hold_s": 0}).encode())
    assert (await site.end_of("put")).outcome == "locked"
    assert len(site.results) == 3


async def test_a_full_queue_says_busy(make_site) -> None:
    site = await make_site()
    site.change(queue={"size": 1})
    await site.start()
    await site.request("first", hold_s=60.0)
    await site.request("second")
    with pytest.raises(RequestRefused) as busy:
        await site.client.request(box=site.box, id="third")
    assert busy.value.code == "busy"
    assert await site.client.control("stop") == "stopped"
    assert {(await site.end_of(name)).outcome for name in ("first", "second")} == {"cancelled"}
