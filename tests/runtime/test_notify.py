from __future__ import annotations

import os
import socket

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.runtime.notify import PINGS_PER_PERIOD, Notifier


class Listening(socket.socket):
    environ: dict[str, str]


@pytest.fixture(params=["path", "abstract"])
def manager(request, tmp_path):
    """The service manager's end of the line and the name that it puts into the environment."""
    path = str(tmp_path / "notify")
    with Listening(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as listening:
        if request.param == "path":
            listening.bind(path)
        else:
            listening.bind("\0" + path)
            path = "@" + path
        listening.environ = {"NOTIFY_SOCKET": path}
        yield listening


@pytest.fixture
def told(manager):
    def receive():
        return dict(line.split("=", 1) for line in manager.recv(4096).decode().splitlines())

    return receive


def test_the_life_of_a_service(manager, told):
    with Notifier(manager.environ) as notifier:
        notifier.reloading()
        notifier.reloaded("before it was ready nobody waits for that")
        notifier.ready("idle")
        notifier.status("locked on gate-3")
        notifier.alive()
        notifier.reloading()
        notifier.reloaded("settings read again")
        notifier.stopping("stopping the head")
    assert told() == {"READY": "1", "STATUS": "idle"}
    assert told() == {"STATUS": "locked on gate-3"}
    assert told() == {"WATCHDOG": "1"}
    reloading = told()
    assert reloading.pop("RELOADING") == "1"
    assert int(reloading.pop("MONOTONIC_USEC")) > 0
    assert told() == {"READY": "1", "STATUS": "settings read again"}
    assert told() == {"STOPPING": "1", "STATUS": "stopping the head"}


def test_a_status_is_one_line_and_told_once(manager, told):
    with Notifier(manager.environ) as notifier:
        notifier.status("a\nREADY=1")
        notifier.status("a\nREADY=1")
        notifier.status("b")
    assert told() == {"STATUS": "a READY=1"}
    assert told() == {"STATUS": "b"}
    with pytest.raises(BlockingIOError):
        manager.recv(1)


def test_a_manager_that_does_not_read_never_makes_the_daemon_wait(manager):
    with Notifier(manager.environ) as notifier:
        for _ in range(2000):
            notifier.alive()
        assert notifier.dropped > 0


def test_a_manager_that_is_gone_is_no_error(tmp_path):
    with Notifier({"NOTIFY_SOCKET": str(tmp_path / "nobody")}) as notifier:
        notifier.ready("idle")
        assert notifier.dropped == 1


def test_without_a_manager_nothing_happens():
    with Notifier({}) as notifier:
        notifier.ready("idle")
        notifier.stopping("bye")
        assert (notifier.dropped, notifier.ping_every_s) == (0, None)


@pytest.mark.parametrize(
    ("environ", "watched"),
    [
        ({"WATCHDOG_USEC": "15000000"}, True),
        ({"WATCHDOG_USEC": "15000000", "WATCHDOG_PID": str(os.getpid())}, True),
        ({"WATCHDOG_USEC": "15000000", "WATCHDOG_PID": "1"}, False),
        ({"WATCHDOG_USEC": "0"}, False),
        ({"WATCHDOG_USEC": ""}, False),
        ({}, False),
    ],
)
def test_the_watchdog_is_fed_only_when_it_watches_this_process(environ, watched):
    assert Notifier(environ).ping_every_s == (15.0 / PINGS_PER_PERIOD if watched else None)


@given(st.text(max_size=20))
def test_any_environment_is_taken(text):
    every_s = Notifier({"WATCHDOG_USEC": text}).ping_every_s
    assert every_s is None or every_s > 0
