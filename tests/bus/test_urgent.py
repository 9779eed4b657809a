"""What an operator says goes first and stays true, whatever others do to the bus."""

from __future__ import annotations

import asyncio
import json
import threading

import pytest
import zenoh
from zenoh.handlers import Callback

from ptzd.bus import answers, event_queue, replies
from ptzd.bus.replies import Replies
from ptzd.control.commands import ReplyRefused
from ptzd.control.events import ControlReceived, GotoAsked, PayloadRefused, RequestReceived, Verb

PATIENCE_S = 100.0


class Heard:
    """Replies to one question."""

    def __init__(self, session: zenoh.Session, key: str, payload: bytes | None = None) -> None:
        self.documents: list[dict[str, object]] = []
        self.ended = threading.Event()
        callback = Callback(self._hear, self.ended.set, indirect=False)
        session.get(key, callback, payload=payload, timeout=PATIENCE_S, target=zenoh.QueryTarget.ALL)

    def _hear(self, reply: zenoh.Reply) -> None:
        self.documents.append(json.loads((reply.ok or reply.err).payload.to_bytes()))

    async def all(self) -> list[dict[str, object]]:
        assert await asyncio.to_thread(self.ended.wait, PATIENCE_S)
        return self.documents


def request(name: str) -> bytes:
    return json.dumps({"id": name, "box": {"x": 1, "y": 2, "w": 9, "h": 9}}).encode()


async def until(condition) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110
            await asyncio.sleep(0.005)


@pytest.mark.parametrize("verb", [Verb.STOP, Verb.HOME])
async def test_a_stop_goes_first_and_what_waited_before_it_moves_nothing_after_it(bus, raw, verb):
    waiting = [Heard(raw, "ptzd/hall/roi", request(f"r{n}")) for n in range(20)]
    waiting.append(Heard(raw, "ptzd/hall/control/goto", b'{"place":"gate"}'))
    await until(lambda: len(bus._events._events) == 21)
    stop = Heard(raw, f"ptzd/hall/control/{verb}")
    await until(lambda: len(bus._events._urgent) == 1)
    events = bus.events()
    first = await anext(events)
    assert isinstance(first, ControlReceived)
    rest = [await anext(events) for _ in range(21)]
    assert all(isinstance(event, PayloadRefused) and event.code == "stopped" for event in rest)
    assert {event.id for event in rest} == {*(f"r{n}" for n in range(20)), None}
    later = Heard(raw, "ptzd/hall/roi", request("later"))
    assert isinstance(await anext(events), RequestReceived)
    await events.aclose()
    for event in (first, *rest):
        bus._pending.refuse(event.token, replies.ErrorReply(code="done", message="done"))
    assert [(await heard.all())[0]["code"] for heard in (stop, *waiting)] == ["done"] * 22
    del later


@pytest.mark.parametrize("payload", [b'{"hard":1}', b"ON", b"x" * 9000])
@pytest.mark.parametrize("verb", [Verb.STOP, Verb.HOME])
async def test_a_verb_that_is_refused_takes_nothing_away(bus, raw, verb, payload):
    waiting = [Heard(raw, "ptzd/hall/roi", request(f"r{n}")) for n in range(3)]
    waiting.append(Heard(raw, "ptzd/hall/control/goto", b'{"place":"gate"}'))
    await until(lambda: len(bus._events._events) == 4)
    raw.put(f"ptzd/hall/control/{verb}", payload)
    await until(lambda: len(bus._events._events) == 5)
    last = Heard(raw, "ptzd/hall/roi", request("after"))
    await until(lambda: len(bus._events._events) == 6)
    kinds = [type(event) for event in bus._events._events]
    assert kinds == [*[RequestReceived] * 3, GotoAsked, PayloadRefused, RequestReceived]
    del waiting, last


async def test_a_stop_for_which_there_is_no_room_takes_nothing_away(bus, raw, monkeypatch):
    waiting = Heard(raw, "ptzd/hall/roi", request("first"))
    await until(lambda: len(bus._events._events) == 1)
    monkeypatch.setattr(event_queue, "URGENT", 0)
    assert (await Heard(raw, "ptzd/hall/control/stop").all())[0]["code"] == "busy"
    assert isinstance(bus._events._events[0], RequestReceived)
    del waiting


