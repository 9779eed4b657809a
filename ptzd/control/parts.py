"""The parts of the core over one memory, and who of them answers to which event."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from ptzd.control import events as ev
from ptzd.control.answers import Answers
from ptzd.control.authority import Authority
from ptzd.control.desk import Desk
from ptzd.control.gotos import Gotos
from ptzd.control.health import Health
from ptzd.control.learning import Lessons
from ptzd.control.leases import Leases
from ptzd.control.memory import Memory
from ptzd.control.moves import Moves
from ptzd.control.operator import Operator
from ptzd.control.patrols import Patrols
from ptzd.control.reception import Reception
from ptzd.control.work import Work

Handler = Callable[[Any], None]
"""Takes one kind of event."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parts:
    """What the machine itself turns to."""

    answers: Answers
    operator: Operator
    handlers: dict[type[ev.Event], Handler]


def parts_of(memory: Memory, work: Work) -> Parts:
    """Put them together."""
    desk = Desk(memory=memory, work=work)
    authority = Authority(memory=memory, work=work, desk=desk)
    operator = Operator(memory=memory, work=work, desk=desk, authority=authority)
    health = Health(memory=memory, work=work, authority=authority)
    reception = Reception(memory=memory, desk=desk, authority=authority)
    answers = Answers(memory=memory, work=work, desk=desk, authority=authority)
    leases = Leases(memory=memory, work=work, desk=desk, authority=authority)
    patrols = Patrols(memory=memory, work=work, desk=desk, authority=authority)
    handlers: dict[type[ev.Event], Handler] = {
        ev.RequestReceived: reception.on_request,
        ev.PayloadRefused: desk.refuse_payload,
        ev.UpdateReceived: reception.on_update,
        ev.CancelReceived: reception.on_cancel,
        ev.ControlReceived: operator.on_control,
        ev.LeaseAsked: leases.on_asked,
        ev.MoveAsked: Moves(memory=memory, work=work, leases=leases, authority=authority).on_asked,
        ev.GotoAsked: Gotos(memory=memory, work=work, desk=desk, authority=authority).on_asked,
        ev.RangesAsked: Lessons(work=work).on_asked,
        ev.HomeAfterAsked: operator.on_home_after,
        ev.PatrolAsked: patrols.on_asked,
        ev.PatrolDue: patrols.on_due,
        ev.FrameArrived: health.on_frame,
        ev.HeadReady: health.on_head_ready,
        ev.DeviceLost: health.on_lost,
        ev.DeviceWell: health.on_well,
        ev.HeadPolled: health.on_polled,
        ev.ViewsCompared: health.on_compared,
        ev.ForeignMotion: health.on_foreign_motion,
        ev.HeadArrived: answers.on_arrived,
        ev.HeadStalled: answers.on_stalled,
        ev.HeadStopped: operator.on_stopped,
        ev.LensAnswered: answers.on_lens,
        ev.ViewTaken: answers.on_view,
        ev.ViewMissed: answers.on_view_missed,
        ev.MatchFinished: answers.on_match,
        ev.MatchFailed: answers.on_match_failed,
        ev.DeadlinePassed: answers.on_deadline,
        ev.SettingsChanged: operator.on_settings,
        ev.ShutdownRequested: operator.on_shutdown,
    }
    return Parts(answers=answers, operator=operator, handlers=handlers)
