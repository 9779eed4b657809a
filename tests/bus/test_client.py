from __future__ import annotations

import asyncio
import json

import pytest
from zenoh.handlers import Callback

from ptzd.bus import client as client_module
from ptzd.bus.client import Client
from ptzd.bus.fields import BoxPx
from ptzd.bus.messages import Feedback, RoiResult
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings
from ptzd.control.commands import PublishFeedback, ReplyAccepted
from ptzd.control.events import RequestReceived, UpdateReceived, ZoomWish
from ptzd.errors import BusError, RequestRefused
from ptzd.model import Box, FrameRef, Outcome
from ptzd.outgoing import Pose

PATIENCE_S = 100.0
BOX = (1.0, 2.0, 30.0, 40.0)


async def test_every_wish_arrives(core, client):
    accepted = await client.request(
        box=BOX,
        id="a",
        frame_seq=4,
        range_m=(1, None),
        zoom=12.5,
        fill=0.3,
        hold_s=2,
        timeout_s=8,
        priority=1,
        label="é",
    )
    assert (accepted.id, accepted.frame.seq, accepted.position) == ("a", 7, 0)
    (event,) = core.seen
    assert event == RequestReceived(
        token=event.token, id="a", box=Box(x=1, y=2, w=30, h=40), frame_seq=4,
        range_m=(1.0, float("inf")), zoom=ZoomWish.HFOV, hfov_deg=12.5, fill=0.3, hold_s=2, timeout_s=8, priority=1,
        label="é",
    )  # fmt: skip


async def test_ids_are_chosen_when_not_given(core, client):
    first, second = [await client.request(box=BoxPx(x=1, y=2, w=9, h=9)) for _ in range(2)]
    assert first.id != second.id


async def test_refusal_has_code_message_and_field(core, client):
    with pytest.raises(RequestRefused, match="8") as caught:
        await client.request(box=(1, 2, 3, 40), id="a")
    assert (caught.value.code, caught.value.field) == ("invalid", "$.box.w")
    assert client._following == {}


async def test_nothing_said_right_after_the_acceptance_is_missed(bus, client, result):
    async def pump() -> None:
        async for event in bus.events():
            frame = FrameRef(seq=1, t_capture_ns=2)
            bus.perform(ReplyAccepted(token=event.token, id=event.id, frame=frame, position=0))
            for index in range(20):
                bus.perform(PublishFeedback(id=event.id, step="view", detail={"index": index}))
            bus.perform(result(event.id))

    task = asyncio.ensure_future(pump())
    for _ in range(10):
        accepted = await client.request(box=BOX)
        steps = [step.detail["index"] async for step in client.feedback(accepted.id)]
        assert steps == list(range(20))
        assert (await client.result(accepted.id)).outcome is Outcome.LOCKED
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


async def test_another_client_finds_the_result_late(bus, client, result, endpoint):
    bus.perform(result("a"))
    async with Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as late:
        assert (await late.result("a")).id == "a"
        assert [step async for step in late.feedback("a")] == []


async def test_a_lost_result_is_asked_for_again(bus, client, result, monkeypatch):
    monkeypatch.setattr(client_module, "RESYNC_S", 0.02)
    waiting = asyncio.ensure_future(client.result("a"))
    await client.status()
    assert "a" in client._following
    # Published into the void: only the kept one is left.
    monkeypatch.setattr(bus, "_put", lambda *_: None)
    bus.perform(result("a"))
    assert (await waiting).id == "a"
    monkeypatch.undo()


async def test_no_result_in_time(bus, client):
    with pytest.raises(BusError, match=r"no result of a within 0\.05 s"):
        await client.result("a", timeout_s=0.05)


async def test_a_daemon_that_goes_away_is_noticed_while_waiting(endpoint, clock, monkeypatch):
    monkeypatch.setattr(client_module, "RESYNC_S", 0.02)
    bus = ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock)
    await bus.__aenter__()
    async with Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as client:
        waiting = asyncio.ensure_future(client.result("a"))
        await client.status()
        await bus.__aexit__(None, None, None)
        with pytest.raises(BusError, match="no ptzd answers on ptzd/hall/roi/a/result"):
            await waiting


