"""`ptzd ranges`: what locks have taught of the scene's ranges, shown and taken back."""

from __future__ import annotations

import argparse

import msgspec
from rich.table import Table

from ptzd.app.clients import BoxPx, Client, RangeKnown, RangesReply, RangesRequest
from ptzd.cli import terminal
from ptzd.cli.asking import with_client

HOUR_NS = 3_600_000_000_000


def ranges(arguments: argparse.Namespace) -> int:
    """Show what is known, after taking back what was asked for."""
    frame = arguments.forget_box
    request = RangesRequest(
        forget_last=arguments.forget_last,
        forget_box=None if frame is None else BoxPx(x=frame.x, y=frame.y, w=frame.w, h=frame.h),
        forget_all=arguments.forget_all,
    )

    async def work(client: Client) -> int:
        told = await client.ranges(request)
        if arguments.json:
            print(msgspec.json.encode(told).decode())
            return 0
        forgetting = request != RangesRequest()
        if forgetting:
            print(f"{told.forgotten} forgotten, {len(told.known)} left")
        else:
            terminal.console().print(_table(told))
        if not told.learning:
            print("locks teach nothing and none of this is used: ranges.learn is off")
        return 0

    return with_client(arguments, work)


def _table(told: RangesReply) -> Table:
    table = Table("x, y in the fisheye, px", "range", "± (1 sigma)", "learned", "counts", "request")
    for one in reversed(told.known):
        age_h = max(told.t_ns - one.learned_ns, 0) / HOUR_NS
        table.add_row(
            f"{one.x:.0f}, {one.y:.0f}",
            _away(one),
            f"{100 * one.sigma_share:.1f} %",
            f"{age_h:.1f} h ago",
            f"{one.weight:.2f}",
            one.id,
        )
    fresh = sum(one.weight >= 0.5 for one in told.known)
    table.caption = f"{len(told.known)} lock(s), {fresh} of them count at least half"
    return table


def _away(one: RangeKnown) -> str:
    if one.range_m is not None:
        return f"{one.range_m:.2f} m"
    return "infinite" if one.range_baselines is None else f"{one.range_baselines:.2f} baselines"