@pytest.mark.parametrize("verb", [Verb.HOLD, Verb.RELEASE])
async def test_verbs_that_stop_nothing_take_no_request_away(bus, raw, verb):
    Heard(raw, "ptzd/hall/roi", request("a"))
    await until(lambda: len(bus._events._events) == 1)
    Heard(raw, f"ptzd/hall/control/{verb}")
    await until(lambda: len(bus._events._urgent) == 1)
    events = bus.events()
    assert isinstance(await anext(events), ControlReceived)
    assert isinstance(await anext(events), RequestReceived)
    await events.aclose()


async def test_an_operator_hears_that_his_word_was_sent_when_it_takes_longer(bus, raw, monkeypatch):
    monkeypatch.setattr(bus._pending, "_answer_within_s", 0.05)
    (answer,) = await Heard(raw, "ptzd/hall/control/stop").all()
    assert answer["code"] == "unconfirmed"
    assert answer["message"].startswith("stop sent, not confirmed yet within 0.05 s")
    events = bus.events()
    assert isinstance(await anext(events), ControlReceived), "it takes effect all the same"
    await events.aclose()


async def test_an_arrival_may_take_longer_than_any_other_answer(bus, raw, monkeypatch):
    monkeypatch.setattr(bus._pending, "_answer_within_s", 0.05)
    heard = Heard(raw, "ptzd/hall/control/goto", b'{"place":"gate"}')
    assert (await Heard(raw, "ptzd/hall/control/stop").all())[0]["code"] == "unconfirmed"
    assert not heard.ended.is_set()
    events = bus.events()
    found = [await anext(events), await anext(events)]
    token = next(event.token for event in found if not isinstance(event, ControlReceived))
    await events.aclose()
    bus.perform(ReplyRefused(token=token, code="preempted", message="desk has taken the head", field="$.place"))
    assert (await heard.all())[0]["code"] == "preempted"


async def test_a_wildcard_is_answered_with_the_newest_and_few_may_ask_at_once(bus, raw, result, monkeypatch):
    monkeypatch.setattr(answers, "MOST_RESULTS", 30)
    monkeypatch.setattr(answers, "LOOKERS", 2)
    for number in range(100):
        bus.perform(result(f"r{number}"))
    found = await Heard(raw, "ptzd/hall/roi/*/result").all()
    assert {item["id"] for item in found} == {f"r{number}" for number in range(70, 100)}
    assert len(found) == 30
    held = threading.Event()
    bus._replies._ordinary.put(object(), lambda query: held.wait(PATIENCE_S))
    asked = [Heard(raw, "ptzd/hall/roi/*/result") for _ in range(5)]
    await until(lambda: bus._replies._ordinary.waiting >= 5)
    held.set()
    codes = [(await heard.all())[0].get("code") for heard in asked]
    assert codes.count("busy") == 3


async def test_an_asker_that_does_not_read_holds_neither_loop_nor_operator(bus, raw, core):
    held = threading.Event()
    bus._replies._ordinary.put(object(), lambda query: held.wait(PATIENCE_S))
    status = Heard(raw, "ptzd/hall/status")
    await until(lambda: bus._replies._ordinary.waiting >= 1)
    assert (await Heard(raw, "ptzd/hall/control/stop").all())[0]["outcome"]
    assert not status.ended.is_set()
    held.set()
    assert (await status.all())[0]["state"]


async def test_when_too_many_answers_wait_questions_are_turned_away_at_the_door(bus, raw, core, monkeypatch):
    monkeypatch.setattr(replies, "CROWDED", 3)
    held = threading.Event()
    for _ in range(5):
        bus._replies._ordinary.put(object(), lambda query: held.wait(PATIENCE_S))
    assert (await Heard(raw, "ptzd/hall/status").all())[0]["code"] == "busy"
    assert (await Heard(raw, "ptzd/hall/control/stop").all())[0]["outcome"]
    held.set()


def test_closing_sends_what_waits():
    made, sent = Replies(), []
    for number in range(20):
        made._ordinary.put(object(), lambda query, number=number: sent.append(number))
    made.close()
    assert sent == list(range(20))
