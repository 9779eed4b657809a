"""Commands that ask a running daemon over the bus."""

from __future__ import annotations

import argparse
import asyncio
from collections.abc import Awaitable, Callable
from datetime import datetime

import msgspec
from rich.markup import escape

from ptzd.app.clients import (
    Client,
    Feedback,
    GotoShown,
    LeaseHeld,
    LeaseRequest,
    MotorStatus,
    PatrolShown,
    Pose,
    RoiResult,
    ShadowPose,
    notices,
)
from ptzd.cli import terminal
from ptzd.control.states import State
from ptzd.control.wording import in_words, range_in_words
from ptzd.plain import plain


def print_json(document: object) -> None:
    """One line."""
    print(msgspec.json.encode(document).decode(), flush=True)


def with_client(arguments: argparse.Namespace, work: Callable[[Client], Awaitable[int]]) -> int:
    """Connect as the arguments say, do the work, return its exit code."""

    async def run() -> int:
        client = Client.open(
            arguments.connect, rig=arguments.rig, prefix=arguments.prefix, config_file=arguments.bus_config
        )
        async with client:
            return await work(client)

    return asyncio.run(run())


def aim(arguments: argparse.Namespace) -> int:
    """Ask for a box, show what happens, exit 0 when it was locked."""
    box, hfov = arguments.box, arguments.hfov

    async def work(client: Client) -> int:
        accepted = await client.request(
            box=(box.x, box.y, box.w, box.h),
            id=arguments.id,
            frame_seq=arguments.frame,
            range_m=arguments.range,
            zoom=hfov if hfov is not None else "keep" if arguments.keep_zoom else "fit",
            fill=arguments.fill,
            hold_s=arguments.hold,
            timeout_s=arguments.timeout,
            priority=arguments.priority,
            label=arguments.label,
            by=arguments.by,
        )
        if not arguments.json:
            print(f"{accepted.id}: accepted, place {accepted.position}")
        async for step in client.feedback(accepted.id):
            _show_step(step, as_json=arguments.json)
        result = await client.result(accepted.id)
        if arguments.json:
            print_json(result)
        else:
            print(plain(f"{result.id}: {describe(result)}"))
        return 0 if result.outcome in {"locked", "released"} else 1

    return with_client(arguments, work)


def _show_step(step: Feedback, *, as_json: bool) -> None:
    if as_json:
        print_json(step)
        return
    print(plain(f"{step.id}: {step.step}: {in_words(step.detail)}"), flush=True)


def _said(text: str) -> str:
    """What the rig says, for a console that reads markup."""
    return escape(plain(text))


def describe(result: RoiResult) -> str:
    """One line for a person."""
    parts = [f"{result.outcome} after {result.elapsed_ms / 1000:.1f} s ({result.reason})"]
    if result.pan_deg is not None and result.tilt_deg is not None:
        parts.append(f"pan {result.pan_deg:.3f}°, tilt {result.tilt_deg:.3f}°")
    if result.range_m is not None:
        parts.append(f"range {range_in_words(result.range_m, metric=True)}")
    if result.range_baselines is not None:
        parts.append(f"range {range_in_words(result.range_baselines, metric=False)}")
    if result.probability is not None:
        parts.append(f"probability {result.probability:.3f}")
    return ", ".join(parts)


def status(arguments: argparse.Namespace) -> int:
    """What the rig does now."""

    async def work(client: Client) -> int:
        now = await client.status()
        if arguments.json:
            print_json(now)
            return 0
        console = terminal.console()
        colour = "red" if now.state == State.FAULT else "green"
        console.print(f"[bold {colour}]{_said(now.state)}[/] {_said(now.phase)}")
        console.print(
            f"active    {_said(now.active or '–')}    waiting {len(now.queue)}{'    held' if now.held else ''}"
        )
        if now.doubt:
            console.print(f"[bold red]head      {_said(now.doubt)}[/]")
        if now.shadow:
            where = now.pose.shadow if now.pose else None
            pose = f"; the head would be at {pose_in_words(where)}" if where else ""
            console.print(f"shadow    decides and logs, moves nothing{pose}")
        if now.lease is not None:
            console.print(f"lease     {_said(held_in_words(now.lease))}")
        if now.goto is not None:
            console.print(f"goto      {_said(goto_in_words(now.goto))}")
        if now.patrol is not None:
            console.print(f"patrol    {_said(patrol_in_words(now.patrol))}")
        if now.home_after is not None:
            console.print(f"home      {home_after_in_words(now.home_after.after_s)}")
        console.print(f"fisheye   {_said(now.fisheye)}")
        console.print(f"ptz       {_said(now.ptz)}")
        if now.pose is not None:
            console.print(f"pose      {pose_in_words(now.pose)}")
        if now.motor is not None:
            console.print(f"motor     {motor_in_words(now.motor)}")
        console.print(f"log       {_said(str(now.log.get('file', '–')))}")
        return 0

    return with_client(arguments, work)


