"""What is told of the state: by the core, by the shell, now and again."""

from __future__ import annotations

import pytest

from ptzd.bus import server as server_module
from ptzd.bus.client import Client
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings
from ptzd.control.commands import PublishStatus

PATIENCE_S = 100.0
STATUS = PublishStatus(
    state="SCAN", active="a", phase="walking", queue=("b",), fisheye="well", ptz="refuses: 401", held=False
)


async def test_status_joins_what_core_and_shell_know(endpoint, clock):
    extra = {
        "versions": {"ptzd": "1"}, "state": "not the shell's business", "log": {"file": "x.mcap"},
        "devices": {"ptz": {"model": "V5915"}},
    }  # fmt: skip
    async with (
        ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock, status_extra=lambda: extra) as bus,
        Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as client,
    ):
        bus.perform(STATUS)
        status = await client.status()
        assert (status.state, status.active, status.queue, status.ptz) == ("SCAN", "a", ("b",), "refuses: 401")
        assert status.versions == {"ptzd": "1"}
        assert status.devices == {"ptz": {"model": "V5915"}}


async def test_status_comes_again_by_itself(bus, client, monkeypatch):
    monkeypatch.setattr(server_module, "STATUS_EVERY_S", 0.01)
    seen = []
    async for notice in client.watch():
        seen.append(notice.t_ns)
        if len(seen) == 3:
            break
    assert seen == sorted(seen)


async def test_a_fault_in_the_shell_s_part_of_the_status_is_not_silent(endpoint, clock):
    def broken():
        raise ZeroDivisionError("a fault")

    async with ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock, status_extra=broken) as bus:
        with pytest.raises(ZeroDivisionError, match="a fault"):
            await anext(aiter(bus.events()))
        bus._answers._status_extra = dict
