"""One event of each kind, of which the core expects nothing."""

from __future__ import annotations

from ptzd.control import events as ev
from ptzd.model import Box, FrameRef, HeadLimits, HeadReading, Motion, Turn, Turned, ViewRef

HOME = HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
BOX = Box(x=330, y=230, w=40, h=32)
STALE = 999_999
"""An id that no command had."""
SECOND_NS = 1_000_000_000


def plain(kind: type[ev.Event], t_ns: int) -> ev.Event:
    """One event of a kind, of which the core expects nothing."""
    frame = FrameRef(seq=1, t_capture_ns=t_ns)
    limits = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999), top_deg_s=(100, 90), focus=(770, 9999))
    fields: dict[type[ev.Event], dict[str, object]] = {
        ev.RequestReceived: {"token": 9, "id": "new", "box": BOX},
        ev.PayloadRefused: {"token": 9, "code": "invalid", "message": "no", "field": "$"},
        ev.UpdateReceived: {"id": "a", "box": BOX},
        ev.CancelReceived: {"token": 9, "id": "a"},
        ev.ControlReceived: {"token": 9, "verb": ev.Verb.STOP},
        ev.LeaseAsked: {"token": 9, "wish": ev.LeaseWish.TAKE, "owner": "somebody"},
        ev.RangesAsked: {"token": 9},
        ev.MoveAsked: {"token": 9, "wish": ev.MoveWish.TO, "owner": "somebody"},
        ev.GotoAsked: {"token": 9, "place": "gate"},
        ev.HomeAfterAsked: {"token": 9, "after": None},
        ev.PatrolAsked: {"token": 9, "wish": ev.PatrolWish.START, "patrol": "night"},
        ev.PatrolDue: {"patrol": "night", "since": "2026-03-01T21:00:00Z"},
        ev.FrameArrived: {"frame": frame},
        ev.HeadReady: {"limits": limits, "reading": HOME},
        ev.DeviceLost: {"device": ev.Device.PTZ, "reason": "no answer"},
        ev.DeviceWell: {"device": ev.Device.PTZ},
        ev.HeadPolled: {"reading": HOME, "motion": Motion.STABLE},
        ev.ForeignMotion: {"reading": HOME},
        ev.HeadArrived: {"move_id": STALE, "reading": HOME},
        ev.HeadStalled: {"move_id": STALE, "reading": HOME, "reason": "blocked"},
        ev.LensAnswered: {"lens_id": STALE},
        ev.ViewTaken: {"grab_id": STALE, "view": ViewRef(frame=frame, reading=HOME, sigma_deg=0.01)},
        ev.ViewMissed: {"grab_id": STALE, "reason": "the camera stands elsewhere"},
        ev.ViewsCompared: {
            "found": Turned(verdict=Turn.SLIPPED, before=HOME, after=HOME, pan_off_deg=2.0),
            "reference": True,
        },
        ev.MatchFailed: {"match_id": STALE, "reason": "broken"},
    }
    if kind is ev.MatchFinished:
        return ev.MatchFinished(match_id=STALE, result=None)  # type: ignore[arg-type]  # not looked at
    return kind(**fields.get(kind, {}))
