"""Every way a request can end, at every state: one result, and a head that stands."""

from __future__ import annotations

import asyncio

import pytest

from ptzd.bus.client import Client
from ptzd.errors import RequestRefused
from ptzd.runtime.perception import ThreadPerception
from ptzd.sim.faults import Fault, FaultKind


@pytest.fixture
def gate(monkeypatch: pytest.MonkeyPatch) -> asyncio.Event:
    """Matches wait until this is set, so that MATCH lasts."""
    opened, match = asyncio.Event(), ThreadPerception.match

    async def patient(self, job, fisheye_jpeg, view_jpeg):
        await opened.wait()
        return await match(self, job, fisheye_jpeg, view_jpeg)

    monkeypatch.setattr(ThreadPerception, "match", patient)
    return opened


async def reach(site, state: str, name: str) -> None:
    """Bring the daemon into a state with the request ``name``; in IDLE and HOME it has ended."""
    if state == "IDLE":
        await site.until_state("IDLE")
    elif state == "SCAN":
        await site.request(name, hold_s=60.0)
        await site.until_state("SCAN")
        await site.until_truth(lambda: site.moving)
    elif state == "MATCH":
        await site.request(name, hold_s=60.0)
        await site.until_state("MATCH")
    elif state == "LOCK":
        await site.request(name, hold_s=60.0)
        await site.until_locked(name)
    else:
        await site.lock(name)
        await site.until_state("HOME")


async def test_a_cancel_at_every_state(site, gate) -> None:
    gate.set()
    for state in ("IDLE", "SCAN", "LOCK", "HOME"):
        name = f"in-{state}"
        await reach(site, state, name)
        if state == "IDLE":
            with pytest.raises(RequestRefused, match="no request in-IDLE"):
                await site.client.cancel(name)
            continue
        outcome = "locked" if state == "HOME" else "cancelled"
        assert await site.client.cancel(name) == outcome
        assert (await site.end_of(name)).outcome == outcome
        if state != "HOME":
            await site.until_truth(lambda: not site.moving)
    gate.clear()
    await reach(site, "MATCH", "in-MATCH")
    assert await site.client.cancel("in-MATCH") == "cancelled"
    gate.set()
    await site.lock("after")


async def test_a_cancel_in_the_queue_and_in_a_fault(site) -> None:
    await site.request("active", hold_s=60.0)
    await site.request("waiting")
    assert await site.client.cancel("waiting") == "cancelled"
    await site.rig.fisheye.unplug()
    await site.until_state("FAULT")
    assert await site.client.cancel("active") == "device_lost"
    await site.rig.fisheye.plug_in()
    await site.until_state("IDLE")
    assert {name: site.result_of(name).outcome for name in site.asked} == {
        "active": "device_lost",
        "waiting": "cancelled",
    }


async def test_a_request_during_a_move_and_two_at_once(site) -> None:
    await site.request("first")
    await site.until_truth(lambda: site.moving)
    async with Client.open(site.endpoint, rig="demo") as other:
        site.asked.append("third")
        second, third = await asyncio.gather(
            site.request("second"), other.request(id="third", box=site.box, hold_s=0.0, priority=0)
        )
        assert {second.position, third.position} == {1, 2}
        theirs = await other.result("third", timeout_s=100.0)
    ends = [await site.end_of(name) for name in ("first", "second", "third")]
    assert [end.outcome for end in ends] == ["locked"] * 3
    assert theirs.outcome == "locked"


async def test_the_more_urgent_request_goes_first(site) -> None:
    await site.request("slow", hold_s=60.0)
    await site.until_truth(lambda: site.moving)
    accepted = await site.request("urgent", priority=5)
    assert accepted.position == 0
    assert (await site.end_of("slow")).outcome == "preempted"
    assert (await site.end_of("urgent")).outcome == "locked"


async def test_the_same_id_again_is_the_same_request(site) -> None:
    first = await site.request("a")
    again = await site.client.request(id="a", box=site.box)
    assert again.frame == first.frame
    assert (await site.end_of("a")).outcome == "locked"
    with pytest.raises(RequestRefused) as ended:
        await site.client.request(id="a", box=site.box)
    assert ended.value.code == "ended"


async def test_a_client_that_leaves_is_served_all_the_same(site) -> None:
    async with Client.open(site.endpoint, rig="demo") as leaving:
        site.asked.append("orphan")
        await leaving.request(id="orphan", box=site.box, hold_s=0.0)
    assert (await site.end_of("orphan")).outcome == "locked"
    assert (await site.client.result("orphan")).outcome == "locked"


async def test_stop_ends_everything_and_nothing_moves_after_it(site) -> None:
    await site.request("active")
    await site.request("waiting")
    await site.until_truth(lambda: site.moving)
    assert await site.client.control("stop") == "stopped"
    assert not site.moving
    orders = site.orders
    assert {(await site.end_of(name)).outcome for name in ("active", "waiting")} == {"cancelled"}
    told = len(site.statuses)
    await site.until(lambda: len(site.statuses) >= told + 2)
    assert site.state == "IDLE"
    assert site.orders == orders, "not even home, though its time has passed"


async def test_hold_release_and_home(site) -> None:
    await site.request("held", hold_s=0.5)
    await site.until_state("LOCK")
    assert await site.client.control("hold") == "hold"
    await site.until_locked("held")
    assert site.result_of("held") is None
    assert await site.client.control("release") == "release"
    assert (await site.end_of("held")).outcome == "released"
    assert await site.client.control("home") == "home"
    await site.until_state("HOME")
    await site.until_state("IDLE")
    encoder = site.rig.camera.unit.head.encoder(site.rig.clock.now_s())
    assert (encoder.pan_deg, encoder.tilt_deg) == pytest.approx((0.0, 0.0), abs=0.05)


async def test_a_stop_in_match_ends_the_daemon_in_order(site, gate) -> None:
    await reach(site, "MATCH", "a")
    site.stop.set()
    gate.set()
    await site.serving
    assert (await site.end_of("a")).outcome == "cancelled"


async def test_somebody_elses_motion_is_not_fought(site) -> None:
    await site.request("a", hold_s=60.0)
    await site.until_locked("a")
    site.rig.inject(Fault(kind=FaultKind.FOREIGN_MOVE, pan=40.0, tilt=-10.0, zoom=1.0))
    result = await site.end_of("a")
    assert result.outcome == "preempted"
    await site.until_truth(lambda: not site.moving)
    encoder = site.rig.camera.unit.head.encoder(site.rig.clock.now_s())
    assert encoder.pan_deg == pytest.approx(40.0, abs=0.1)
