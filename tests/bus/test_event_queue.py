from __future__ import annotations

import pytest

from ptzd.bus.event_queue import PLACES, REQUESTS, URGENT, EventQueue
from ptzd.control.events import (
    CancelReceived,
    ControlReceived,
    Event,
    GotoAsked,
    PatrolAsked,
    PatrolWish,
    PayloadRefused,
    UpdateReceived,
    Verb,
)
from ptzd.model import Box


def refusal(n: int) -> PayloadRefused:
    return PayloadRefused(token=None, code="invalid", message=str(n), field="$")


def update(n: int, request_id: str) -> UpdateReceived:
    return UpdateReceived(id=request_id, box=Box(x=n, y=0, w=9, h=9))


async def drained(queue: EventQueue) -> list[Event]:
    queue.close()
    return [event async for event in queue]


async def test_a_flood_leaves_room_for_the_operator():
    queue = EventQueue(lambda _: True)
    assert [queue.offer(refusal(n)) for n in range(REQUESTS + 1)] == [True] * REQUESTS + [False]
    stop = ControlReceived(token=1, verb=Verb.STOP)
    assert [queue.offer(stop) for _ in range(URGENT + 1)] == [True] * URGENT + [False]
    assert not queue.offer(refusal(0))
    events = await drained(queue)
    assert events[:URGENT] == [stop] * URGENT
    assert events[URGENT:] == [refusal(n) for n in range(REQUESTS)]


async def test_an_operators_place_finds_room_behind_a_flood_and_leaves_some_for_cancels():
    queue = EventQueue(lambda _: True)
    for n in range(REQUESTS):
        queue.offer(refusal(n))
    goto = GotoAsked(token=1, place="gate")
    assert [queue.offer(goto) for _ in range(PLACES + 1)] == [True] * PLACES + [False]
    assert not queue.offer(PatrolAsked(token=2, wish=PatrolWish.START, patrol="night"))
    assert queue.offer(CancelReceived(token=3, id="a"))
    assert queue.withdraw_requests() == [goto] * PLACES


async def test_a_cancel_finds_room_and_stays_behind_the_request_that_it_takes_back():
    queue = EventQueue(lambda _: True)
    for n in range(REQUESTS):
        queue.offer(refusal(n))
    cancel = CancelReceived(token=1, id="a")
    assert queue.offer(cancel)
    assert (await drained(queue))[-1] == cancel


async def test_only_the_newest_update_of_a_request_waits():
    queue = EventQueue(lambda _: True)
    cancel = CancelReceived(token=1, id="b")
    for event in (update(1, "a"), update(2, "b"), update(3, "a"), cancel):
        assert queue.offer(event)
    assert await drained(queue) == [update(2, "b"), update(3, "a"), cancel]


async def test_what_is_no_longer_wanted_is_skipped_when_taken():
    unwanted: list[Event] = []
    queue = EventQueue(lambda event: event not in unwanted)
    for n in range(4):
        queue.offer(refusal(n))
    unwanted += [refusal(1), refusal(2)]
    assert await drained(queue) == [refusal(0), refusal(3)]


async def test_a_fault_reaches_the_reader_after_what_was_waiting():
    queue = EventQueue(lambda _: True)
    queue.offer(refusal(1))
    queue.close(ZeroDivisionError("a fault"))
    events = aiter(queue)
    assert await anext(events) == refusal(1)
    with pytest.raises(ZeroDivisionError, match="a fault"):
        await anext(events)
    assert not queue.offer(refusal(2))
