"""A patrol: from place to place, behind everything else, and always back to where it was."""

from __future__ import annotations

import msgspec
import pytest

from ptzd.config_zones import HeadZone
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.model import Outcome, PatrolShown, ZoneKind
from tests.control.patrolling import SECOND_NS, WAY_S, ask, control, due, refused, shown, start, went_to


def test_it_goes_round_and_stays_as_long_as_it_says(world) -> None:
    told = start(world)
    (reply,) = [command for command in told if isinstance(command, cmd.ReplyPatrol)]
    assert reply.patrol == PatrolShown(patrol="night", place="gate", phase="on the way", since_ns=world.t_ns)
    begun_ns = world.t_ns
    twice_s = 2 * 19.0 + 5 * WAY_S
    world.run(twice_s - 0.001)
    assert went_to(world) == ["gate", "yard", "gate", "yard", "gate"], "its last place is its first"
    assert (shown(world).place, shown(world).phase) == ("gate", "there")
    assert shown(world).until_ns == begun_ns + round(twice_s * 1e9)
    assert world.machine.state is State.PATROL


def test_at_a_single_place_it_stays_without_moving_again(world) -> None:
    start(world, "alone")
    world.run(600.0)
    assert went_to(world) == ["yard"]


def test_a_request_goes_before_it_and_it_goes_on_where_it_was_for_the_rest_of_its_time(world) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    world.request("a", hold_s=0.0)
    assert world.machine.state is State.SCAN
    assert (shown(world).place, shown(world).phase) == ("gate", "waiting")
    world.run(until=State.PATROL)
    assert world.results()["a"][0].outcome is Outcome.LOCKED
    back_ns = world.t_ns
    world.run(WAY_S + 0.1)
    assert went_to(world)[-1] == "gate"
    assert shown(world).until_ns == back_ns + round((WAY_S + 6.0) * 1e9), "ten seconds, of which four were spent"


def test_interrupted_on_the_way_it_goes_on_to_the_same_place(world) -> None:
    start(world)
    world.run(WAY_S + 10.0 + 0.3)
    assert (shown(world).place, shown(world).phase) == ("yard", "on the way")
    world.request("a", hold_s=0.0)
    world.run(until=State.PATROL)
    world.run(WAY_S + 0.1)
    assert went_to(world)[-1] == "yard"
    assert (shown(world).place, shown(world).phase) == ("yard", "there")


def test_with_hardly_any_time_left_it_goes_on_to_the_next(world) -> None:
    start(world)
    world.run(WAY_S + 9.5)
    world.request("a", hold_s=0.0)
    assert shown(world).place == "yard"
    world.run(until=State.PATROL)
    assert went_to(world)[-1] == "yard"


def test_however_often_it_is_interrupted_it_gets_round(world) -> None:
    """Each request finds it at a place for a moment only; what it has had there counts."""
    start(world)
    seen = set()
    for number in range(40):
        world.run(WAY_S + 1.5)
        seen.add((shown(world).place, shown(world).phase))
        world.request(f"r{number}", token=100 + number, hold_s=0.0)
        world.run(until=State.PATROL)
    assert {place for place, _ in seen} == {"gate", "yard"}


def test_a_request_that_cannot_even_begin_does_not_disturb_it(world) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    until_ns = shown(world).until_ns
    world.tell(
        ev.HeadReady(
            limits=type(world.limits)(pan_deg=(39.0, 41.0), tilt_deg=(-11.0, -9.0), zoom=(2000, 9999)),
            reading=world.reading,
        )
    )
    world.request("a", hold_s=0.0)
    assert world.results()["a"][0].outcome is Outcome.UNREACHABLE
    assert world.machine.state is State.PATROL
    assert shown(world).until_ns == until_ns


def test_an_operators_goto_goes_before_it(world) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    world.tell(ev.GotoAsked(token=8, place="yard", hold_s=2.0))
    world.run(until=State.PATROL)
    world.run(WAY_S)
    assert went_to(world) == ["gate", "yard", "gate"]


def test_a_person_with_a_lease_goes_before_it(world) -> None:
    start(world)
    world.tell(ev.LeaseAsked(token=8, wish=ev.LeaseWish.TAKE, owner="desk"))
    world.run(1.0)
    assert world.machine.state is State.MANUAL
    assert shown(world).phase == "waiting"
    world.tell(ev.LeaseAsked(token=8, wish=ev.LeaseWish.GIVE, owner="desk"))
    assert world.machine.state is State.PATROL


