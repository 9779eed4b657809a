"""How long the head is left where it is: changed while the daemon runs, and told."""

from __future__ import annotations

import msgspec
import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.model import HomeAfter


def say(world, after: HomeAfter | None, token: int | None = 7) -> list[cmd.Command]:
    return world.tell(ev.HomeAfterAsked(token=token, after=after))


def answer(commands: list[cmd.Command]) -> float | None:
    (told,) = [command for command in commands if isinstance(command, cmd.ReplyHomeAfter)]
    return told.after_s


def homes(world, within_s: float) -> bool:
    moves = len(world.of(cmd.MoveHead))
    world.run(within_s)
    return len(world.of(cmd.MoveHead)) > moves


@pytest.fixture
def away(world):
    """The head rests somewhere after a request; five seconds later it would go home."""
    world.request("a", hold_s=0.0)
    world.run(until=State.IDLE)
    assert world.machine.state is State.IDLE
    return world


def test_later_sooner_never_and_as_the_settings_say(away) -> None:
    assert answer(say(away, HomeAfter(after_s=60.0))) == 60.0
    assert not homes(away, 59.0)
    assert answer(say(away, HomeAfter(after_s=None))) is None
    assert away.machine.deadline_ns() is None
    assert not homes(away, 86_400.0)
    assert answer(say(away, None)) == 5.0
    assert not homes(away, 4.9)
    assert homes(away, 0.2)


def test_at_once(away) -> None:
    say(away, HomeAfter(after_s=0.0), token=None)
    assert homes(away, 0.0)


@pytest.mark.parametrize("end", ["hold", "lease", "goto", "request"])
def test_left_no_time_at_all_it_goes_home_with_the_very_word_that_ends_what_had_it(make_world, config, end) -> None:
    world = make_world(home=msgspec.structs.replace(config.home, idle_s=0.0))
    world.start()
    if end == "goto":
        world.tell(ev.GotoAsked(token=1, place="gate", hold_s=2.0))
        world.run(until=State.GOTO)
    else:
        world.request("a", hold_s=2.0 if end == "hold" else 60.0, timeout_s=1.0 if end == "request" else None)
        world.silent = {cmd.RunMatch} if end == "request" else set()
    if end == "lease":
        world.run(until=State.LOCK)
        world.tell(ev.LeaseAsked(token=2, wish=ev.LeaseWish.TAKE, owner="desk"))
    world.run(until=State.HOME)
    assert world.machine.state is State.HOME


def test_it_holds_for_what_comes_and_status_tells(world) -> None:
    say(world, HomeAfter(after_s=20.0))
    assert world.of(cmd.PublishStatus)[-1].home_after == HomeAfter(after_s=20.0)
    world.request("a", hold_s=0.0)
    world.run(until=State.IDLE)
    assert not homes(world, 19.0)
    assert homes(world, 1.5)
    say(world, None)
    assert world.of(cmd.PublishStatus)[-1].home_after is None


def test_after_an_operators_stop_it_moves_nothing(away) -> None:
    away.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    away.run(1.0)
    say(away, HomeAfter(after_s=1.0))
    assert not homes(away, 600.0)


def test_settings_that_say_otherwise_are_newer(away, config) -> None:
    say(away, HomeAfter(after_s=None))
    same = msgspec.to_builtins(config.home)
    away.tell(ev.SettingsChanged(parts={"home": same}))
    assert away.of(cmd.PublishStatus)[-1].home_after == HomeAfter(after_s=None)
    away.tell(ev.SettingsChanged(parts={"home": {**same, "idle_s": 30.0}}))
    assert away.of(cmd.PublishStatus)[-1].home_after is None
    assert not homes(away, 29.0)
    assert homes(away, 1.5)


def test_it_is_in_the_snapshot(rig, config, away) -> None:
    say(away, HomeAfter(after_s=None))
    heir = Machine.restored(rig, config, away.machine.snapshot())
    assert heir.deadline_ns() is None
    (told,) = [
        c for c in heir.handle(ev.HomeAfterAsked(token=1, after=None), away.t_ns) if isinstance(c, cmd.ReplyHomeAfter)
    ]
    assert told.after_s == 5.0
    assert heir.deadline_ns() == away.t_ns + 5_000_000_000
