from __future__ import annotations

import asyncio
import json
import threading

import pytest
import zenoh
from zenoh.handlers import Callback

from ptzd.bus.client import Client
from ptzd.bus.messages import ErrorReply, LogReference, encoding
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings
from ptzd.control.commands import PublishFeedback, ReplyAccepted, StopHead
from ptzd.control.events import CancelReceived, ControlReceived, PayloadRefused, RequestReceived, UpdateReceived, Verb
from ptzd.errors import BusError, LogError
from ptzd.model import Box, FrameRef, Outcome
from ptzd.outgoing import Pose

GOOD = {"id": "a", "box": {"x": 1, "y": 2, "w": 9, "h": 9}}

REFUSAL = ErrorReply(code="enough", message="enough")

PATIENCE_S = 100.0
"""For anything that must happen; a loaded machine is slow, a hang is a failure."""


class Gathered:
    """Replies of one raw query."""

    def __init__(self) -> None:
        self.replies: list[zenoh.Reply] = []
        self.ended = threading.Event()

    async def wait(self) -> list[zenoh.Reply]:
        assert await asyncio.to_thread(self.ended.wait, PATIENCE_S)
        return self.replies

    async def document(self) -> dict[str, object]:
        """The only reply, error or not."""
        (reply,) = await self.wait()
        return json.loads((reply.ok or reply.err).payload.to_bytes())


def ask(session: zenoh.Session, key: str, payload: bytes | None = None, timeout_s: float = PATIENCE_S) -> Gathered:
    gathered = Gathered()
    callback = Callback(gathered.replies.append, gathered.ended.set, indirect=False)
    session.get(key, callback, payload=payload, timeout=timeout_s, target=zenoh.QueryTarget.ALL)
    return gathered


def put(session: zenoh.Session, key: str, payload: bytes) -> None:
    """A message that a busy link does not drop."""
    session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)


def body(**changes: object) -> bytes:
    return json.dumps({**GOOD, **changes}).encode()


async def test_query_is_told_to_the_core_and_accepted(core, raw):
    gathered = ask(raw, "ptzd/hall/roi", body(priority=3))
    (reply,) = await gathered.wait()
    assert json.loads(reply.ok.payload.to_bytes()) == {"id": "a", "frame": {"seq": 7, "t_capture_ns": 8}}
    assert str(reply.ok.encoding) == encoding("Accepted")
    (event,) = core.seen
    assert isinstance(event, RequestReceived)
    assert (event.id, event.priority, event.box) == ("a", 3, Box(x=1.0, y=2.0, w=9.0, h=9.0))


@pytest.mark.parametrize(
    ("payload", "code", "field"),
    [
        (None, "not_json", "$"),
        (b"hello", "not_json", "$"),
        (b"[]", "invalid", "$"),
        (body(colour=1), "invalid", "$.colour"),
        (body(box={"x": 1, "y": 2, "w": 7, "h": 9}), "invalid", "$.box.w"),
        (body(box={"x": 1, "y": 2, "w": float("nan"), "h": 9}), "invalid", "$.box.w"),
    ],
)
async def test_refused_query_gets_code_and_path(core, raw, payload, code, field):
    (reply,) = await ask(raw, "ptzd/hall/roi", payload).wait()
    assert str(reply.err.encoding) == encoding("ErrorReply")
    error = json.loads(reply.err.payload.to_bytes())
    assert (error["code"], error.get("field", "$")) == (code, field)
    (event,) = core.seen
    assert isinstance(event, PayloadRefused)


async def test_put_is_an_event_without_a_token_and_a_refused_one_gets_its_result(core, raw, client):
    put(raw, "ptzd/hall/roi", body())
    put(raw, "ptzd/hall/roi", body(id="b", colour=1))
    put(raw, "ptzd/hall/roi/a/update", json.dumps({"box": GOOD["box"]}).encode())
    put(raw, "ptzd/hall/roi/a b/update", b"{}")
    events = await core.until(4)
    first, second, third = (e for e in events if "names no request" not in getattr(e, "message", ""))
    assert isinstance(first, RequestReceived | UpdateReceived)
    assert {type(first), type(third), type(second)} == {RequestReceived, PayloadRefused, UpdateReceived}
    assert all(getattr(event, "token", None) is None for event in events)
    assert (await client.result("b")).outcome is Outcome.REJECTED


