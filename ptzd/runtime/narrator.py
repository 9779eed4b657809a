"""One line in the journal for what an operator wants to know: states, devices, requests and how they ended."""

from __future__ import annotations

import logging

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.model import REFUSED, GotoShown, LeaseHeld, Outcome, PatrolShown

_log = logging.getLogger("ptzd")
_GOOD = frozenset({Outcome.LOCKED, Outcome.RELEASED, Outcome.CANCELLED, Outcome.PREEMPTED})
_MESSAGES = (
    ev.RequestReceived,
    ev.UpdateReceived,
    ev.CancelReceived,
    ev.ControlReceived,
    ev.GotoAsked,
    ev.HomeAfterAsked,
    ev.LeaseAsked,
    ev.PatrolAsked,
    ev.PayloadRefused,
)
"""What comes from outside, as often as somebody likes."""
REFUSALS = 10
"""Lines about refusals within :data:`REFUSALS_NS`; what is beyond is counted and told afterwards."""
REFUSALS_NS = 10_000_000_000
CURE = "restart the camera, at its start it finds its zero (VAPIX has no other call for that), and look at its mount"
STILL_NS = 5_000_000_000
"""Without a foreign motion for so long, the next one is told again."""


class Narrator:
    """Shown every step of the core, writes about a few of them."""

    def __init__(self) -> None:
        self._state = ""
        self._since_ns = 0
        self._refusals = 0
        self._moved_ns: int | None = None
        self._doubt = ""
        self._lease: LeaseHeld | None = None
        self._goto: GotoShown | None = None
        self._patrol: PatrolShown | None = None

    def seen(self, t_ns: int, event: ev.Event, commands: list[cmd.Command]) -> None:
        """Look at one step."""
        self._tell_untold(t_ns)
        match event:
            case ev.DeviceLost():
                _log.error("%s lost: %s", event.device, event.reason, extra={"device": event.device})
            case ev.DeviceWell():
                _log.info("%s is well", event.device, extra={"device": event.device})
            case ev.RequestReceived() if any(isinstance(command, cmd.PinFrame) for command in commands):
                _log.info("request %s accepted", event.id, extra={"request": event.id})
            case ev.PayloadRefused(token=None) if not any(isinstance(told, cmd.PublishResult) for told in commands):
                self._refused(t_ns, event.field, event.message, event.code)
            case ev.MatchFailed():
                _log.warning("match %d failed: %s", event.match_id, event.reason)
            case ev.ForeignMotion():
                self._moved(t_ns)
            case ev.RangesAsked() if event.forget_all or event.forget_box or event.forget_last:
                box, last = event.forget_box, event.forget_last
                what = "all" if event.forget_all else f"those of the last {last} lock(s)"
                if box is not None:
                    what = f"those in {box.x:g},{box.y:g},{box.w:g},{box.h:g} px of the fisheye's picture"
                _log.info("asked to forget the ranges that locks have taught: %s", what)
            case ev.UpdateReceived(token=None) | ev.CancelReceived(token=None):
                self._unheard(t_ns, event, commands)
            case _:
                pass
        for command in commands:
            self._tell(t_ns, command, event)
            if isinstance(command, cmd.PublishStatus):
                self._tell_doubt(command.doubt)
                self._tell_lease(command.lease)
                self._tell_goto(command.goto)
                self._tell_patrol(command.patrol)

    def _tell(self, t_ns: int, command: cmd.Command, event: ev.Event) -> None:
        match command:
            case cmd.ReplyRefused() if not isinstance(event, _MESSAGES):
                # what a device did to somebody who waits, say for his stop: never lost among the nonsense of others
                _log.warning("refused: %s: %s (%s)", command.field, command.message, command.code)
            case cmd.ReplyRefused():
                self._refused(t_ns, command.field, command.message, command.code)
            case cmd.PublishResult() if command.outcome in REFUSED:
                self._refused(t_ns, command.id, command.reason, command.outcome)
            case cmd.PublishResult():
                level = logging.INFO if command.outcome in _GOOD else logging.WARNING
                text = "request %s: %s after %.1f s: %s"
                seconds = command.elapsed_ms / 1000
                extra = {"request": command.id}
                _log.log(level, text, command.id, command.outcome, seconds, command.reason, extra=extra)
            case cmd.RefuseMove():
                _log.warning("not moved: %s", command.reason, extra={"device": ev.Device.PTZ})
            case cmd.PublishStatus() if command.state != self._state:
                level = logging.ERROR if command.state == State.FAULT else logging.DEBUG
                _log.log(level, "%s → %s", self._state or "–", command.state)
                self._state = command.state
            case _:
                pass

    def _tell_doubt(self, doubt: str) -> None:
        before, self._doubt = self._doubt, doubt
        extra = {"device": ev.Device.PTZ}
        if doubt and doubt.partition(":")[0] != before.partition(":")[0]:
            _log.error("the head is in doubt: %s; %s", doubt, CURE, extra=extra)
        elif before and not doubt:
            _log.warning("the head is believed again: its pictures show what it reports", extra=extra)

    def _tell_lease(self, lease: LeaseHeld | None) -> None:
        before, self._lease = self._lease, lease
        if lease is None:
            if before is not None:
                _log.info("%s has the head no more", before.owner)
        elif before is None or before.owner != lease.owner:
            seconds = (lease.until_ns - lease.since_ns) / 1e9
            _log.info("%s has the head for himself, for at most %.0f s", lease.owner, seconds)
        elif lease.wanted_by and lease.wanted_by != before.wanted_by:
            _log.info("%s wants the head, which %s has", lease.wanted_by, lease.owner)

    def _tell_goto(self, goto: GotoShown | None) -> None:
        before, self._goto = self._goto, goto
        if goto is None:
            return
        by = f" by {goto.by}" if goto.by else ""
        if before is None or before.since_ns != goto.since_ns:
            _log.info("the head is sent to %s%s", goto.place, by)
        if goto.there_ns is not None and (before is None or before.there_ns != goto.there_ns):
            _log.info("the head is at %s after %.1f s", goto.place, (goto.there_ns - goto.since_ns) / 1e9)

    def _tell_patrol(self, patrol: PatrolShown | None) -> None:
        before, self._patrol = self._patrol, patrol
        if patrol is None:
            if before is not None:
                _log.info("patrol %s is over", before.patrol)
            return
        if before is None or before.since_ns != patrol.since_ns:
            _log.info("patrol %s begins%s", patrol.patrol, ", by the schedule" if patrol.scheduled else "")
            before = None
        if patrol.paused and (before is None or not before.paused):
            _log.info("patrol %s is paused: %s", patrol.patrol, patrol.paused)
        elif before is not None and before.paused and not patrol.paused:
            _log.info("patrol %s goes on at %s", patrol.patrol, patrol.place)
        if patrol.trouble and (before is None or before.trouble != patrol.trouble):
            _log.warning("patrol %s: %s", patrol.patrol, patrol.trouble)

    def _moved(self, t_ns: int) -> None:
        """Somebody at a joystick is told with every position; a motion that goes on is one piece of news."""
        if self._moved_ns is None or t_ns - self._moved_ns > STILL_NS:
            _log.warning("somebody else moves the camera", extra={"device": ev.Device.PTZ})
        self._moved_ns = t_ns

    def _unheard(self, t_ns: int, event: ev.UpdateReceived | ev.CancelReceived, commands: list[cmd.Command]) -> None:
        """A put that was refused: what the feedback says, for the journal."""
        for command in commands:
            if isinstance(command, cmd.PublishFeedback) and command.id == event.id and command.step == "note":
                self._refused(t_ns, "$", f"{event.id}: {command.detail.get('text', '')}", "put")

    def _refused(self, t_ns: int, what: str, message: str, code: str) -> None:
        """Whoever sends nonsense by the thousand must not fill the journal."""
        if not self._refusals:
            self._since_ns = t_ns
        self._refusals += 1
        if self._refusals <= REFUSALS:
            _log.warning("refused: %s: %s (%s)", what, message, code)

    def _tell_untold(self, t_ns: int) -> None:
        if not self._refusals or t_ns - self._since_ns < REFUSALS_NS:
            return
        if self._refusals > REFUSALS:
            seconds = (t_ns - self._since_ns) / 1e9
            _log.warning("refused: %d more within %.0f s, not shown", self._refusals - REFUSALS, seconds)
        self._refusals = 0
