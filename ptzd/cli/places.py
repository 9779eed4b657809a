"""`ptzd goto`: the head sent to a named place."""

from __future__ import annotations

import argparse

from ptzd.app.clients import Client
from ptzd.cli.asking import print_json, with_client
from ptzd.plain import plain


def goto(arguments: argparse.Namespace) -> int:
    """Send the head there; returns when it is there."""

    async def work(client: Client) -> int:
        reply = await client.goto(arguments.place, by=arguments.by, hold_s=arguments.hold)
        if arguments.json:
            print_json(reply)
        else:
            where = f"pan {reply.pan_deg:.2f}°, tilt {reply.tilt_deg:.2f}°, {reply.hfov_deg:.1f}° wide"
            print(plain(f"{reply.place}: there: {where}"))
        return 0

    return with_client(arguments, work)
