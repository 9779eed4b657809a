"""The order of things: stamp, log, handle, log, perform; and nothing is decided here."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.model import Box, FrameRef, HeadReading
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.pump import Pump

STOP = cmd.StopHead()
STATUS = cmd.PublishStatus(state="IDLE", active=None, phase="", queue=(), fisheye="", ptz="", held=False)


class Core:
    """A machine by hand: what it answers to each event, and when it wants to be woken."""

    def __init__(self, story: list[tuple[str, object]]) -> None:
        self.story = story
        self.answers: dict[type[ev.Event], list[cmd.Command]] = {}
        self.deadline: int | None = None
        self.on_deadline: Callable[[], None] = lambda: None

    def handle(self, event: ev.Event, t_ns: int) -> list[cmd.Command]:
        self.story.append(("handled", event))
        if isinstance(event, ev.DeadlinePassed):
            self.deadline = None
        return self.answers.get(type(event), [])

    def deadline_ns(self) -> int | None:
        return self.deadline

    def snapshot(self) -> ev.Snapshot:
        return ev.Snapshot(state={"seen": len(self.story)})


class Hands:
    def __init__(self, story: list[tuple[str, object]]) -> None:
        self.story = story
        self.then: Callable[[], None] = lambda: None

    def perform(self, command: cmd.Command) -> None:
        self.story.append(("hands", command))
        self.then()


@pytest.fixture
def core(story) -> Core:
    return Core(story)


@pytest.fixture
async def pump(core, clock, log, bus, story) -> Pump:
    made = Pump(
        machine=core, clock=clock, log=log, bus=bus, frames=FrameStore(4),
        observers=(lambda t_ns, event, commands: story.append(("seen", (t_ns, event, commands))),),
    )  # fmt: skip
    made.hands = Hands(story)
    return made


async def test_an_event_is_logged_before_it_is_handled_and_commands_before_they_are_done(pump, core, story) -> None:
    core.answers[ev.HeadStopped] = [STOP, STATUS]
    pump.tell(ev.HeadStopped())
    event = ev.HeadStopped()
    assert story == [
        ("event", event),
        ("handled", event),
        ("command", STOP),
        ("command", STATUS),
        ("hands", STOP),
        ("performed", STATUS),
        ("seen", (10**12, event, [STOP, STATUS])),
    ]


async def test_what_is_told_while_performing_waits_its_turn(pump, core, story) -> None:
    core.answers[ev.HeadStopped] = [STOP, STATUS]
    core.answers[ev.DeviceWell] = []
    pump.hands.then = lambda: pump.tell(ev.DeviceWell(device=ev.Device.PTZ))
    pump.tell(ev.HeadStopped())
    kinds = [
        name if name != "handled" else type(what).__name__
        for name, what in story
        if name in {"handled", "performed", "seen"}
    ]
    assert kinds == ["HeadStopped", "performed", "seen", "DeviceWell", "seen"]


async def test_sequence_numbers_rise_by_one_and_stamps_never_fall(pump, clock, log, story) -> None:
    for _ in range(3):
        clock.t_ns += 5
        pump.tell(ev.HeadStopped())
    assert log.sequences == [1, 2, 3]
    assert log.stamps == [10**12 + 5, 10**12 + 10, 10**12 + 15]


async def test_a_log_is_cut_between_two_events_with_a_snapshot(pump, log, story) -> None:
    log.due = True
    pump.tell(ev.HeadStopped())
    pump.tell(ev.HeadStopped())
    assert [name for name, _ in story] == ["event", "handled", "seen", "cut", "event", "handled", "seen"]
    assert log.sequences == [1, 3]
    assert log.cuts[0][0] == 2


async def test_a_file_holds_one_set_of_settings(pump, log, story) -> None:
    """Whoever replays a file reads its settings at its head; a change is the last that a file tells."""
    pump.tell(ev.SettingsChanged())
    pump.tell(ev.HeadStopped())
    assert [name for name, _ in story] == ["event", "handled", "seen", "cut", "event", "handled", "seen"]


async def test_frames_are_pinned_and_released(pump, core, picture) -> None:
    frame = picture(7)
    pump._frames.add(frame)
    core.answers[ev.HeadStopped] = [cmd.PinFrame(request_id="a", frame=frame.frame)]
    core.answers[ev.DeadlinePassed] = [cmd.ReleaseFrames(request_id="a")]
    pump.tell(ev.HeadStopped())
    pump._frames.clear_ring()
    assert pump._frames.fisheye(frame.frame) is frame
    pump.tell(ev.DeadlinePassed())
    assert pump._frames.fisheye(frame.frame) is None


async def test_every_command_goes_to_hands_or_bus(pump, core, story) -> None:
    frame = FrameRef(seq=1, t_capture_ns=1)
    reading = HeadReading(pan_deg=0, tilt_deg=0, zoom=1)
    box = Box(x=1, y=1, w=9, h=9)
    to_hands = [cmd.MoveHead(move_id=1, target=reading), cmd.GrabView(grab_id=1, not_before_ns=0), cmd.AbandonMatches()]
    to_bus = [
        cmd.ReplyAccepted(token=1, id="a", frame=frame, position=0),
        cmd.ReplyRefused(token=1, code="busy", message="no", field="$"),
        cmd.ReplyOutcome(token=1, outcome="stopped"),
        cmd.PublishFeedback(id="a", step="note", detail={"box": str(box)}),
    ]
    core.answers[ev.HeadStopped] = [*to_hands, *to_bus, cmd.Finished()]
    pump.tell(ev.HeadStopped())
    assert [what for name, what in story if name == "hands"] == to_hands
    assert [what for name, what in story if name == "performed"] == to_bus
    assert pump.finished.is_set()


async def test_a_deadline_comes_when_it_is_due_and_not_before(pump, core, clock, story, settled) -> None:
    keeping = asyncio.create_task(pump.keep_deadlines())
    await settled()
    assert story == []
    core.deadline = clock.t_ns + 1_000_000
    pump.tell(ev.HeadStopped())
    await settled()
    assert [type(what).__name__ for name, what in story if name == "handled"] == ["HeadStopped"]
    clock.t_ns += 1_000_000
    async with asyncio.timeout(100):
        while core.deadline is not None:  # noqa: ASYNC110
            await asyncio.sleep(0.001)
    assert [type(what).__name__ for name, what in story if name == "handled"] == ["HeadStopped", "DeadlinePassed"]
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)


async def test_an_error_of_the_core_leaves_the_pump_usable(pump, core, story) -> None:
    def fail(event: ev.Event, t_ns: int) -> list[cmd.Command]:
        raise AssertionError("no such way")

    handle, core.handle = core.handle, fail
    with pytest.raises(AssertionError, match="no such way"):
        pump.tell(ev.HeadStopped())
    core.handle = handle
    pump.tell(ev.HeadStopped())
    assert [name for name, _ in story] == ["event", "event", "handled", "seen"]
