"""A person has the head for himself: what makes way, what waits, and how it ends."""

from __future__ import annotations

import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.model import Outcome

SECOND_NS = 1_000_000_000


def ask(world, wish: str, owner: str = "desk", **fields: object) -> list[cmd.Command]:
    token = fields.pop("token", 7)
    return world.tell(
        ev.LeaseAsked(token=token, wish=ev.LeaseWish(wish), owner=owner, **fields),
    )


def lease_of(world) -> cmd.LeaseHeld | None:
    return world.of(cmd.PublishStatus)[-1].lease


def answer(commands: list[cmd.Command]) -> cmd.ReplyLease | cmd.ReplyRefused:
    (told,) = [command for command in commands if isinstance(command, cmd.ReplyLease | cmd.ReplyRefused)]
    return told


def keep(world, seconds: float) -> None:
    """Let time pass with somebody who says that he is still there."""
    for _ in range(round(seconds)):
        world.run(1.0)
        ask(world, "renew", token=None)


def test_what_is_served_makes_way_and_the_head_stops_before_it_is_his(world) -> None:
    world.request("a", hold_s=20.0)
    world.run(until=State.LOCK)
    told = ask(world, "take", for_s=60.0)
    assert world.results()["a"][0].outcome is Outcome.PREEMPTED
    assert "desk has taken the head" in world.results()["a"][0].reason
    assert [type(command) for command in told if isinstance(command, cmd.StopHead)] == [cmd.StopHead]
    assert world.machine.state is State.IDLE
    world.run(until=State.MANUAL)
    held = answer(told).lease
    assert held == lease_of(world)
    assert (held.owner, held.since_ns, held.until_ns) == ("desk", held.since_ns, held.since_ns + 60 * SECOND_NS)


def test_requests_wait_for_the_end_of_it(world) -> None:
    ask(world, "take")
    world.request("later", token=2, priority=9, hold_s=0.0)
    keep(world, 20.0)
    assert world.machine.state is State.MANUAL
    assert world.of(cmd.MoveHead) == []
    ask(world, "give")
    assert lease_of(world) is None
    world.run(until=State.HOME)
    assert world.results()["later"][0].outcome is Outcome.LOCKED


def test_what_the_last_one_asked_for_waits_for_the_next_ones_hand(world) -> None:
    """Under his lease it went before him; the next person's lease goes before it."""
    world.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    ask(world, "take", "gate")
    world.request("his", token=2, by="gate", hold_s=0.0)
    ask(world, "give", "gate")
    ask(world, "take", "desk")
    world.run(1.0)
    assert world.machine.state is State.MANUAL
    assert world.of(cmd.MoveHead) == []
    ask(world, "give", "desk")
    world.run(until=State.HOME)
    assert world.results()["his"][0].outcome is Outcome.LOCKED


def test_who_is_silent_has_it_no_more(world) -> None:
    ask(world, "take")
    world.request("later", token=2, hold_s=0.0)
    world.run(until=State.SCAN)
    assert world.t_ns - 1_000_000_000_000 == 5 * SECOND_NS
    assert lease_of(world) is None
    assert answer(ask(world, "renew")).code == "lost"


def test_his_time_ends_although_he_says_that_he_is_there(world) -> None:
    ask(world, "take", for_s=8.0)
    keep(world, 7.0)
    assert lease_of(world) is not None
    keep(world, 2.0)
    assert lease_of(world) is None


def test_the_second_is_told_who_has_it_and_may_ask(world) -> None:
    ask(world, "take", for_s=60.0)
    keep(world, 3.0)
    told = answer(ask(world, "take", "gate"))
    assert told.code == "leased"
    assert told.message.startswith("desk has had the head for 3 s and may have it 57 s more")
    assert answer(ask(world, "ask", "gate")).lease.wanted_by == "gate"
    assert lease_of(world).wanted_by == "gate"
    assert lease_of(world).owner == "desk"


def test_a_higher_rank_takes_it(world) -> None:
    ask(world, "take")
    ask(world, "take", "gate", rank=1)
    assert lease_of(world).owner == "gate"
    assert answer(ask(world, "renew")).code == "leased"
    assert answer(ask(world, "take", rank=1)).code == "leased"


def test_what_he_asks_for_himself_is_done_and_then_it_is_his_again(world) -> None:
    ask(world, "take")
    world.run(until=State.MANUAL)
    world.request("later", token=2, priority=9, hold_s=0.0)
    world.request("mine", token=3, by="desk", hold_s=0.0)
    assert world.machine.state is State.SCAN
    while "mine" not in world.results():
        keep(world, 1.0)
    assert world.results()["mine"][0].outcome is Outcome.LOCKED
    assert world.machine.state is State.MANUAL
    assert "later" not in world.results()


def test_a_stop_goes_before_it_and_leaves_it_to_him(world) -> None:
    ask(world, "take")
    world.tell(ev.ControlReceived(token=8, verb=ev.Verb.STOP))
    assert world.machine.state is State.IDLE
    assert lease_of(world).owner == "desk"
    world.run(until=State.MANUAL)
    world.run(60.0)
    assert lease_of(world) is None
    assert world.of(cmd.MoveHead) == [], "after a stop the head stays"


def test_nobody_sends_it_home_meanwhile(world) -> None:
    ask(world, "take")
    (told,) = world.tell(ev.ControlReceived(token=8, verb=ev.Verb.HOME))
    assert told.code == "leased"
    assert "desk" in told.message


@pytest.mark.parametrize("device", list(ev.Device))
def test_a_device_that_comes_back_finds_it_his(world, device) -> None:
    ask(world, "take")
    world.tell(ev.DeviceLost(device=device, reason="unplugged"))
    assert world.machine.state is State.FAULT
    keep(world, 4.0)
    world.tell(ev.DeviceWell(device=device))
    world.run(2.0)
    assert world.machine.state is State.MANUAL


def test_for_ever_is_refused(world) -> None:
    told = answer(ask(world, "take", for_s=1e4))
    assert (told.code, told.field) == ("invalid", "$.for_s")
    assert "at most 900 s (lease.max_s)" in told.message
    assert world.machine.state is State.IDLE


def test_who_does_not_have_it_can_neither_give_nor_ask_in_vain(world) -> None:
    assert answer(ask(world, "give")).code == "lost"
    assert answer(ask(world, "ask")).code == "free"
    ask(world, "take")
    assert answer(ask(world, "give", "gate")).code == "leased"
    assert lease_of(world).owner == "desk"


def test_it_is_in_the_snapshot(world, rig, config) -> None:
    ask(world, "take", rank=2)
    world.run(2.0)
    heir = Machine.restored(rig, config, world.machine.snapshot())
    assert heir.state is State.MANUAL
    assert heir.deadline_ns() == world.machine.deadline_ns()
    event = ev.LeaseAsked(token=1, wish=ev.LeaseWish.TAKE, owner="gate", rank=2)
    assert heir.handle(event, world.t_ns) == world.machine.handle(event, world.t_ns)
