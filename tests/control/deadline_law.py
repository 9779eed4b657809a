"""A law over random lives: the core wants to be woken exactly while something is under way."""

from __future__ import annotations

from ptzd.control import commands as cmd
from ptzd.control.states import WORKING, State


def _goes(status: cmd.PublishStatus) -> bool:
    """Whether an operator's goto wants its time: while it is kept at its place by `hold` it does not."""
    goto = status.goto
    return goto is not None and (goto.there_ns is None or not status.held)


def check_deadline(life) -> None:
    """Armed exactly while something is under way; the only thing besides is going home after a while."""
    deadline, status = life.machine.deadline_ns(), life.status
    under_way = bool(life.matches) or life.stop_sent_ns is not None or status.active is not None or status.queue
    if any(isinstance(command, cmd.Finished) for command in life.done):
        assert deadline is None
    elif under_way or life.machine.state in WORKING | {State.HOME} or status.lease or _goes(status):
        assert deadline is not None
    elif life.machine.state is not State.IDLE and status.patrol is None and not life.lenses:
        assert deadline is None
