"""What a shadow would have moved: each set point with the time that it would have taken, and for whom."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import HeadReading


@dataclass(slots=True, kw_only=True)
class Wish:
    """One move, or a stop."""

    t_ns: int
    request: str
    """Whose; empty outside of any request."""
    target: HeadReading | None = None
    """None: a stop."""
    move_id: int = 0
    seconds: float | None = None
    """Until it would have rested there; None: something else came before."""

    def __str__(self) -> str:
        whose = self.request or "rig"
        if self.target is None:
            return f"{whose}: stopped"
        to = f"pan {self.target.pan_deg:.2f}°, tilt {self.target.tilt_deg:.2f}°, zoom {self.target.zoom:.0f}"
        took = "something else came before it was there" if self.seconds is None else f"in {self.seconds:.1f} s"
        return f"{whose}: moved to {to}, {took}"


def note_wishes(wishes: list[Wish], t_ns: int, event: ev.Event, commands: Iterable[cmd.Command], request: str) -> None:
    """Take in one step: the end of the move under way, and what is wanted next.

    Parameters
    ----------
    wishes : list of Wish
        So far; added to.
    t_ns, event, commands
        The step.
    request : str
        Who is served after it.
    """
    if isinstance(event, ev.HeadArrived):
        for wish in wishes[-1:]:
            if wish.target is not None and wish.move_id == event.move_id:
                wish.seconds = round((t_ns - wish.t_ns) / 1e9, 3)
    for command in commands:
        match command:
            case cmd.MoveHead():
                wishes.append(Wish(t_ns=t_ns, request=request, target=command.target, move_id=command.move_id))
            case cmd.StopHead():
                wishes.append(Wish(t_ns=t_ns, request=request))
            case _:
                pass