async def test_update_reaches_the_core(core, client):
    await client.update("a", BOX, frame_t_capture_ns=9)
    (event,) = await core.until(1)
    box = Box(x=1, y=2, w=30, h=40)
    assert event == UpdateReceived(id="a", box=box, frame_t_capture_ns=9, told=True)


async def test_nobody_there_is_said(client, endpoint):
    async with Client.open(endpoint, rig="nowhere") as stranger:
        with pytest.raises(BusError, match="no ptzd answers on ptzd/nowhere/status: is the daemon running"):
            await stranger.status()
        with pytest.raises(BusError, match="no ptzd answers"):
            await stranger.request(box=BOX)


async def test_no_server_at_the_address(endpoint):
    with pytest.raises(BusError, match="cannot connect to tcp/127"):
        await Client.open(endpoint).__aenter__()


async def test_the_only_rig_needs_no_name(client, endpoint, clock, until_alive):
    async with Client.open(endpoint, timeout_s=PATIENCE_S) as guest:
        assert (await guest.status()).state == "STARTING"
    other = BusSettings(mode="client", listen=(), connect=(endpoint,))
    async with ZenohBus(other, "yard", clock), Client.open(endpoint, timeout_s=PATIENCE_S) as guest:
        await until_alive(guest, "yard")
        with pytest.raises(BusError, match="there are hall, yard; name one"):
            await guest.status()
    async with Client.open(endpoint, prefix="other") as guest:
        with pytest.raises(BusError, match="no rig is alive there"):
            await guest.status()


async def test_a_silent_daemon_is_told_from_an_absent_one(bus, client, endpoint):
    held = []
    queryable = bus._session.declare_queryable("ptzd/mute/status", Callback(held.append, indirect=False), complete=True)
    async with Client.open(endpoint, rig="mute", timeout_s=0.1) as guest:
        with pytest.raises(BusError, match=r"did not answer on ptzd/mute/status within 0\.1 s"):
            await guest.status()
    queryable.undeclare()
    for query in held:
        query.drop()


async def test_gibberish_from_the_other_side_is_a_bus_error(bus, client, endpoint):
    def gibber(query) -> None:
        with query:
            query.reply("ptzd/odd/status", b'{"state": 3}')

    queryable = bus._session.declare_queryable("ptzd/odd/status", Callback(gibber, indirect=False), complete=True)
    async with Client.open(endpoint, rig="odd", timeout_s=PATIENCE_S) as guest:
        with pytest.raises(BusError, match="no message of a ptzd of this version"):
            await guest.status()
    queryable.undeclare()


async def test_watch_tells_everything(bus, client, raw, result):
    seen: dict[type, object] = {}
    watching = client.watch()
    first = asyncio.ensure_future(anext(watching))
    await asyncio.sleep(0)  # it declares in its first step
    await client.status()
    bus.publish_pose(Pose(t_ns=1, pan_deg=2.0, tilt_deg=3.0, zoom=1.0, moving=False, motion="stable"))
    bus.perform(PublishFeedback(id="a", step="state", detail={"state": "SCAN"}))
    bus.perform(result("a"))
    notice = await first
    while True:
        seen[type(notice)] = notice
        if {Pose, Feedback, RoiResult} <= seen.keys():
            break
        notice = await anext(watching)
    await watching.aclose()
    assert seen[Pose].pan_deg == 2.0
    assert seen[Feedback].detail == {"state": "SCAN"}
    assert json.loads(json.dumps(seen[RoiResult].outcome)) == "locked"


async def test_ended_requests_are_remembered_within_bounds(bus, client, result, monkeypatch):
    monkeypatch.setattr(client_module, "ENDED_KEPT", 2)
    for index in range(6):
        bus.perform(result(f"r{index}"))
        await client.result(f"r{index}")
    assert sorted(client._following) == ["r3", "r4", "r5"]