def test_begun_under_a_lease_it_waits_for_its_end(world) -> None:
    world.tell(ev.LeaseAsked(token=8, wish=ev.LeaseWish.TAKE, owner="desk"))
    world.run(1.0)
    start(world)
    assert (world.machine.state, shown(world).phase) == (State.MANUAL, "waiting")
    world.run(until=State.PATROL)


def test_paused_it_stands_still_until_it_is_let_go_on(world) -> None:
    start(world)
    world.run(0.3)
    told = ask(world, "pause")
    assert any(isinstance(command, cmd.StopHead) for command in told)
    world.run(600.0)
    assert world.machine.state is State.IDLE
    assert (shown(world).phase, shown(world).paused) == ("paused", "somebody paused it")
    assert went_to(world) == ["gate"]
    ask(world, "resume")
    assert world.machine.state is State.PATROL
    assert went_to(world) == ["gate", "gate"]


def test_paused_at_a_place_it_keeps_the_rest_of_its_time(world) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    told = ask(world, "pause")
    assert not any(isinstance(command, cmd.StopHead) for command in told), "the head stands already"
    world.run(60.0)
    ask(world, "resume")
    world.run(WAY_S)
    assert shown(world).until_ns == world.t_ns + 6 * SECOND_NS


def test_requests_are_served_while_it_is_paused_and_then_the_head_goes_home(world) -> None:
    start(world)
    ask(world, "pause")
    world.request("a", hold_s=0.0)
    world.run(until=State.HOME)
    assert world.results()["a"][0].outcome is Outcome.LOCKED
    world.run(600.0)
    assert world.machine.state is State.IDLE
    assert shown(world).phase == "paused"


@pytest.mark.parametrize("verb", [ev.Verb.STOP, ev.Verb.HOME])
def test_after_an_operators_stop_or_home_it_waits_for_a_word(world, verb) -> None:
    start(world)
    world.run(0.3)
    control(world, verb)
    world.run(600.0)
    assert world.machine.state is State.IDLE
    assert shown(world).paused == f"the operator asked for {verb}"
    ask(world, "resume")
    world.run(until=State.PATROL)


def test_held_it_waits_for_the_release(world) -> None:
    start(world)
    world.run(0.3)
    told = control(world, ev.Verb.HOLD)
    assert any(isinstance(command, cmd.StopHead) for command in told)
    world.run(600.0)
    assert (world.machine.state, shown(world).phase) == (State.IDLE, "waiting")
    control(world, ev.Verb.RELEASE)
    assert world.machine.state is State.PATROL


def test_ended_the_head_stands_and_goes_home_after_a_while(world) -> None:
    start(world)
    world.run(0.3)
    told = ask(world, "stop")
    assert any(isinstance(command, cmd.StopHead) for command in told)
    (reply,) = [command for command in told if isinstance(command, cmd.ReplyPatrol)]
    assert reply.patrol is None
    assert shown(world) is None
    world.reading = type(world.reading)(pan_deg=20.0, tilt_deg=0.0, zoom=1.0)
    world.run(until=State.HOME)


def test_somebody_at_the_joystick_has_quiet(world) -> None:
    start(world)
    world.run(WAY_S + 1.0)
    for _ in range(3):
        world.tell(ev.ForeignMotion(reading=world.reading))
        world.run(15.0)
        assert world.machine.state is State.IDLE
    world.run(6.0)
    assert world.machine.state is State.PATROL
    assert went_to(world) == ["gate", "gate"]


@pytest.mark.parametrize("device", list(ev.Device))
def test_after_a_lost_device_it_goes_on(world, device) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    world.tell(ev.DeviceLost(device=device, reason="unplugged"))
    assert shown(world).phase == "waiting"
    world.run(30.0)
    world.tell(ev.HeadReady(limits=world.limits, reading=world.reading))
    world.tell(ev.DeviceWell(device=device))
    world.run(WAY_S)
    assert went_to(world) == ["gate", "gate"]
    assert shown(world).until_ns == world.t_ns + 6 * SECOND_NS


