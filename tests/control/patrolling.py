"""What the tests of patrols say to a core, and what they read from it."""

from __future__ import annotations

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import PatrolShown

SECOND_NS = 1_000_000_000
WAY_S = 0.8
"""How long the head of these tests takes to any place."""
PAN = {"gate": 40.0, "yard": -35.0}


def ask(world, wish: str = "start", patrol: str = "", **fields: object) -> list[cmd.Command]:
    token = fields.pop("token", 7)
    return world.tell(ev.PatrolAsked(token=token, wish=ev.PatrolWish(wish), patrol=patrol))


def start(world, patrol: str = "night") -> list[cmd.Command]:
    return ask(world, "start", patrol)


def control(world, verb: ev.Verb) -> list[cmd.Command]:
    return world.tell(ev.ControlReceived(token=9, verb=verb))


def due(world, patrol: str, since: str) -> list[cmd.Command]:
    return world.tell(ev.PatrolDue(patrol=patrol, since=since))


def shown(world) -> PatrolShown | None:
    return world.of(cmd.PublishStatus)[-1].patrol


def refused(commands: list[cmd.Command]) -> cmd.ReplyRefused:
    (told,) = [command for command in commands if isinstance(command, cmd.ReplyRefused)]
    return told


def went_to(world) -> list[str]:
    """Places that the head was sent to, in order."""
    pans = [command.target.pan_deg for command in world.of(cmd.MoveHead)]
    return [next((name for name, pan in PAN.items() if abs(pan - at) < 0.1), "elsewhere") for at in pans]
