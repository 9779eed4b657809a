"""Random lives of the core: whatever may come, likely or not, and the laws that hold after every event."""

from __future__ import annotations

import itertools
import random
from dataclasses import replace

import msgspec

from ptzd.config import core_parts
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.stop import STOP_GUARD_NS
from ptzd.control.machine import Machine
from ptzd.control.states import TRANSITIONS, WORKING, State
from ptzd.control.work import MATCH_GUARD_NS
from ptzd.model import FrameRef, HeadLimits, HeadPose, HeadReading, HomeAfter, Lens, Motion, ViewRef
from tests.control.deadline_law import check_deadline
from tests.control.lease_laws import LeaseLaws
from tests.control.patrol_laws import PatrolLaws
from tests.control.plain_events import BOX, HOME, SECOND_NS, plain

PEOPLE = ("desk", "gate")
MOVING = WORKING | {State.HOME, State.MANUAL, State.GOTO, State.PATROL}


class Life:
    """Drives one core with whatever may come, likely or not, and watches the laws after every event."""

    def __init__(self, world, chance: random.Random) -> None:
        self.world = world
        self.chance = chance
        self.pick = chance.choice
        self.machine: Machine = world.machine
        self.limits: HeadLimits = world.limits
        self.t_ns = world.t_ns
        self.told: list[tuple[ev.Event, int]] = []
        self.done: list[cmd.Command] = []
        self.tokens = itertools.count(1)
        self.asked: set[int] = set()
        self.names: list[str] = []
        self.accepted: set[str] = set()
        self.pinned: set[str] = set()
        self.ended: dict[str, int] = {}
        self.answered: dict[int, int] = {}
        self.head: cmd.MoveHead | cmd.SteerHead | cmd.GrabView | None = None
        self.lenses: list[int] = []
        self.matches: dict[int, tuple[int, cmd.RunMatch]] = {}
        self.stop_sent_ns: int | None = None
        self.stands = False
        self.seq = 0
        self.leases = LeaseLaws()
        self.patrols = PatrolLaws()

    # what may come

    def act(self, action: str) -> None:
        getattr(self, f"_{action}")()

    def _start(self) -> None:
        self._well_ptz()
        self._well_fisheye()
        self._frame()

    def _well_ptz(self) -> None:
        self.tell(ev.HeadReady(limits=self.limits, reading=HOME))
        self.tell(ev.DeviceWell(device=ev.Device.PTZ))

    def _well_fisheye(self) -> None:
        self.tell(ev.DeviceWell(device=ev.Device.FISHEYE))

    def _lost(self) -> None:
        device = self.pick(list(ev.Device))
        self.tell(ev.DeviceLost(device=device, reason=self.pick(["cut", "mute"])))

    def _frame(self) -> None:
        self.seq += 1
        self.tell(ev.FrameArrived(frame=FrameRef(seq=self.seq, t_capture_ns=self.t_ns - SECOND_NS // 20)))

    def _request(self) -> None:
        self._frame()
        again = self.names and self.chance.random() < 0.1
        name = self.pick(self.names) if again else f"r{len(self.names)}"
        if name not in self.names:
            self.names.append(name)
        box = self.pick([*[BOX] * 6, replace(BOX, x=250), replace(BOX, x=635), replace(BOX, w=4)])
        zoom = self.pick(list(ev.ZoomWish))
        self.tell(
            ev.RequestReceived(
                token=self.pick([None, self._token(), self._token()]),
                id=name,
                box=box,
                frame_seq=self.pick([*[None] * 6, self.seq, 10**6]),
                zoom=zoom,
                hfov_deg=20.0 if zoom is ev.ZoomWish.HFOV else None,
                hold_s=self.pick([0.0, 1.0, 20.0]),
                timeout_s=self.pick([None, 3.0, 30.0]),
                priority=self.pick([0, 1, 2]),
                by=self.pick(["", "", *PEOPLE]),
            )
        )

    def _refused(self) -> None:
        name = self.pick([None, "bad"])
        token = None if name else self._token()
        self.tell(ev.PayloadRefused(token=token, code="invalid", message="no", field="$", id=name))

    def _update(self) -> None:
        self._frame()
        box = self.pick([replace(BOX, x=380), replace(BOX, x=700)])
        self.tell(ev.UpdateReceived(id=self._name(), box=box, frame_seq=self.seq))

    def _cancel(self) -> None:
        self.tell(ev.CancelReceived(token=self._token(), id=self._name()))

    def _control(self) -> None:
        verb = self.pick(list(ev.Verb))
        self.tell(ev.ControlReceived(token=self._token(), verb=verb))

    def _ranges(self) -> None:
        """Somebody asks what is known, or takes it back."""
        forget = self.pick([{}, {}, {"forget_last": 2}, {"forget_box": BOX}, {"forget_all": True}])
        self.tell(ev.RangesAsked(token=self.pick([None, self._token()]), **forget))

    def _lease(self) -> None:
        """Somebody takes the head, goes on, gives it back or wants it."""
        self.tell(
            ev.LeaseAsked(
                token=self.pick([None, self._token(), self._token()]),
                wish=self.pick([ev.LeaseWish.TAKE, *ev.LeaseWish]),
                owner=self.pick(PEOPLE),
                rank=self.pick([0, 0, 1]),
                for_s=self.pick([None, 2.0, 60.0, 1e5]),
            )
        )

    def _hand(self) -> None:
        """Somebody moves the head by hand, whether he has it or not."""
        wish = self.pick(list(ev.MoveWish))
        shown = HeadPose(pan_deg=self.pick([0.0, 30.0]), tilt_deg=-5.0, zoom=self.pick([1.0, 3000.0]))
        self.tell(
            ev.MoveAsked(
                token=self.pick([None, self._token()]),
                owner=self.pick(PEOPLE),
                wish=wish,
                pan_deg=self.pick([5.0, -60.0, 179.0]),
                tilt_deg=self.pick([2.0, -100.0]),
                point_px=(self.pick([100.0, 630.0, 700.0]), 200.0) if wish is ev.MoveWish.POINT else None,
                box_px=self.pick([BOX, replace(BOX, x=630)]) if wish is ev.MoveWish.BOX else None,
                picture=self.pick([None, shown]),
                pan_deg_s=self.pick([0.0, 20.0, -90.0, 200.0]),
                tilt_deg_s=self.pick([0.0, 10.0]),
                zoom_rate=self.pick([0.0, 1.0, -0.5]),
                hfov_deg=self.pick([None, None, 10.0, 170.0]),
                lens=Lens(focus=self.pick([None, 0, 900, 9])) if wish is ev.MoveWish.LENS else None,
            )
        )

    def _lens_answers(self) -> None:
        if self.lenses:
            self.tell(ev.LensAnswered(lens_id=self.lenses.pop(0), refused=self.pick(["", "Error: no"])))

    def _goto(self) -> None:
        """Somebody sends the head to a place, or to one that is none."""
        self.tell(
            ev.GotoAsked(
                token=self.pick([None, self._token(), self._token()]),
                place=self.pick(["gate", "yard", "behind", "nowhere"]),
                by=self.pick(["", *PEOPLE]),
                hold_s=self.pick([None, 0.0, 2.0]),
            )
        )

    def _patrol(self) -> None:
        """Somebody begins a patrol, lets it rest, go on or end."""
        self.tell(
            ev.PatrolAsked(
                token=self.pick([None, self._token(), self._token()]),
                wish=self.pick([ev.PatrolWish.START, ev.PatrolWish.RESUME, *ev.PatrolWish]),
                patrol=self.pick(["", "night", "night", "alone", "far", "nobody's"]),
            )
        )

    def _home_after(self) -> None:
        """Somebody says how long the head is left where it is."""
        after = self.pick([None, HomeAfter(after_s=None), HomeAfter(after_s=0.0), HomeAfter(after_s=60.0)])
        self.tell(ev.HomeAfterAsked(token=self.pick([None, self._token()]), after=after))

    def _due(self) -> None:
        """A window of the schedule begins or ends."""
        patrol, since = self.pick([("", ""), ("night", "1"), ("night", "2"), ("far", "3"), ("nowhere", "4")])
        self.tell(ev.PatrolDue(patrol=patrol, since=since))

    def _answer(self) -> None:
        """What is due: a match, else the head."""
        if self.matches and self.pick([True, False]):
            self._match_answers()
        else:
            self._head_answers()

    def _head_answers(self) -> None:
        self.t_ns += SECOND_NS // 4
        head, self.head = self.head, None
        if isinstance(head, cmd.MoveHead):
            self.world.reading = head.target
            self.tell(ev.HeadArrived(move_id=head.move_id, reading=head.target))
        elif isinstance(head, cmd.SteerHead):
            self.t_ns = max(self.t_ns, head.until_ns)
            self.tell(ev.HeadArrived(move_id=head.move_id, reading=self.world.reading))
        elif isinstance(head, cmd.GrabView):
            self.tell(ev.ViewTaken(grab_id=head.grab_id, view=self._view()))
        elif self.stop_sent_ns is not None:
            self.tell(ev.HeadStopped())

    def _head_fails(self) -> None:
        head, self.head = self.head, None
        if isinstance(head, cmd.MoveHead | cmd.SteerHead):
            self.tell(ev.HeadStalled(move_id=head.move_id, reading=HOME, reason="blocked"))
        elif isinstance(head, cmd.GrabView):
            if self.pick([True, False]):
                self._deadline()
            else:
                self.tell(ev.ViewMissed(grab_id=head.grab_id, reason="the camera stands elsewhere"))

    def _match_answers(self) -> None:
        self.t_ns += SECOND_NS // 50
        number, (_, job) = self.matches.popitem()
        self.world.score = self.pick([0.95] * 8 + [0.5, 0.1])
        self.world.texture = self.pick([9.0] * 9 + [0.2])
        self.tell(ev.MatchFinished(match_id=number, result=self.world.match(job)))

    def _match_fails(self) -> None:
        if self.matches:
            self.tell(ev.MatchFailed(match_id=self.matches.popitem()[0], reason="broken"))

    def _late_answer(self) -> None:
        """An answer to something long forgotten."""
        kind = self.pick([ev.HeadArrived, ev.HeadStalled, ev.MatchFailed, ev.ViewTaken, ev.ViewMissed])
        self.tell(plain(kind, self.t_ns))

    def _polled(self) -> None:
        self.tell(ev.HeadPolled(reading=self.world.reading, motion=self.pick(list(Motion))))

    def _foreign(self) -> None:
        reading = HeadReading(pan_deg=self.pick([-40.0, 70.0]), tilt_deg=5.0, zoom=1.0)
        self.tell(ev.ForeignMotion(reading=reading))

    def _deadline(self) -> None:
        """The time the core asked for comes, unless nothing is wanted."""
        deadline = self.machine.deadline_ns()
        if deadline is not None:
            self.t_ns = max(self.t_ns, deadline)
            self.tell(ev.DeadlinePassed())
            then = self.machine.deadline_ns()
            assert then is None or then > self.t_ns, "a deadline that was served does not come again"

    def _early_deadline(self) -> None:
        self.tell(ev.DeadlinePassed())

    def _settings(self) -> None:
        """Another wish of whoever edits the file; what was accepted before goes on."""
        config = self.machine.config
        other = msgspec.structs.replace(
            config,
            queue=msgspec.structs.replace(config.queue, size=self.pick([0, 1, 8])),
            lock=msgspec.structs.replace(config.lock, max_corrections=self.pick([0, 2]), fill=self.pick([0.3, 0.5])),
            home=msgspec.structs.replace(config.home, pan_deg=self.pick([0.0, 20.0])),
        )
        self.tell(ev.SettingsChanged(parts=core_parts(other)))

    def _wait(self) -> None:
        self.t_ns += round(self.pick([0.05, 0.5, 2.0]) * SECOND_NS)

    def _token(self) -> int:
        return next(self.tokens)

    def _name(self) -> str:
        return self.pick([*self.names[-3:], "nobody"])

    def _view(self) -> ViewRef:
        self.seq += 1
        return ViewRef(frame=FrameRef(seq=self.seq, t_capture_ns=self.t_ns), reading=self.world.reading, sigma_deg=0.01)

    # what must hold

    def tell(self, event: ev.Event) -> None:
        before, owner = self.machine.state, self.leases.owner(self)
        commands = self.machine.handle(event, self.t_ns)
        self.leases.check(self, event, owner, commands)
        self.told.append((event, self.t_ns))
        self.done += commands
        self.lenses += [command.lens_id for command in commands if isinstance(command, cmd.SetLens)]
        assert self.machine.state in TRANSITIONS[before, type(event)]
        self._note_event(event)
        for command in commands:
            self._note(command, event)
        moves = [type(told) for told in commands if isinstance(told, cmd.MoveHead | cmd.SteerHead | cmd.StopHead)]
        assert not moves or moves[-1] is cmd.StopHead or self.machine.state in MOVING, "nothing moves without a holder"
        check_deadline(self)
        self.patrols.check(self, event, commands)

    def _note_event(self, event: ev.Event) -> None:
        token = getattr(event, "token", None)
        if token is not None:
            self.asked.add(token)
        if isinstance(event, ev.HeadStopped) or self._stop_is_over(event):
            self.stop_sent_ns = None
        if isinstance(event, ev.DeadlinePassed):
            fresh = {n: (sent, job) for n, (sent, job) in self.matches.items() if self.t_ns < sent + MATCH_GUARD_NS}
            self.matches = fresh
        lost = isinstance(event, ev.DeviceLost)
        if lost and event.device is ev.Device.PTZ:
            self.head = None
        asks = (
            isinstance(event, ev.RequestReceived | ev.DeviceWell)
            or (isinstance(event, ev.ControlReceived) and event.verb is ev.Verb.HOME)
            or (isinstance(event, ev.LeaseAsked) and event.wish is ev.LeaseWish.TAKE)
            or isinstance(event, ev.GotoAsked | ev.PatrolDue)
            or (isinstance(event, ev.PatrolAsked) and event.wish in {ev.PatrolWish.START, ev.PatrolWish.RESUME})
        )
        if asks:
            self.stands = False

    def _stop_is_over(self, event: ev.Event) -> bool:
        if isinstance(event, ev.DeviceLost) and event.device is ev.Device.PTZ:
            return True
        sent = self.stop_sent_ns
        return isinstance(event, ev.DeadlinePassed) and sent is not None and self.t_ns >= sent + STOP_GUARD_NS

    def _note(self, command: cmd.Command, event: ev.Event) -> None:
        match command:
            case cmd.MoveHead() | cmd.SteerHead() | cmd.GrabView():
                if not isinstance(command, cmd.GrabView):
                    self._check_motion(command, event)
                self.head = command
            case cmd.StopHead():
                self.head, self.stop_sent_ns = None, self.t_ns
                self.stands = isinstance(event, ev.ControlReceived) and event.verb is ev.Verb.STOP
            case cmd.RunMatch():
                self.matches[command.match_id] = (self.t_ns, command)
            case cmd.AbandonMatches():
                self.matches.clear()
            case cmd.PinFrame():
                self.pinned.add(command.request_id)
                self.accepted.add(command.request_id)
            case cmd.ReleaseFrames():
                self.pinned.remove(command.request_id)
            case cmd.PublishFeedback():
                assert command.id in self.accepted
                assert command.id not in self.ended, "nothing is said of a request after its result"
            case cmd.PublishResult():
                self.ended[command.id] = self.ended.get(command.id, 0) + 1
                assert command.reason
                assert command.elapsed_ms >= 0
            case cmd.ReplyRefused(token=None):
                pass
            case (
                cmd.ReplyAccepted()
                | cmd.ReplyRefused()
                | cmd.ReplyOutcome()
                | cmd.ReplyLease()
                | cmd.ReplyMove()
                | cmd.ReplyGoto()
                | cmd.ReplyRanges()
                | cmd.ReplyPatrol()
                | cmd.ReplyHomeAfter()
            ):
                self.answered[command.token] = self.answered.get(command.token, 0) + 1
            case _:
                pass

    def _check_motion(self, command: cmd.MoveHead | cmd.SteerHead, event: ev.Event) -> None:
        assert self.stop_sent_ns is None, "nothing moves before a stop is confirmed"
        assert not self.stands or isinstance(event, ev.MoveAsked), "nothing moves after an operator's stop"
        assert self.machine.state is not State.STOPPED
        if isinstance(command, cmd.MoveHead):
            assert self.limits.contains(command.target)
        else:
            assert self.status.lease is not None, "only whoever has the head steers it"
            assert self.machine.state is State.MANUAL
            assert command.until_ns - self.t_ns <= 0.3 * SECOND_NS, "a speed ends by itself"

    @property
    def status(self) -> cmd.PublishStatus:
        empty = cmd.PublishStatus(state=State.STARTING, active=None, phase="", queue=(), fisheye="", ptz="", held=False)
        return next((command for command in reversed(self.done) if isinstance(command, cmd.PublishStatus)), empty)

    def end(self) -> None:
        """A patrol goes on; then the daemon ends, and now everything must have been answered, once."""
        self.patrols.resume(self)
        if self.machine.state is not State.STOPPED:
            self.tell(ev.ShutdownRequested())
        for _ in range(3):
            self._deadline()
        assert len([command for command in self.done if isinstance(command, cmd.Finished)]) == 1
        assert {name: self.ended.get(name) for name in self.accepted} == dict.fromkeys(self.accepted, 1)
        assert all(count == 1 for count in self.ended.values())
        assert self.pinned == set()
        assert self.answered == dict.fromkeys(self.asked, 1)
