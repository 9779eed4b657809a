from __future__ import annotations

import asyncio
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.runtime.notify import Notifier
from ptzd.runtime.watchdog import Vital, Watchdog


class Organ:
    def __init__(self):
        self.count = 0
        self.lost = False

    def vital(self, name, limit_s=5.0):
        return Vital(name=name, progress=lambda: self.count, limit_s=limit_s, excused=lambda: self.lost)


@pytest.fixture
def line(tmp_path):
    """The manager's end, and a notifier that talks to it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as manager:
        manager.bind(str(tmp_path / "notify"))
        environ = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "300000"}
        with Notifier(environ) as notifier:
            yield manager, notifier


def messages(manager):
    received = []
    while True:
        try:
            received.append(manager.recv(4096).decode())
        except BlockingIOError:
            return received


def test_fed_while_organs_work_and_not_while_one_is_stuck(line, caplog):
    manager, notifier = line
    fisheye, head = Organ(), Organ()
    watchdog = Watchdog(notifier, [fisheye.vital("fisheye"), head.vital("ptz")], lambda: "idle")
    assert watchdog.look(0.0) == ()
    head.count += 1
    assert watchdog.look(4.0) == ()
    head.count += 1
    assert watchdog.look(6.0) == ("fisheye",)
    assert watchdog.look(7.0) == ("fisheye",)
    assert messages(manager) == ["WATCHDOG=1", "STATUS=idle", "WATCHDOG=1", "STATUS=stuck: fisheye"]
    assert caplog.messages == ["stuck: fisheye; not feeding the watchdog"]
    fisheye.count += 1
    head.count += 1
    assert watchdog.look(8.0) == ()
    assert messages(manager) == ["WATCHDOG=1", "STATUS=idle"]


def test_an_organ_that_is_known_to_be_lost_is_excused_and_gets_its_full_time_afterwards(line):
    _, notifier = line
    camera = Organ()
    watchdog = Watchdog(notifier, [camera.vital("fisheye")], lambda: "fault")
    watchdog.look(0.0)
    camera.lost = True
    assert watchdog.look(100.0) == ()
    camera.lost = False
    assert watchdog.look(104.0) == ()
    assert watchdog.look(106.0) == ("fisheye",)


@given(st.lists(st.tuples(st.floats(0.01, 3.0), st.booleans(), st.booleans()), max_size=60))
def test_stuck_exactly_when_nothing_happened_for_longer_than_the_limit(steps):
    organ = Organ()
    watchdog = Watchdog(Notifier({}), [organ.vital("x", limit_s=2.0)], lambda: "")
    watchdog.look(0.0)
    now_s, good_s = 0.0, 0.0
    for wait_s, works, lost in steps:
        now_s += wait_s
        organ.count += works
        organ.lost = lost
        if works or lost:
            good_s = now_s
        assert bool(watchdog.look(now_s)) == (now_s - good_s > 2.0)


async def test_it_feeds_more_often_than_the_watchdog_bites(line):
    manager, notifier = line
    loop = asyncio.get_running_loop()
    running = asyncio.create_task(Watchdog(notifier, [], lambda: "idle").run())
    arrived = asyncio.Event()
    loop.add_reader(manager, arrived.set)
    fed = 0
    while fed < 3:
        await arrived.wait()
        fed += messages(manager).count("WATCHDOG=1")
        arrived.clear()
    loop.remove_reader(manager)
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def test_without_a_watchdog_only_the_status_is_told(tmp_path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as manager:
        manager.bind(str(tmp_path / "notify"))
        with Notifier({"NOTIFY_SOCKET": str(tmp_path / "notify")}) as notifier:
            Watchdog(notifier, [], lambda: "idle").look(0.0)
        assert messages(manager) == ["STATUS=idle"]
