"""Updates at any rate: the newest box waits for the look under way, and no lock is told that was not seen lately."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.activities.lock import CONFIRMED_LOOKS
from ptzd.control.states import State
from ptzd.model import Box, FrameRef, Outcome

SECOND_NS = 1_000_000_000


class Detector:
    """Sends boxes of one target, as a detector does, at a steady rate."""

    def __init__(self, world, *, rate_hz: float, speed_px_s: float = 0.0, name: str = "a") -> None:
        self.world, self.name = world, name
        self.period_s, self.speed_px_s = 1.0 / rate_hz, speed_px_s
        self.began_ns, self.seq = world.t_ns, 100

    @property
    def box(self) -> Box:
        return Box(x=330 + self.speed_px_s * (self.world.t_ns - self.began_ns) / SECOND_NS, y=230, w=40, h=32)

    def run(self, seconds: float) -> None:
        """Until the request has its result, at the latest after so many seconds."""
        for _ in range(math.ceil(seconds / self.period_s)):
            self.world.run(self.period_s)
            if self.world.results():
                return
            self.seq += 1
            self.world.frame(self.seq)
            self.world.tell(ev.UpdateReceived(id=self.name, box=self.box, frame_seq=self.seq))


def confirmations_ns(world) -> list[int]:
    """When looks confirmed the target."""
    return [t_ns for t_ns, step in world.steps if step in {"verify", "correction"}]


def watched(world):
    """Notes when each step of a request was told."""
    world.steps, tell = [], world.tell

    def told(event: ev.Event) -> list[cmd.Command]:
        commands = tell(event)
        world.steps += [(world.t_ns, c.step) for c in commands if isinstance(c, cmd.PublishFeedback)]
        return commands

    world.tell = told
    return world


@given(rate_hz=st.floats(0.1, 30.0), speed_px_s=st.sampled_from([0.0, 0.3, 2.0]))
def test_any_rate_locks_and_verifies(new_world, rate_hz: float, speed_px_s: float) -> None:
    world = watched(new_world())
    world.start()
    world.request("a", hold_s=12.0, timeout_s=20.0)
    Detector(world, rate_hz=rate_hz, speed_px_s=speed_px_s).run(60.0)
    world.run(30.0)
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.LOCKED, result.reason
    looks = confirmations_ns(world)
    every_ns = round(world.machine.config.lock.verify_every_s * SECOND_NS)
    assert max(later - earlier for earlier, later in pairwise(looks)) <= 2 * every_ns
    assert len(looks) >= 12.0 / world.machine.config.lock.verify_every_s - 2


@given(rate_hz=st.floats(0.1, 30.0), gone_after_s=st.floats(0.0, 20.0))
def test_locked_is_never_told_of_what_was_not_seen_lately(new_world, rate_hz: float, gone_after_s: float) -> None:
    world = watched(new_world())
    world.start()
    world.request("a", hold_s=15.0, timeout_s=20.0)
    detector = Detector(world, rate_hz=rate_hz, speed_px_s=1.5)
    detector.run(gone_after_s)
    world.score = 0.05
    detector.run(200.0)
    ended_ns = world.t_ns
    world.run(100.0)
    (result,) = world.results()["a"]
    looks = confirmations_ns(world)
    age_ns = ended_ns - max(looks, default=0)
    if result.outcome is Outcome.LOCKED:
        assert age_ns <= (CONFIRMED_LOOKS * world.machine.config.lock.verify_every_s + detector.period_s) * SECOND_NS
    else:
        assert result.outcome in {Outcome.LOST, Outcome.NOT_FOUND}


@pytest.mark.parametrize("score", [0.95, 0.05])
@pytest.mark.parametrize("hold_s", [2.0, 4.0, 6.0, 9.0])
def test_a_hold_whose_end_falls_into_a_slow_look_waits_for_it(world, config, hold_s: float, score: float) -> None:
    """No picture comes for long; whether the target is held is known only when the look is in."""
    watched(world).request("a", hold_s=hold_s)
    while not any(step == "locked" for _, step in world.steps):
        world.run(0.1)
    world.silent.add(cmd.GrabView)
    world.run(hold_s + 0.5)
    world.silent.clear()
    assert bool(world.results()) == (hold_s <= CONFIRMED_LOOKS * config.lock.verify_every_s)
    if not world.results():
        world.score = score
        world._perform(world.of(cmd.GrabView)[-1])
        world.run(5.0)
    assert world.results()["a"][0].outcome is (Outcome.LOCKED if hold_s <= 4.5 or score > 0.9 else Outcome.LOST)
    assert len([step for _, step in world.steps if step == "plan"]) == 1, "what is over is not searched for anew"


def test_the_newest_of_many_boxes_is_looked_at_next(world) -> None:
    world.request("a", hold_s=30.0)
    world.run(until=State.LOCK)
    looks = len(world.of(cmd.MoveHead))
    for seq, x in ((10, 334.0), (11, 338.0), (12, 342.0)):
        world.frame(seq)
        world.tell(ev.UpdateReceived(id="a", box=Box(x=x, y=230, w=40, h=32), frame_seq=seq))
    assert len(world.of(cmd.MoveHead)) == looks, "the look under way is not broken off"
    world.run(1.1)
    world.run(1.1)
    seen = {job.frame.seq for job in world.of(cmd.RunMatch)}
    assert 12 in seen
    assert not seen & {10, 11}


@given(rate_hz=st.floats(2.0, 30.0))
def test_no_more_frames_are_kept_than_are_of_use(new_world, rate_hz: float) -> None:
    """However fast and long updates come: that of the look, and that of the newest box."""
    world = new_world()
    world.start()
    world.request("a", hold_s=20.0)
    kept: set[FrameRef] = set()
    needed: list[bool] = []
    perform = world._perform

    def follow(command: cmd.Command) -> None:
        if isinstance(command, cmd.PinFrame):
            kept.add(command.frame)
            kept.difference_update(command.instead_of)
        elif isinstance(command, cmd.RunMatch):
            needed.append(command.frame in kept)
        assert len(kept) <= 2
        perform(command)

    kept.update(command.frame for command in world.of(cmd.PinFrame))
    world._perform = follow
    Detector(world, rate_hz=rate_hz, speed_px_s=1.0).run(40.0)
    assert all(needed)
    assert len(needed) > 5


@pytest.mark.parametrize("timeout_s", [1.0, 2.0, 3.0, 4.0, 7.0])
@pytest.mark.parametrize("fails", ["weak in the lock", "weak always", "no answer"])
def test_the_clients_time_is_kept_whatever_fails(make_world, timeout_s: float, fails: str) -> None:
    """Also when what was found is lost again before it is locked, and searched for anew."""
    world = make_world()
    world.start()
    world.request("a", timeout_s=timeout_s, hold_s=1.0)
    begun_ns = world.t_ns
    if fails == "weak in the lock":
        world.run(until=State.LOCK)
        world.score = 0.2
    elif fails == "weak always":
        world.score = 0.2
    else:
        world.silent.add(cmd.RunMatch)
    while not world.results():
        world.run(0.01)
        assert world.t_ns - begun_ns <= round((timeout_s + 0.01) * SECOND_NS)
    assert world.results()["a"][0].elapsed_ms <= 1000 * timeout_s


@pytest.mark.parametrize("late_ms", [0, 20, 200])
@pytest.mark.parametrize("timeout_s", [1.9, 2.0, 2.05, 2.1, 3.0])
def test_an_answer_after_the_clients_time_locks_nothing(world, timeout_s: float, late_ms: int) -> None:
    """The answer may come in before the word that the time is over."""
    watched(world).request("a", timeout_s=timeout_s, hold_s=1.0)
    begun_ns, wanted = world.t_ns, world.machine.deadline_ns
    world.machine.deadline_ns = lambda: None if wanted() is None else wanted() + late_ms * 1_000_000
    world.run(60.0)
    (result,) = world.results()["a"]
    locked = [t_ns - begun_ns for t_ns, step in world.steps if step == "locked"]
    assert all(after_ns <= timeout_s * SECOND_NS for after_ns in locked)
    assert result.outcome is (Outcome.LOCKED if locked else Outcome.TIMEOUT)
