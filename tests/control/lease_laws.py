"""Laws of leases over random lives: a leased head moves for its owner alone, and a lease ends by word, rank or time."""

from __future__ import annotations

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from tests.control.plain_events import SECOND_NS


class LeaseLaws:
    """Looks at every step of a life."""

    def __init__(self) -> None:
        self.by: dict[str, str] = {}
        self.lent: dict[str, str] = {}
        self.heard_ns = self.until_ns = 0

    def owner(self, life) -> str | None:
        lease = life.status.lease
        return None if lease is None else lease.owner

    def check(self, life, event: ev.Event, before: str | None, commands: list[cmd.Command]) -> None:
        """Nobody else's request moves a leased head; only its owner, a higher rank or time ends the lease."""
        if any(isinstance(command, cmd.PinFrame) for command in commands) and isinstance(event, ev.RequestReceived):
            self.by[event.id] = event.by
        new = [command for command in commands if isinstance(command, cmd.PublishStatus)]
        after = before if not new else None if new[-1].lease is None else new[-1].lease.owner
        if before is not None and after == before and not isinstance(event, ev.LeaseAsked | ev.MoveAsked):
            asked = [command for command in commands if isinstance(command, cmd.MoveHead)]
            active = (new[-1] if new else life.status).active
            if active is None:  # it may begin and end at once, when its time is over
                active = next((told.id for told in commands if isinstance(told, cmd.PublishFeedback)), None)
            goto = (new[-1] if new else life.status).goto
            if asked and goto is not None and active is None:
                assert goto.by == before, "only what he asked for moves"
            elif asked and active is None:
                assert isinstance(event, ev.HeadArrived), "only his own way around a zone goes on"
            else:
                assert not asked or self.by[active] in {before, self.lent.get(active)}, "only what he asked for moves"
            if active is not None:
                self.lent[active] = before
        silent = life.t_ns >= self.heard_ns + life.machine.config.lease.silence_s * SECOND_NS
        ends = isinstance(event, ev.ShutdownRequested) or silent or life.t_ns >= self.until_ns
        refused = any(isinstance(command, cmd.ReplyRefused) for command in commands)
        if isinstance(event, ev.LeaseAsked) and event.owner == after and not refused:
            self.heard_ns = life.t_ns
        if isinstance(event, ev.MoveAsked):
            moved = any(isinstance(command, cmd.MoveHead | cmd.SteerHead) for command in commands)
            assert not moved or event.owner == before, "nobody else's hand moves it"
            over = any(isinstance(command, cmd.ReplyRefused) and command.code == "lost" for command in commands)
            if event.owner == after and not over:
                self.heard_ns = life.t_ns
        if before is not None and after != before and isinstance(life.head, cmd.SteerHead) and _serving(life, event):
            assert any(isinstance(command, cmd.StopHead) for command in commands), "a hand that lets go stops the head"
        if new and new[-1].lease is not None:
            self.until_ns = new[-1].lease.until_ns
        told = isinstance(event, ev.LeaseAsked) and (event.owner == before or event.rank > 0)
        assert after == before or before is None or ends or told, (
            "a lease ends by its owner, a higher rank, or its time"
        )
        assert after is None or life.machine.state is not State.HOME, "nobody goes home while it is somebody's"


def _serving(life, event: ev.Event) -> bool:
    return life.status.ptz == "well" and not isinstance(event, ev.DeviceLost)
