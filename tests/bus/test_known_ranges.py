"""What locks have taught of the scene's ranges, asked for and taken back over the bus."""

from __future__ import annotations

import asyncio
import contextlib

import pytest

from ptzd.bus.decode import ranges_event
from ptzd.bus.fields import BoxPx
from ptzd.bus.known_ranges import RangeKnown, RangesReply, RangesRequest
from ptzd.control.commands import ReplyRanges
from ptzd.control.events import PayloadRefused, RangesAsked
from ptzd.control.planning.ranges import KnownRange
from ptzd.errors import RequestRefused
from ptzd.model import Box

ONE = KnownRange(
    id="gate-3", x_px=310.5, y_px=220.0, range_m=7.25, sigma_share=0.01, learned_ns=1_800_000_000, weight=0.5
)  # fmt: skip


@pytest.fixture
async def asked(bus):
    """What the core was asked; it answers with one known range."""
    events: list = []

    async def serve() -> None:
        async for event in bus.events():
            events.append(event)
            if isinstance(event, RangesAsked):
                bus.perform(ReplyRanges(token=event.token, learning=True, forgotten=event.forget_last, known=(ONE,)))

    serving = asyncio.ensure_future(serve())
    yield events
    serving.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await serving


@pytest.mark.parametrize(
    ("payload", "event"),
    [
        (b"", RangesAsked(token=4)),
        (b"{}", RangesAsked(token=4)),
        (b'{"forget_last":3}', RangesAsked(token=4, forget_last=3)),
        (b'{"forget_all":true}', RangesAsked(token=4, forget_all=True)),
        (
            b'{"forget_box":{"x":1,"y":2,"w":30,"h":40}}',
            RangesAsked(token=4, forget_box=Box(x=1.0, y=2.0, w=30.0, h=40.0)),
        ),
    ],
)
def test_a_wish_is_read(payload: bytes, event: RangesAsked) -> None:
    assert ranges_event(payload, 4) == event


@pytest.mark.parametrize(
    ("payload", "field"),
    [
        (b'{"forget_last":0}', "$.forget_last"),
        (b'{"forget_last":-1}', "$.forget_last"),
        (b'{"forget_last":1.5}', "$.forget_last"),
        (b'{"forget_everything":true}', "$.forget_everything"),
        (b'{"forget_box":{"x":1,"y":2,"w":3,"h":40}}', "$.forget_box.w"),
        (b'{"forget_last":1,"forget_all":true}', "$"),
        (b"[]", "$"),
    ],
)
def test_what_is_none_is_refused_by_its_field(payload: bytes, field: str) -> None:
    refused = ranges_event(payload, 4)
    assert isinstance(refused, PayloadRefused)
    assert (refused.token, refused.field) == (4, field)
    assert refused.message.startswith("ranges: ")


async def test_a_client_is_told_what_is_known(asked, client) -> None:
    told = await client.ranges()
    assert isinstance(told, RangesReply)
    assert told.known == (
        RangeKnown(
            id="gate-3", x=310.5, y=220.0, range_m=7.25, sigma_share=0.01, learned_ns=ONE.learned_ns, weight=0.5
        ),
    )
    assert told.learning
    assert told.t_ns > 0
    assert asked[0].forget_last == 0


async def test_a_client_takes_some_of_it_back(asked, client) -> None:
    assert (await client.ranges(RangesRequest(forget_last=2))).forgotten == 2
    await client.ranges(RangesRequest(forget_box=BoxPx(x=1, y=2, w=30, h=40)))
    assert asked[1].forget_box == Box(x=1.0, y=2.0, w=30.0, h=40.0)


async def test_two_ways_at_once_are_refused_before_they_are_sent(asked, client) -> None:
    with pytest.raises(RequestRefused, match="forget_last and forget_all"):
        await client.ranges(RangesRequest(forget_last=2, forget_all=True))
    assert asked == []


async def test_a_rig_without_scale_tells_baselines(asked, bus, client) -> None:
    bus.set_calibration({"rig": {"metric": False}})
    (known,) = (await client.ranges()).known
    assert (known.range_m, known.range_baselines) == (None, 7.25)


async def test_whoever_looks_around_takes_nothing_back(bus, asked, raw, client) -> None:
    raw.put("ptzd/hall/control/*", b'{"forget_all":true}')
    raw.put("ptzd/hall/**", b'{"forget_all":true}')
    await client.ranges()
    assert not any(getattr(event, "forget_all", False) for event in asked)


async def test_what_was_given_up_waiting_for_is_not_forgotten_afterwards(bus) -> None:
    assert bus._still_wanted(RangesAsked(token=None, forget_all=True))
    assert not bus._still_wanted(RangesAsked(token=12_345, forget_all=True)), "nobody waits for it any more"
