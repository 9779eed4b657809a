from __future__ import annotations

import asyncio
import threading

from ptzd.bus.mailbox import Mailbox


def from_thread(work) -> None:
    thread = threading.Thread(target=work)
    thread.start()
    thread.join()


async def test_a_blocked_loop_costs_only_the_oldest():
    mailbox: Mailbox[int] = Mailbox(asyncio.get_running_loop(), 64, evict=True)
    from_thread(lambda: [mailbox.push(i) for i in range(20_000)])
    assert await mailbox.take() == list(range(19_936, 20_000))
    assert mailbox.dropped == 19_936


async def test_a_full_box_turns_away():
    mailbox: Mailbox[int] = Mailbox(asyncio.get_running_loop(), 2, evict=False)
    assert [mailbox.push(i) for i in range(4)] == [True, True, False, False]
    assert await mailbox.take() == [0, 1]
    assert mailbox.push(9)
    assert await mailbox.take() == [9]
    assert mailbox.dropped == 2


async def test_everything_pushed_by_several_threads_is_taken_in_order():
    mailbox: Mailbox[tuple[int, int]] = Mailbox(asyncio.get_running_loop(), 100_000, evict=False)
    threads = [threading.Thread(target=lambda n=n: [mailbox.push((n, i)) for i in range(2000)]) for n in range(3)]
    for thread in threads:
        thread.start()
    taken: list[tuple[int, int]] = []
    while len(taken) < 6000:
        taken += await mailbox.take()
    for thread in threads:
        thread.join()
    assert [[i for n, i in taken if n == wanted] for wanted in range(3)] == [list(range(2000))] * 3


async def test_closing_lets_the_reader_go():
    mailbox: Mailbox[int] = Mailbox(asyncio.get_running_loop(), 4, evict=False)
    mailbox.push(1)
    waiting = asyncio.ensure_future(mailbox.take())
    assert await waiting == [1]
    waiting = asyncio.ensure_future(mailbox.take())
    from_thread(mailbox.close)
    assert await waiting == []
    assert not mailbox.push(2)


def test_a_push_after_the_loop_ended_is_harmless():
    loop = asyncio.new_event_loop()
    mailbox: Mailbox[int] = Mailbox(loop, 4, evict=False)
    loop.close()
    mailbox.push(1)
    assert not mailbox.push(2)
