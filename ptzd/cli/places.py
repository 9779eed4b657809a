"""`ptzd goto`, `ptzd patrol` and `ptzd home-after`: the head sent to named places, and left there."""

from __future__ import annotations

import argparse

from ptzd.app.clients import Client
from ptzd.cli.asking import home_after_in_words, patrol_in_words, print_json, with_client
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


def patrol(arguments: argparse.Namespace) -> int:
    """Begin a patrol, let it rest, go on or end; says how it stands then."""

    async def work(client: Client) -> int:
        told = await client.patrol(arguments.wish, arguments.patrol)
        if arguments.json:
            print_json(told)
        else:
            print(plain("no patrol is under way" if told is None else patrol_in_words(told)))
        return 0

    return with_client(arguments, work)


def home_after(arguments: argparse.Namespace) -> int:
    """Say how long the head is left where it is before it goes home."""

    async def work(client: Client) -> int:
        after_s = await client.home_after(arguments.after)
        if arguments.json:
            print_json({"after_s": after_s})
        else:
            print(home_after_in_words(after_s))
        return 0

    return with_client(arguments, work)