async def test_a_megabyte_never_arrives(core, raw):
    for size in (70_000, 1_000_000):
        assert await ask(raw, "ptzd/hall/roi", b"x" * size, 0.3).wait() == []
        put(raw, "ptzd/hall/roi", b"x" * size)
    (reply,) = await ask(raw, "ptzd/hall/roi", body()).wait()
    assert reply.ok is not None
    assert len(core.seen) == 1


async def test_a_little_too_long_is_refused_by_name(core, raw):
    (reply,) = await ask(raw, "ptzd/hall/roi", b"x" * 9_000).wait()
    assert json.loads(reply.err.payload.to_bytes())["code"] == "too_large"


async def test_without_the_filter_a_megabyte_is_refused_unread(endpoint, clock, tmp_path):
    file = tmp_path / "no-filter.json5"
    file.write_text("{scouting: {multicast: {enabled: false}}}")
    settings = BusSettings(listen=(endpoint,), config_file=str(file))
    async with (
        ZenohBus(settings, "hall", clock) as bus,
        Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as client,
    ):
        raw = client._session
        error = await ask(raw, "ptzd/hall/roi", b"x" * 1_000_000).document()
        assert error["code"] == "too_large"
        put(raw, "ptzd/hall/roi", b"x" * 1_000_000)
        events = bus.events()
        for _ in range(2):
            event = await anext(events)
            assert isinstance(event, PayloadRefused)
            assert (event.code, event.token, event.id) == ("too_large", None, None)
        await events.aclose()


async def test_cancel_and_operator_verbs(core, client):
    assert await client.cancel("a") == "cancelled"
    for verb in Verb:
        assert await client.control(str(verb)) == f"{verb} done"
    assert [type(event) for event in core.seen] == [CancelReceived] + [ControlReceived] * 4
    assert [event.verb for event in core.seen[1:]] == list(Verb)


async def test_verbs_take_no_options(core, raw):
    assert (await ask(raw, "ptzd/hall/control/stop", b'{"really": true}').document())["field"] == "$.really"
    assert (await ask(raw, "ptzd/hall/control/stop", b"").document()) == {"outcome": "stop done"}
    assert (await ask(raw, "ptzd/hall/roi/a/cancel", b"x").document())["code"] == "not_json"


async def test_looking_around_moves_nothing_but_a_fleet_can_be_stopped(core, raw, client):
    await client.status()
    for key in ("ptzd/**", "ptzd/hall/control/*", "ptzd/hall/roi/*/cancel", "**"):
        assert all(reply.err is None or b"unavailable" in reply.err.payload.to_bytes()
                   for reply in await ask(raw, key).wait())  # fmt: skip
    assert core.seen == []
    assert (await ask(raw, "ptzd/*/control/stop").document()) == {"outcome": "stop done"}


async def test_a_query_the_core_forgets_is_told_internal_and_takes_no_effect(bus, raw, monkeypatch):
    monkeypatch.setattr(bus._pending, "_answer_within_s", 0.05)
    error = await ask(raw, "ptzd/hall/roi", body()).document()
    assert error["code"] == "internal"
    assert bus.counters()["expired"] == 1
    put(raw, "ptzd/hall/roi", body(id="later"))
    events = bus.events()
    assert (await anext(events)).id == "later"
    await events.aclose()
    bus.perform(ReplyAccepted(token=1, id="a", frame=FrameRef(seq=1, t_capture_ns=1), position=0))