def test_a_place_that_the_head_does_not_get_to_costs_its_time_and_is_told(world) -> None:
    start(world)
    (move,) = world.of(cmd.MoveHead)
    world.tell(ev.HeadStalled(move_id=move.move_id, reading=world.reading, reason="blocked"))
    assert shown(world).trouble == "the head did not get to gate: blocked"
    world.run(9.9)
    assert went_to(world) == ["gate"]
    world.run(0.2)
    assert went_to(world) == ["gate", "yard"]
    world.run(6.0 + 2 * WAY_S)
    assert shown(world).trouble == "", "the head got there the next time"


@pytest.mark.parametrize(
    ("patrol", "code", "message"),
    [
        ("nigth", "unknown_patrol", "no patrol 'nigth'; nearest: night"),
        ("", "unknown_patrol", "no patrol ''; there are night, far, nowhere and 1 more"),
        ("far", "unreachable", "patrol far: behind lies at pan 179.00°"),
    ],
)
def test_what_cannot_be_begun_is_refused_and_nothing_changes(world, patrol, code, message) -> None:
    start(world)
    told = refused(start(world, patrol))
    assert (told.token, told.code, told.message[: len(message)]) == (7, code, message)
    assert shown(world).patrol == "night"


@pytest.mark.parametrize("wish", ["pause", "resume", "stop"])
def test_without_a_patrol_there_is_nothing_to_say_to_it(world, wish) -> None:
    assert refused(ask(world, wish)).code == "no_patrol"
    start(world)
    assert refused(ask(world, wish, "alone")).message == "patrol night is under way, not alone"


def test_another_one_takes_its_place(world) -> None:
    start(world)
    world.run(WAY_S + 1.0)
    start(world, "alone")
    world.run(WAY_S)
    assert (shown(world).patrol, shown(world).place) == ("alone", "yard")


def test_a_place_in_a_no_go_zone_is_refused_at_the_start_and_passed_over_by_the_schedule(make_world) -> None:
    corners = ((-45.0, -5.0), (-25.0, -5.0), (-25.0, 15.0), (-45.0, 15.0))
    world = make_world(zones=(HeadZone(name="sun", kind=ZoneKind.NO_GO, corners_deg=corners),))
    world.start()
    told = refused(start(world))
    assert told.message.startswith("patrol night: yard lies at pan -35.00°, tilt 5.00°")
    assert told.message.endswith("in the no_go zone sun")
    due(world, "night", "2026-03-01T21:00:00Z")
    world.run(60.0)
    assert set(went_to(world)) == {"gate"}
    assert shown(world).trouble.startswith("yard is passed over: ")


def test_when_the_motors_budget_is_spent_it_stays_until_there_is_some_again(make_world, config) -> None:
    motor = msgspec.structs.replace(config.motor, moves_per_hour=10, reserve=0.3)
    world = make_world(motor=motor)
    world.start()
    start(world)
    world.run(1800.0)
    assert len(went_to(world)) == 4, "40 % of ten, what ranks below every request may use"
    assert "stays at" in shown(world).trouble
    assert "motor.moves_per_hour" in shown(world).trouble
    world.run(3600.0)
    assert 5 <= len(went_to(world)) <= 9
    world.request("a", hold_s=0.0)
    world.run(until=State.LOCK)
    assert world.machine.state is State.LOCK, "a request still finds a share"


def test_settings_read_again_change_it_from_the_next_place_on(world, config) -> None:
    start(world)
    world.run(WAY_S + 4.0)
    stays = (config.presets.patrols["night"][1], config.presets.patrols["night"][0])
    presets = msgspec.structs.replace(config.presets, patrols={"night": stays})
    world.tell(ev.SettingsChanged(parts={"presets": msgspec.to_builtins(presets)}))
    world.run(6.0 + WAY_S)
    gone = msgspec.structs.replace(config.presets, patrols={})
    world.tell(ev.SettingsChanged(parts={"presets": msgspec.to_builtins(gone)}))
    world.run(30.0)
    assert shown(world) is None
    assert world.of(cmd.ReplyRefused)[-1].message == "patrol night is no longer in presets.yaml"


def test_without_devices_it_waits_for_them(new_world) -> None:
    world = new_world()
    start(world)
    assert shown(world).phase == "waiting"
    world.start()
    assert world.machine.state is State.PATROL


def test_the_daemon_ends_with_it(world) -> None:
    start(world)
    world.tell(ev.ShutdownRequested())
    world.run(10.0)
    assert world.machine.state is State.STOPPED
    assert world.of(cmd.Finished) == [cmd.Finished()]
