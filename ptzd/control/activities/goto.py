"""A named place that an operator sent the head to: one move, and a while there."""

from __future__ import annotations

import math
from typing import ClassVar

from ptzd.control import commands as cmd
from ptzd.control.activities.activity import Activity, Failure, Over, Step
from ptzd.control.planning.by_hand import shown_pose
from ptzd.control.states import State
from ptzd.control.work import Work
from ptzd.model import GotoShown, HeadReading, Outcome


class Goto(Activity, kw_only=True, tag="goto"):
    """The head goes to a place and stays there; whoever asked hears when it is there, or why it is not."""

    state: ClassVar[State] = State.GOTO
    place: str
    target: HeadReading
    hold_ns: int
    since_ns: int
    by: str = ""
    token: int | None = None
    """The query that waits for the arrival; None once it is answered."""
    there_ns: int | None = None

    def begin(self, work: Work) -> Step:
        """Go there; the camera may have told of other limits while this waited."""
        limits = work.head.limits
        if limits is None or not limits.contains(self.target):
            return Over(outcome=Outcome.UNREACHABLE, reason=f"{self.place} is outside the head's limits by now")
        work.move(self.target)
        return None

    def phase_now(self) -> str:
        """See `Activity`."""
        return "on the way" if self.there_ns is None else "there"

    def on_arrived(self, work: Work) -> Step:
        """Answer, and stay."""
        self.there_ns = work.t_ns
        if self.token is not None:
            work.out.append(self._answer(work, self.token))
            self.token = None
        return self.on_time(work)

    def _answer(self, work: Work, token: int) -> cmd.Command:
        pose, hfov_deg = shown_pose(work.rig, self.target), math.degrees(work.rig.camera(self.target).hfov_rad)
        if work.config.shadow.enabled:
            where = f"pan {pose.pan_deg:.2f}°, tilt {pose.tilt_deg:.2f}°, {hfov_deg:.1f}° wide"
            message = f"nothing moves in shadow mode; the head would be at {self.place} now, {where}"
            return cmd.ReplyRefused(token=token, code="shadow", message=message, field="$")
        return cmd.ReplyGoto(token=token, place=self.place, pose=pose, hfov_deg=hfov_deg)

    def on_failed(self, work: Work, failure: Failure) -> Step:
        """It is not tried again: whoever asked is told."""
        del work
        return Over(outcome=Outcome.UNREACHABLE, reason=f"the head did not get to {self.place}: {failure.reason}")

    def on_time(self, work: Work) -> Step:
        """The head is free again, unless an operator keeps it where it is."""
        until_ns = self.wakes_ns(work)
        return Over() if until_ns is not None and work.t_ns >= until_ns else None

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        return None if self.there_ns is None or work.head.held else self.there_ns + self.hold_ns

    def shown(self, *, held: bool) -> GotoShown:
        """As others see it."""
        until_ns = None if self.there_ns is None or held else self.there_ns + self.hold_ns
        return GotoShown(
            place=self.place, by=self.by, since_ns=self.since_ns, there_ns=self.there_ns, until_ns=until_ns
        )
