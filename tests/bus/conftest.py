from __future__ import annotations

import asyncio
import contextlib
import threading
import time
from collections.abc import AsyncIterator, Iterator

import pytest

from ptzd.bus.client import Client
from ptzd.bus.server import ZenohBus
from ptzd.config import BusSettings
from ptzd.control.commands import PublishResult, ReplyAccepted, ReplyOutcome, ReplyRefused
from ptzd.control.events import CancelReceived, ControlReceived, Event, PayloadRefused, RequestReceived, UpdateReceived
from ptzd.model import FrameRef, Outcome

PATIENCE_S = 100.0
"""For anything that must happen; a loaded machine is slow, a hang is a failure."""


class SteadyClock:
    """Epoch at start plus monotonic since."""

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        return time.monotonic_ns() + self._offset_ns

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns + self._offset_ns


class ObligingCore:
    """Takes every event and answers every query at once, as the pump with a machine would."""

    def __init__(self, bus: ZenohBus) -> None:
        self._bus = bus
        self.seen: list[Event] = []
        self._news = asyncio.Condition()
        self.task = asyncio.ensure_future(self._run())

    async def until(self, count: int) -> list[Event]:
        """The events so far, as soon as there are so many."""
        async with asyncio.timeout(PATIENCE_S), self._news:
            await self._news.wait_for(lambda: len(self.seen) >= count)
        return self.seen

    async def _run(self) -> None:
        async for event in self._bus.events():
            answer(self._bus, event)
            self.seen.append(event)
            async with self._news:
                self._news.notify_all()


def answer(bus: ZenohBus, event: Event) -> None:
    match event:
        case RequestReceived(token=int() as token, id=request_id):
            bus.perform(ReplyAccepted(token=token, id=request_id, frame=FrameRef(seq=7, t_capture_ns=8), position=0))
        case PayloadRefused(token=int() as token):
            bus.perform(ReplyRefused(token=token, code=event.code, message=event.message, field=event.field))
        case PayloadRefused(id=str() as request_id):
            bus.perform(result_of(request_id, Outcome.REJECTED, event.message))
        case CancelReceived(token=int() as token):
            bus.perform(ReplyOutcome(token=token, outcome="cancelled"))
        case UpdateReceived(token=int() as token):
            bus.perform(ReplyOutcome(token=token, outcome="updated"))
        case ControlReceived(token=int() as token, verb=verb):
            bus.perform(ReplyOutcome(token=token, outcome=f"{verb} done"))
        case _:
            pass


def result_of(request_id: str, outcome: Outcome = Outcome.LOCKED, reason: str = "it is there") -> PublishResult:
    return PublishResult(
        id=request_id, outcome=outcome, reason=reason, label="", elapsed_ms=12, views=3, pan_deg=1.5, tilt_deg=-2.0,
        box_ptz=((1.0, 2.0), (3.0, 2.0), (3.0, 4.0), (1.0, 4.0)),
    )  # fmt: skip


@pytest.fixture(autouse=True)
def _no_thread_is_left() -> Iterator[None]:
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before and not t.name.startswith("asyncio_")]
    assert left == []


@pytest.fixture
def clock() -> SteadyClock:
    return SteadyClock()


@pytest.fixture
def result():
    return result_of


@pytest.fixture
async def bus(endpoint: str, clock: SteadyClock) -> AsyncIterator[ZenohBus]:
    async with ZenohBus(BusSettings(listen=(endpoint,)), "hall", clock) as opened:
        yield opened


@pytest.fixture
async def core(bus: ZenohBus) -> AsyncIterator[ObligingCore]:
    obliging = ObligingCore(bus)
    yield obliging
    obliging.task.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await obliging.task


@pytest.fixture
async def client(endpoint: str, bus: ZenohBus) -> AsyncIterator[Client]:
    async with Client.open(endpoint, rig="hall", timeout_s=PATIENCE_S) as opened:
        yield opened


@pytest.fixture
def until_alive():
    async def wait(client: Client, rig: str) -> None:
        """Ask until the rig's liveliness token has come round; every question is a round trip."""
        async with asyncio.timeout(PATIENCE_S):
            while rig not in await client.rigs():
                pass

    return wait


@pytest.fixture
def raw(client: Client):
    """The client's own Zenoh session, for what the client library would not send."""
    return client._session
