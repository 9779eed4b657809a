"""Pictures of an MJPEG stream over HTTP, stamped on arrival."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ptzd.devices.mjpeg import MultipartParser, boundary_of
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.failures import ConnectionCut
from ptzd.devices.vapix.requests import Request
from ptzd.errors import DeviceGarbled, DeviceLost
from ptzd.ports import Clock

Deliver = Callable[[bytes | None, int], None]
"""Takes a picture's bytes, or None for a damaged one, and when its last byte arrived."""


PARTS_A_TURN = 32
"""A chunk of nothing but beginnings of pictures has thousands: others on the loop have their turn between them."""
BYTES_A_TURN = 16_384
"""Full of the smallest segments of one picture they take some 10 ms to walk."""
MOST_PARTS_S = 2000
"""Whole or broken pictures in a second beyond which it is none of a camera: they make up to 240, and what waited
while the network was away comes all at once."""
SECOND_NS = 1_000_000_000


async def read_mjpeg(
    client: CameraClient, request: Request[None], *, clock: Clock, stall_s: float, deliver: Deliver
) -> None:
    """Read a stream until it fails; returns never.

    Parameters
    ----------
    client, request
        Whom to ask for what.
    clock : Clock
        Stamps the arrivals.
    stall_s : float
        Longest time without a complete picture.
    deliver : callable
        Called for every part, on the event loop; must return at once.

    Raises
    ------
    DeviceLost
        Not reachable, cut, or no complete picture for ``stall_s``.
    DeviceRefused, DeviceGarbled
        Not allowed, or not an MJPEG stream: another type, compressed, more than `MOST_PARTS_S` parts in a second.
    """
    loop = asyncio.get_running_loop()
    parser: MultipartParser | None = None
    flood = _Flood(f"{client.origin}{request.name}")
    try:
        async with asyncio.timeout(stall_s) as patience, client.stream(request, stall_s) as response:
            refuse_compressed(response.headers.get("Content-Encoding", ""))
            parser = MultipartParser(boundary_of(response.headers.get("Content-Type", "")))
            async for chunk in response.content.iter_any():
                arrival_ns = clock.now_ns()
                for start in range(0, len(chunk), BYTES_A_TURN):
                    # what came faster than it is read is there at once: without pauses the loop would see nothing else
                    await asyncio.sleep(0)
                    for number, part in enumerate(parser.feed(chunk[start : start + BYTES_A_TURN]), start=1):
                        if number % PARTS_A_TURN == 0:
                            await asyncio.sleep(0)
                        flood.count(arrival_ns, parser)
                        deliver(part.body if part.complete else None, arrival_ns)
                        if part.complete:
                            patience.reschedule(loop.time() + stall_s)
            raise ConnectionCut("the stream ended")
    except TimeoutError:
        seen = "no answer came" if parser is None else parser.seen()
        raise DeviceLost(f"{client.origin}{request.name}: no complete picture for {stall_s:g} s; {seen}") from None


class _Flood:
    """How many parts came within a second; name is whose."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._since_ns = 0
        self._parts = 0

    def count(self, arrival_ns: int, parser: MultipartParser) -> None:
        """Take note of a part that came; DeviceGarbled when there are too many."""
        if not 0 <= arrival_ns - self._since_ns < SECOND_NS:
            self._since_ns, self._parts = arrival_ns, 0
        self._parts += 1
        if self._parts > MOST_PARTS_S:
            raise DeviceGarbled(
                f"{self._name}: more than {MOST_PARTS_S:,} pictures or pieces of such within a second, which no camera "
                f"makes ({parser.seen()}); check what serves this address"
            )


def refuse_compressed(encoding: str) -> None:
    """Raise DeviceGarbled for a body that is packed: it would be unpacked late and without a bound."""
    if encoding.strip().lower() not in {"", "identity"}:
        raise DeviceGarbled(
            f"the stream is sent with Content-Encoding {encoding!r}; switch compression off in the server or "
            "proxy that does so, JPEG is compressed already"
        )