async def test_five_thousand_requests_are_bounded_and_each_is_answered(bus, raw, client, monkeypatch):
    monkeypatch.setattr(bus._pending, "_answer_within_s", PATIENCE_S)
    flood = [ask(raw, "ptzd/hall/roi", body(id=f"r{n}")) for n in range(5000)]
    stop = ask(raw, "ptzd/hall/control/stop")
    events = bus.events()
    codes: list[str] = []

    async def oblige() -> None:
        async for event in events:
            if isinstance(event, ControlReceived):
                codes.append(event.verb)
            bus._pending.refuse(event.token, REFUSAL)

    # Nobody takes events yet: what comes in beyond the bounds is told to come back later.
    done = [await gathered.document() for gathered in flood[200:]]
    task = asyncio.ensure_future(oblige())
    done += [await gathered.document() for gathered in flood[:200]]
    await stop.wait()
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)
    assert {error["code"] for error in done} == {"busy", "enough"}
    assert sum(error["code"] == "enough" for error in done) <= 64
    assert codes == ["stop"]
    assert (await client.status()).state == "STARTING"


async def test_flood_of_puts_is_bounded_counted_and_told_once(bus, raw, client, caplog):
    for n in range(5000):
        put(raw, "ptzd/hall/roi", body(id=f"r{n}"))
        put(raw, f"ptzd/hall/roi/r{n % 3}/update", json.dumps({"box": GOOD["box"]}).encode())
    await client.status()
    assert len(bus._events._events) <= 64
    assert bus.counters()["dropped"] > 4000
    bus._tell_dropped()
    bus._tell_dropped()
    told = [record.getMessage() for record in caplog.records if "found no room" in record.getMessage()]
    assert len(told) == 1


async def test_result_is_published_kept_and_found_by_wildcard(bus, raw, client, result):
    heard: list[zenoh.Sample] = []
    came = threading.Event()
    subscriber = raw.declare_subscriber(
        "ptzd/hall/roi/*/result", Callback(lambda s: (heard.append(s), came.set()), indirect=False)
    )
    await client.status()
    bus.perform(result("a"))
    bus.perform(result("b", Outcome.NOT_FOUND))
    assert await asyncio.to_thread(came.wait, PATIENCE_S)
    document = json.loads(heard[0].payload.to_bytes())
    assert document["outcome"] == "locked"
    assert document["box_ptz"][1] == {"x": 3.0, "y": 2.0}
    assert str(heard[0].encoding) == encoding("RoiResult")
    assert heard[0].timestamp is not None
    assert (await client.result("a")).pan_deg == 1.5
    kept = await ask(raw, "ptzd/hall/roi/*/result").wait()
    assert {str(reply.ok.key_expr) for reply in kept} == {f"ptzd/hall/roi/{n}/result" for n in "ab"}
    assert (await ask(raw, "ptzd/hall/roi/c/result").document())["code"] == "unknown_id"
    subscriber.undeclare()


async def test_result_names_its_place_in_the_log(endpoint, clock, result):
    where = LogReference(file="a.mcap", t_ns=5)
    async with (
        ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock, log_reference=lambda: where) as bus,
        Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as client,
    ):
        bus.perform(result("a"))
        assert (await client.result("a")).log == where


async def test_results_are_forgotten_in_time(endpoint, clock, result):
    async with (
        ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock, results_kept_s=1e-9) as bus,
        Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as client,
    ):
        bus.perform(result("a"))
        assert (await ask(client._session, "ptzd/hall/roi/a/result").document())["code"] == "unknown_id"


async def test_calibration_and_log_queries(bus, raw, client):
    assert (await ask(raw, "ptzd/hall/calibration").document())["code"] == "unavailable"
    assert (await ask(raw, "ptzd/hall/log").document())["code"] == "unavailable"
    bus.set_calibration({"ptzd_calibration": 1, "fisheye": {"xi": 1.2}})
    assert (await client.calibration())["fisheye"] == {"xi": 1.2}
    asked: list[str] = []

    async def handler(action):
        asked.append(action)
        if len(asked) == 3:
            raise LogError("log: the disk is full")
        return ["a.mcap", "b.mcap"]

    bus.on_log_query(handler)
    assert await client.log_files() == ("a.mcap", "b.mcap")
    assert await client.log_files(rotate=True) == ("a.mcap", "b.mcap")
    assert (await ask(raw, "ptzd/hall/log").document())["message"] == "log: the disk is full"
    assert asked == ["list", "rotate", "list"]
    around = await ask(raw, "ptzd/hall/*", b'{"action":"rotate"}').wait()
    assert not any(reply.ok and str(reply.ok.key_expr).endswith("/log") for reply in around)
    assert len(asked) == 3
    assert (await ask(raw, "ptzd/hall/log", b'{"action":"erase"}').document())["field"] == "$.action"