def lease(arguments: argparse.Namespace) -> int:
    """Have the head until interrupted or until it is over; exit 1 when it ends before it is given back."""

    async def work(client: Client) -> int:
        if arguments.ask:
            told = await client.ask_lease(LeaseRequest(owner=arguments.owner, wish="ask"))
            print(plain(held_in_words(told.lease)))
            return 0
        async with client.lease(arguments.owner, for_s=arguments.for_s, rank=arguments.rank) as kept:
            print(plain(f"{held_in_words(kept.held)}; interrupt to give it back"), flush=True)
            print(plain(await kept.over()))
        return 1

    return with_client(arguments, work)


def clock_time(t_ns: int) -> str:
    """A time of day, as the clock of this machine shows it."""
    return datetime.fromtimestamp(t_ns / 1e9).astimezone().strftime("%H:%M:%S")


def pose_in_words(pose: Pose | ShadowPose) -> str:
    """Where a head looks, for a person."""
    return f"pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}°, zoom {pose.zoom:g}"


def motor_in_words(motor: MotorStatus) -> str:
    """What the motors have gone, for a person."""
    moves = "" if motor.moves_per_hour is None else f" of {motor.moves_per_hour}"
    degrees = "" if motor.degrees_per_hour is None else f" of {motor.degrees_per_hour:g}°"
    return (
        f"pan {motor.pan_deg:.0f}°, tilt {motor.tilt_deg:.0f}°, zoom {motor.zoom_steps:.0f} in its life; last hour "
        f"{motor.moves_last_hour}{moves} moves, {motor.degrees_last_hour:.0f}°{degrees}"
    )


def held_in_words(held: LeaseHeld | None) -> str:
    """Who has the head and until when, for a person."""
    if held is None:
        return "nobody has the head for himself"
    wanted = f", {held.wanted_by} wants it" if held.wanted_by else ""
    return f"{held.owner} has the head until {clock_time(held.until_ns)} at the latest{wanted}"


def goto_in_words(goto: GotoShown) -> str:
    """Where an operator sent the head, for a person."""
    by = f", sent by {goto.by}" if goto.by else ""
    if goto.there_ns is None:
        return f"on the way to {goto.place}{by}"
    until = "" if goto.until_ns is None else f" until {clock_time(goto.until_ns)}"
    return f"at {goto.place}{until}{by}"


def home_after_in_words(after_s: float | None) -> str:
    """When a head goes home that nobody wants, for a person."""
    return "the head does not go home by itself" if after_s is None else f"the head goes home after {after_s:g} s"


def patrol_in_words(patrol: PatrolShown) -> str:
    """How a patrol stands, for a person."""
    words = {
        "on the way": f"on the way to {patrol.place}",
        "there": f"at {patrol.place}" + ("" if patrol.until_ns is None else f" until {clock_time(patrol.until_ns)}"),
        "waiting": f"waits, goes on at {patrol.place}",
        "paused": f"paused ({patrol.paused}), goes on at {patrol.place}",
    }
    schedule = " (by the schedule)" if patrol.scheduled else ""
    trouble = f"; {patrol.trouble}" if patrol.trouble else ""
    return f"{patrol.patrol}{schedule}: {words.get(patrol.phase, patrol.phase)}{trouble}"


def watch(arguments: argparse.Namespace) -> int:
    """Print everything the rig says."""

    async def work(client: Client) -> int:
        async for name, document in notices(client):
            if arguments.json:
                print_json({"type": name, **document})
            elif name in {"Feedback", "RoiResult"}:
                print(plain(f"{name}: {document}"), flush=True)
            elif name == "Status":
                line = f"Status: {document['state']} {document['phase']} active {document['active']}"
                print(plain(line), flush=True)
        return 0

    return with_client(arguments, work)


def cancel(arguments: argparse.Namespace) -> int:
    """Take a request back."""

    async def work(client: Client) -> int:
        outcome = await client.cancel(arguments.id)
        print(plain(f"{arguments.id}: {outcome}"))
        return 0

    return with_client(arguments, work)


def control(arguments: argparse.Namespace) -> int:
    """Stop, home, hold, release."""

    async def work(client: Client) -> int:
        print(plain(await client.control(arguments.command)))
        return 0

    return with_client(arguments, work)


def ls(arguments: argparse.Namespace) -> int:
    """Rigs alive, a line each; exit 1 when there is none."""

    async def work(client: Client) -> int:
        rigs = await client.rigs()
        if arguments.json:
            print_json(rigs)
        else:
            print("\n".join(rigs) or "no rig is alive")
        return 0 if rigs else 1

    return with_client(arguments, work)
