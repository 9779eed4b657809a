"""A person takes the head of a running rig, over real sockets."""

from __future__ import annotations

import asyncio
import json
import signal
import sys

import pytest

from ptzd.bus.messages import LeaseRequest
from ptzd.errors import RequestRefused


async def test_it_is_his_while_he_keeps_it(site) -> None:
    accepted = await site.request("first", hold_s=60.0)
    await site.until_state("LOCK")
    async with site.client.lease("desk", for_s=600.0) as kept:
        assert (await site.end_of(accepted.id)).outcome == "preempted"
        await site.until_state("MANUAL")
        await site.request("waits", hold_s=0.0)
        # longer than the silence that ends it: the heartbeat holds it
        heard_ns = site.statuses[-1].t_ns
        await site.until(lambda: site.statuses[-1].t_ns > heard_ns + 7_000_000_000)
        assert site.statuses[-1].lease.owner == "desk"
        assert site.statuses[-1].queue == ("waits",)
        with pytest.raises(RequestRefused, match="desk has had the head for") as refused:
            await site.client.ask_lease(LeaseRequest(owner="gate"))
        assert refused.value.code == "leased"
        await site.client.ask_lease(LeaseRequest(owner="gate", wish="ask"))
        await site.until(lambda: site.statuses[-1].lease is not None and site.statuses[-1].lease.wanted_by == "gate")
        mine = await site.request("mine", hold_s=0.0, by="desk")
        assert (await site.end_of(mine.id)).outcome == "locked"
        assert kept.held.owner == "desk"
    assert (await site.end_of("waits")).outcome == "locked"
    assert (await site.client.status()).lease is None


async def test_who_vanishes_has_it_no_more(site) -> None:
    """A process that takes the lease on the command line and is killed."""
    command = [sys.executable, "-m", "ptzd", "lease", "desk", "--connect", site.endpoint]
    keeper = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    try:
        assert b"desk has the head until" in await keeper.stdout.readline()
        await site.until_state("MANUAL")
        await site.request("waits", hold_s=0.0)
    finally:
        keeper.kill()
        await keeper.wait()
    assert (await site.end_of("waits")).outcome == "locked"


async def test_an_interrupt_gives_it_back_and_status_says_who_has_it(site) -> None:
    command = [sys.executable, "-m", "ptzd", "lease", "desk", "--for", "60", "--connect", site.endpoint]
    keeper = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
    await keeper.stdout.readline()
    status = [sys.executable, "-m", "ptzd", "status", "--connect", site.endpoint]
    asking = await asyncio.create_subprocess_exec(*status, stdout=asyncio.subprocess.PIPE)
    assert b"desk has the head until" in (await asking.communicate())[0]
    asking = await asyncio.create_subprocess_exec(*status, "--json", stdout=asyncio.subprocess.PIPE)
    lease = json.loads((await asking.communicate())[0])["lease"]
    assert lease["until_ns"] - lease["since_ns"] == 60 * 10**9
    keeper.send_signal(signal.SIGINT)
    await keeper.wait()
    assert (await site.client.status()).lease is None