async def test_pose_and_feedback_have_their_encodings(bus, raw, client):
    heard: dict[str, zenoh.Sample] = {}
    both = threading.Event()

    def receive(sample: zenoh.Sample) -> None:
        heard[str(sample.key_expr)] = sample
        if len(heard) == 2:
            both.set()

    subscribers = [raw.declare_subscriber(key, Callback(receive, indirect=False))
                   for key in ("ptzd/hall/pose", "ptzd/hall/roi/*/feedback")]  # fmt: skip
    await client.status()
    bus.publish_pose(Pose(t_ns=1, pan_deg=2.0, tilt_deg=3.0, zoom=1.0, moving=False, motion="stable"))
    bus.perform(PublishFeedback(id="a", step="view", detail={"index": 2, "certain": True}))
    assert await asyncio.to_thread(both.wait, PATIENCE_S)
    assert str(heard["ptzd/hall/pose"].encoding) == encoding("Pose")
    feedback = heard["ptzd/hall/roi/a/feedback"]
    assert str(feedback.encoding) == encoding("Feedback")
    assert json.loads(feedback.payload.to_bytes())["detail"] == {"index": 2, "certain": True}
    for subscriber in subscribers:
        subscriber.undeclare()


async def test_only_its_own_commands(bus):
    with pytest.raises(TypeError, match="StopHead"):
        bus.perform(StopHead())


async def test_rig_is_alive_exactly_while_open(bus, endpoint, clock, client, until_alive):
    assert await client.rigs() == ["hall"]
    gone = threading.Event()
    # in a session of its own: beside a subscriber to tokens, Zenoh's queries for tokens miss some
    async with Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as beside:
        watcher = beside._session.liveliness().declare_subscriber(
            "ptzd/*/alive",
            Callback(lambda s: gone.set() if s.kind == zenoh.SampleKind.DELETE else None, indirect=False),
        )
        other = BusSettings(mode="client", listen=(), connect=(endpoint,))
        async with ZenohBus(other, "yard", clock):
            await until_alive(client, "yard")
            assert await client.rigs() == ["hall", "yard"]
        assert await asyncio.to_thread(gone.wait, PATIENCE_S)
        watcher.undeclare()
    assert await client.rigs() == ["hall"]


async def test_closing_answers_who_waits_and_ends_the_events(endpoint, clock):
    async with Pair(endpoint, clock) as (bus, raw):
        gathered = ask(raw, "ptzd/hall/roi", body())
        events = bus.events()
        assert isinstance(await anext(events), RequestReceived)
        await bus.__aexit__(None, None, None)
        assert (await gathered.document())["code"] == "stopping"
        assert [event async for event in events] == []
        assert await ask(raw, "ptzd/hall/status", timeout_s=0.5).wait() == []


class Pair:
    """A bus that the test closes itself."""

    def __init__(self, endpoint, clock) -> None:
        self.bus = ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock)
        self.client = Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S)

    async def __aenter__(self):
        await self.bus.__aenter__()
        await self.client.__aenter__()
        return self.bus, self.client._session

    async def __aexit__(self, *_):
        await self.client.__aexit__(None, None, None)


async def test_port_in_use(bus, endpoint, clock):
    with pytest.raises(BusError, match="already in use"):
        await ZenohBus(BusSettings(listen=(endpoint,)), "other", clock).__aenter__()


async def test_failed_start_leaves_nothing_open(endpoint, clock, monkeypatch):
    def refuse(bus: ZenohBus) -> None:
        raise zenoh.ZError("no more keys")

    declare = ZenohBus._declare
    monkeypatch.setattr(ZenohBus, "_declare", refuse)
    with pytest.raises(zenoh.ZError):
        await ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock).__aenter__()
    monkeypatch.setattr(ZenohBus, "_declare", declare)
    async with ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock):
        pass
