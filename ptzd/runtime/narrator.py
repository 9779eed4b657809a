"""One line in the journal for what an operator wants to know: states, devices, requests and how they ended."""

from __future__ import annotations

import logging

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.model import Outcome

_log = logging.getLogger("ptzd")
_GOOD = frozenset({Outcome.LOCKED, Outcome.RELEASED, Outcome.CANCELLED, Outcome.PREEMPTED})


class Narrator:
    """Shown every step of the core, writes about a few of them."""

    def __init__(self) -> None:
        self._state = ""

    def seen(self, sequence: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step."""
        del sequence
        match event:
            case ev.DeviceLost():
                _log.error("%s lost: %s", event.device, event.reason, extra={"device": event.device})
            case ev.DeviceWell():
                _log.info("%s is well", event.device, extra={"device": event.device})
            case ev.RequestReceived() if any(isinstance(command, cmd.PinFrame) for command in commands):
                _log.info("request %s accepted", event.id, extra={"request": event.id})
            case ev.MatchFailed():
                _log.warning("match %d failed: %s", event.match_id, event.reason)
            case ev.ForeignMotion():
                _log.warning("somebody else moves the camera", extra={"device": ev.Device.PTZ})
            case _:
                pass
        for command in commands:
            self._tell(command)

    def _tell(self, command: cmd.Command) -> None:
        match command:
            case cmd.ReplyRefused():
                _log.warning("refused: %s: %s (%s)", command.field, command.message, command.code)
            case cmd.PublishResult():
                level = logging.INFO if command.outcome in _GOOD else logging.WARNING
                text = "request %s: %s after %.1f s: %s"
                seconds = command.elapsed_ms / 1000
                extra = {"request": command.id}
                _log.log(level, text, command.id, command.outcome, seconds, command.reason, extra=extra)
            case cmd.PublishStatus() if command.state != self._state:
                level = logging.ERROR if command.state == State.FAULT else logging.DEBUG
                _log.log(level, "%s → %s", self._state or "–", command.state)
                self._state = command.state
            case _:
                pass
