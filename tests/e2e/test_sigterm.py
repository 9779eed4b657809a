"""`ptzd run` as a process that gets SIGTERM, at every state: the promise to whoever stops the service."""

from __future__ import annotations

import asyncio

import pytest

from ptzd.sim.faults import Fault, FaultKind

WITHIN_S = 5.0
"""From SIGTERM to the end of the process; the unit file grants four times as much."""


async def spawned(site, state: str = "IDLE") -> float:
    """Start the process; how long that took, s: the yardstick of this machine."""
    loop = asyncio.get_running_loop()
    started_s = loop.time()
    await site.spawn(state=state)
    return loop.time() - started_s


async def terminated(site, start_s: float) -> str:
    """End the process, which takes a moment or at most as long as its start did; what it wrote to stderr."""
    loop, process = asyncio.get_running_loop(), site.process
    asked_s = loop.time()
    process.terminate()
    _, errors = await process.communicate()
    assert loop.time() - asked_s <= max(WITHIN_S, start_s)
    assert process.returncode == 0
    text = errors.decode()
    assert "Traceback" not in text
    assert "never" not in text, "a task or a coroutine was forgotten"
    return text


@pytest.mark.parametrize("state", ["IDLE", "SCAN", "MATCH", "LOCK", "HOME"])
async def test_sigterm_while_the_devices_are_well(make_site, state: str) -> None:
    site = await make_site()
    start_s = await spawned(site)
    if state != "IDLE":
        await site.request("a", hold_s=0.0 if state == "HOME" else 60.0)
        await site.request("waiting", hold_s=60.0) if state == "SCAN" else None
        await site.until(lambda: any(status.state == state for status in site.statuses))
    if state == "SCAN":
        await site.until_truth(lambda: site.moving)
    if state == "LOCK":
        await site.until_locked("a")
    await terminated(site, start_s)
    assert not site.moving, "the head stands before the process ends"
    await site.end()
    expected = {"IDLE": [], "SCAN": ["cancelled"] * 2, "HOME": ["locked"]}.get(state, ["cancelled"])
    assert [result.outcome for result in site.results] == expected
    if "cancelled" in expected:
        assert site.results[0].reason == "the daemon is stopping"


async def test_sigterm_before_the_camera_was_ever_there(make_site) -> None:
    site = await make_site()
    site.rig.inject(Fault(kind=FaultKind.RESET))
    start_s = await spawned(site, "STARTING")
    await site.until(lambda: site.status.fisheye == "well")
    await terminated(site, start_s)


async def test_sigterm_in_a_fault(make_site) -> None:
    site = await make_site()
    start_s = await spawned(site)
    await site.request("a", hold_s=60.0)
    await site.until_truth(lambda: site.moving)
    await site.rig.fisheye.unplug()
    await site.until_state("FAULT")
    await terminated(site, start_s)
    await site.end()
    assert [result.outcome for result in site.results] == ["device_lost"]


async def test_sigterm_in_a_move_with_a_camera_that_no_longer_answers(make_site) -> None:
    site = await make_site()
    start_s = await spawned(site)
    await site.request("a", hold_s=60.0)
    await site.until_truth(lambda: site.moving)
    site.rig.inject(Fault(kind=FaultKind.HANG))
    await terminated(site, start_s)
    await site.end()
    assert [result.id for result in site.results] == ["a"]
