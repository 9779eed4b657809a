"""The heartbeat of a lease says no more than is true, and stops with it."""

from __future__ import annotations

import asyncio

import pytest

from ptzd.bus import leasing
from ptzd.bus.leasing import keep
from ptzd.bus.messages import LeaseReply, LeaseRequest
from ptzd.errors import BusError, RequestRefused
from ptzd.model import LeaseHeld

PATIENCE_S = 100.0
EPOCH_NS = 1_900_000_000_000_000_000
"""The rig's clock has nothing to do with the client's."""


class Rig:
    """Takes every wish and writes it down, until it has something else to say."""

    def __init__(self, for_s: float, since_s: float = 0.0) -> None:
        self.wishes: list[str] = []
        self.says: Exception | None = None
        self._news = asyncio.Condition()
        self.held = LeaseHeld(
            owner="desk", rank=0, since_ns=EPOCH_NS - round(since_s * 1e9), until_ns=EPOCH_NS + round(for_s * 1e9)
        )

    async def ask(self, request: LeaseRequest) -> LeaseReply:
        self.wishes.append(request.wish)
        async with self._news:
            self._news.notify_all()
        if self.says is not None:
            raise self.says
        return LeaseReply(lease=self.held)

    async def heard(self, count: int) -> None:
        """Wait for so many wishes."""
        async with asyncio.timeout(PATIENCE_S), self._news:
            await self._news.wait_for(lambda: len(self.wishes) >= count)

    async def move(self, request):
        raise AssertionError(request)


@pytest.fixture(autouse=True)
def quick(monkeypatch) -> None:
    monkeypatch.setattr(leasing, "RENEW_S", 0.02)


@pytest.mark.parametrize(("asked_s", "since_s"), [(0.05, 0.0), (None, 0.0), (0.05, 3600.0)])
async def test_when_its_time_is_over_nothing_is_renewed_or_given_back(asked_s: float | None, since_s: float) -> None:
    rig = Rig(0.05, since_s)
    async with keep(rig.ask, rig.move, LeaseRequest(owner="desk", for_s=asked_s)) as kept, asyncio.timeout(PATIENCE_S):
        assert await kept.over() == "the time of desk is over"
        said = list(rig.wishes)
    assert rig.wishes == said, "nothing was said after its end"
    assert set(said) <= {"take", "renew"}
    assert len(said) <= 3, "at most two heartbeats fit before the last"


@pytest.mark.parametrize(
    ("says", "told"),
    [
        (RequestRefused("lost", "gate has taken it", "$.owner"), "gate has taken it"),
        (RequestRefused("stopping", "the daemon is stopping"), "the daemon is stopping"),
        (BusError("no ptzd answers"), "no ptzd answers"),
    ],
)
async def test_when_the_rig_says_that_it_is_over_nothing_is_given_back(says: Exception, told: str) -> None:
    rig = Rig(600.0)
    async with keep(rig.ask, rig.move, LeaseRequest(owner="desk")) as kept, asyncio.timeout(PATIENCE_S):
        rig.says = says
        assert await kept.over() == told
    assert rig.wishes == ["take", *["renew"] * (len(rig.wishes) - 1)]


async def test_who_leaves_gives_it_back_once() -> None:
    rig = Rig(600.0)
    async with keep(rig.ask, rig.move, LeaseRequest(owner="desk", for_s=600.0)):
        pass
    assert rig.wishes == ["take", "give"]


async def test_taken_once_more_it_lasts_longer() -> None:
    rig = Rig(0.5)
    async with keep(rig.ask, rig.move, LeaseRequest(owner="desk", for_s=0.5)) as kept:
        rig.held = LeaseHeld(owner="desk", rank=0, since_ns=EPOCH_NS, until_ns=EPOCH_NS + 600_000_000_000)
        # thirty heartbeats take longer than it was to last at first
        await rig.heard(31)
        assert kept.held == rig.held
        assert not kept.is_over
    assert rig.wishes == ["take", *["renew"] * (len(rig.wishes) - 2), "give"]
