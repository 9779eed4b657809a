"""`ptzd move`: the head moved by whoever has the lease."""

from __future__ import annotations

import argparse
import asyncio
from typing import Literal

from ptzd.app.clients import BoxPx, Client, LensWanted, MoveReply, MoveRequest, PanTilt, PixelPtz, Speed, Step
from ptzd.cli.asking import with_client
from ptzd.errors import RequestRefused
from ptzd.plain import plain

USUAL_S = 1.0
LONGEST_S = 3600.0
SAY_AGAIN_S = 0.1
"""A head that hears nothing for 0.3 s stands."""


def move(arguments: argparse.Namespace) -> int:
    """Move once, or keep a speed for some time; returns when the rig has answered, not when the head is there."""
    if arguments.for_s is not None and (arguments.speed is None or not 0 < arguments.for_s <= LONGEST_S):
        raise RequestRefused(
            "invalid", f"--for {arguments.for_s:g}: with --speed, more than 0 and at most {LONGEST_S:g} s"
        )
    request = _request(arguments)

    async def work(client: Client) -> int:
        told = await client.move(request)
        print(plain(in_words(told)), flush=True)
        if request.speed is not None:
            await _go_on(client, request, arguments.for_s or USUAL_S)
        return 0

    return with_client(arguments, work)


async def _go_on(client: Client, request: MoveRequest, for_s: float) -> None:
    loop = asyncio.get_running_loop()
    end_s = loop.time() + for_s
    while (left_s := end_s - loop.time()) > 0:
        await asyncio.sleep(min(SAY_AGAIN_S, left_s))
        if loop.time() < end_s:
            await client.move(request)
    await client.move(MoveRequest(owner=request.owner, speed=Speed()))


def _request(arguments: argparse.Namespace) -> MoveRequest:
    owner, hfov, frame = arguments.owner, arguments.hfov, arguments.frame
    if arguments.to:
        return MoveRequest(owner=owner, to=PanTilt(pan_deg=arguments.to[0], tilt_deg=arguments.to[1]), hfov_deg=hfov)
    if arguments.by:
        return MoveRequest(owner=owner, by=Step(pan_deg=arguments.by[0], tilt_deg=arguments.by[1]), hfov_deg=hfov)
    if arguments.point:
        return MoveRequest(owner=owner, point=PixelPtz(x=arguments.point[0], y=arguments.point[1]), hfov_deg=hfov)
    if frame:
        return MoveRequest(owner=owner, box=BoxPx(x=frame.x, y=frame.y, w=frame.w, h=frame.h), hfov_deg=hfov)
    if arguments.speed is None:
        return MoveRequest(owner=owner, lens=LensWanted(focus=_units(arguments.focus), iris=_units(arguments.iris)))
    pan_deg_s, tilt_deg_s, zoom_rate = arguments.speed
    speed = Speed(pan_deg_s=pan_deg_s, tilt_deg_s=tilt_deg_s, zoom_rate=zoom_rate)
    return MoveRequest(owner=owner, speed=speed, hfov_deg=hfov)


def _units(text: str | None) -> int | Literal["auto"] | None:
    if text is None:
        return None
    if text == "auto":
        return "auto"
    if not (text.isascii() and text.isdecimal()):
        raise RequestRefused("invalid", f"{text}: expected auto or the camera's own units, 1 to 9999")
    return int(text)


def in_words(told: MoveReply) -> str:
    """What the head does, for a person."""
    if told.pan_deg is not None and told.tilt_deg is not None and told.zoom is not None:
        wide = "" if told.hfov_deg is None else f", {told.hfov_deg:.2f}° wide"
        return f"to pan {told.pan_deg:.3f}°, tilt {told.tilt_deg:.3f}°, zoom {told.zoom:.0f}{wide}"
    if told.pan_deg_s is None:
        taken = (("focus", told.focus), ("iris", told.iris))
        return ", ".join(f"{name} {value}" for name, value in taken if value is not None)
    slowed = f", slowed by the limit {told.slowed_by}" if told.slowed_by else ""
    return f"at pan {told.pan_deg_s:.2f}°/s, tilt {told.tilt_deg_s:.2f}°/s, zoom {told.zoom_rate:+.2f}{slowed}"
