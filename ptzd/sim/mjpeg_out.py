"""The multipart stream as the camera writes it, and the ways in which it goes wrong."""

from __future__ import annotations

import asyncio
import random

from aiohttp import web

from ptzd.sim.clock import SimClock
from ptzd.sim.faults import Fault, FaultBox, FaultKind
from ptzd.sim.stream import Shot, Stream
from ptzd.sim.wire import BOUNDARY, RawStream, abort


def part(jpeg: bytes, announced: int | None = None) -> bytes:
    """One part: boundary, headers, picture, CRLF."""
    length = len(jpeg) if announced is None else announced
    head = f"--{BOUNDARY}\r\nContent-Type: image/jpeg\r\nContent-Length: {length}\r\n\r\n"
    return head.encode() + jpeg + b"\r\n"


def spoilt(jpeg: bytes, kind: FaultKind, seed: int) -> bytes:
    """The picture cut in its middle or with noise inside."""
    if kind is FaultKind.CORRUPT:
        noise = random.Random(seed).randbytes(len(jpeg) // 8)  # noqa: S311 - noise, no secret
        start = len(jpeg) // 2
        return jpeg[:start] + noise + jpeg[start + len(noise) :]
    return jpeg[: len(jpeg) // 2]


class StreamEnd(Exception):
    """The stream ends here, by a fault."""


async def serve_stream(
    request: web.Request,
    stream: Stream,
    *,
    clock: SimClock,
    faults: FaultBox,
    rfc_boundary: bool,
    frames: int = 0,
    duration_s: float = 0.0,
) -> web.StreamResponse:
    """Write pictures until the client leaves, `frames` are sent or `duration_s` is over; 0 means without end.

    There is no closing boundary: the connection just closes.
    """
    boundary = BOUNDARY if rfc_boundary else f"--{BOUNDARY}"
    headers = {
        "Content-Type": f"multipart/x-mixed-replace; boundary={boundary}",
        "Cache-Control": "no-cache",
        "Connection": "close",
    }
    response = RawStream(headers=headers)
    response.force_close()
    await response.prepare(request)
    end_s = clock.now_s() + duration_s if duration_s else float("inf")
    queue = stream.join()
    sent = 0
    try:
        while (not frames or sent < frames) and clock.now_s() < end_s:
            shot = await queue.get()
            fault = faults.on_picture(request.path_qs, clock.now_s())
            await _write(request, response, shot, fault, clock)
            sent += 1
    except (StreamEnd, ConnectionError):
        pass
    finally:
        await stream.leave(queue)
    return response


async def _write(
    request: web.Request, response: web.StreamResponse, shot: Shot, fault: Fault | None, clock: SimClock
) -> None:
    kind = fault.kind if fault else None
    if fault is not None and kind is FaultKind.STALL:
        if fault.for_s is None:
            await asyncio.Event().wait()
        await clock.sleep_until(clock.now_s() + (fault.for_s or 0.0))
    elif kind is FaultKind.CUT:
        await response.write(part(shot.jpeg)[: len(shot.jpeg) // 2])
        abort(request)
        raise StreamEnd
    elif kind is FaultKind.SHORT:
        await response.write(part(spoilt(shot.jpeg, FaultKind.TRUNCATE, shot.number), len(shot.jpeg)))
    elif kind in (FaultKind.TRUNCATE, FaultKind.CORRUPT):
        await response.write(part(spoilt(shot.jpeg, kind, shot.number)))
    else:
        await response.write(part(shot.jpeg))
