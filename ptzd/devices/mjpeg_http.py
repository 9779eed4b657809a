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
        Not allowed, or not an MJPEG stream.
    """
    loop = asyncio.get_running_loop()
    parser: MultipartParser | None = None
    try:
        async with asyncio.timeout(stall_s) as patience, client.stream(request, stall_s) as response:
            refuse_compressed(response.headers.get("Content-Encoding", ""))
            parser = MultipartParser(boundary_of(response.headers.get("Content-Type", "")))
            async for chunk in response.content.iter_any():
                # what came faster than it is read is there at once: without a pause the loop would see nothing else
                await asyncio.sleep(0)
                arrival_ns = clock.now_ns()
                for number, part in enumerate(parser.feed(chunk), start=1):
                    if number % PARTS_A_TURN == 0:
                        await asyncio.sleep(0)
                    deliver(part.body if part.complete else None, arrival_ns)
                    if part.complete:
                        patience.reschedule(loop.time() + stall_s)
            raise ConnectionCut("the stream ended")
    except TimeoutError:
        seen = "no answer came" if parser is None else parser.seen()
        raise DeviceLost(f"{client.origin}{request.name}: no complete picture for {stall_s:g} s; {seen}") from None


def refuse_compressed(encoding: str) -> None:
    """Raise DeviceGarbled for a body that is packed: it would be unpacked late and without a bound."""
    if encoding.strip().lower() not in {"", "identity"}:
        raise DeviceGarbled(
            f"the stream is sent with Content-Encoding {encoding!r}; switch compression off in the server or "
            "proxy that does so, JPEG is compressed already"
        )
