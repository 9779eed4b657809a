"""An operator sends the head to a named place: what makes way, what waits, who may, and what is refused."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from ptzd.config_zones import HeadZone
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.geometry.sphere import bearing, pan_tilt
from ptzd.model import GotoShown, Outcome, ZoneKind

SECOND_NS = 1_000_000_000


def goto(world, place: str = "gate", **fields: object) -> list[cmd.Command]:
    token = fields.pop("token", 7)
    return world.tell(ev.GotoAsked(token=token, place=place, **fields))


def lease(world, wish: str, owner: str = "desk", **fields: object) -> list[cmd.Command]:
    return world.tell(ev.LeaseAsked(token=8, wish=ev.LeaseWish(wish), owner=owner, **fields))


def shown(world) -> GotoShown | None:
    return world.of(cmd.PublishStatus)[-1].goto


def refused(commands: list[cmd.Command]) -> cmd.ReplyRefused:
    (told,) = [command for command in commands if isinstance(command, cmd.ReplyRefused)]
    return told


def looks_at(world) -> tuple[float, float]:
    """Azimuth and elevation, in the fisheye's frame, of where the head rests."""
    axis = world.rig.head_from_camera(world.reading) @ np.array([0.0, 0.0, 1.0])
    azimuth, elevation = pan_tilt(world.rig.head_from_fisheye_rotation.T @ axis)
    return math.degrees(float(azimuth)), math.degrees(float(elevation))


def test_it_goes_there_answers_stays_and_goes_home(world) -> None:
    assert goto(world) != []
    assert world.of(cmd.ReplyGoto) == []
    assert shown(world) == GotoShown(place="gate", by="", since_ns=world.t_ns)
    world.run(1.0)
    (answer,) = world.of(cmd.ReplyGoto)
    assert (answer.token, answer.place, answer.hfov_deg) == (7, "gate", pytest.approx(20.0))
    assert (answer.pose.pan_deg, answer.pose.tilt_deg) == pytest.approx((40.0, -10.0))
    assert looks_at(world) == pytest.approx((40.0, -10.0))
    hfov = world.rig.zoom.camera_at(world.reading.zoom).hfov_rad
    assert math.degrees(hfov) == pytest.approx(20.0)
    assert shown(world).until_ns == shown(world).there_ns + 8 * SECOND_NS
    world.run(7.0)
    assert world.machine.state is State.GOTO
    world.run(until=State.HOME)
    assert shown(world) is None
    assert len(world.of(cmd.ReplyGoto)) == 1


def test_what_is_served_makes_way_and_what_comes_waits(world) -> None:
    world.request("served", priority=9, hold_s=60.0)
    world.run(until=State.LOCK)
    goto(world, hold_s=2.0)
    assert world.results()["served"][0].outcome is Outcome.PREEMPTED
    assert world.results()["served"][0].reason == "the operator asked for gate"
    world.request("later", token=2, priority=9, hold_s=0.0)
    world.run(1.0)
    assert world.machine.state is State.GOTO
    world.run(until=State.HOME)
    assert world.results()["later"][0].outcome is Outcome.LOCKED


def test_a_full_queue_counts_behind_a_place_too(make_world, config) -> None:
    world = make_world(queue=msgspec.structs.replace(config.queue, size=1))
    world.start()
    goto(world)
    assert [type(c) for c in world.request("first", token=2) if isinstance(c, cmd.ReplyAccepted)]
    assert refused(world.request("second", token=3)).code == "busy"


def test_the_newest_word_counts(world) -> None:
    goto(world, token=1)
    told = goto(world, "yard", token=2)
    assert (refused(told).token, refused(told).code) == (1, "preempted")
    world.run(1.0)
    assert [answer.token for answer in world.of(cmd.ReplyGoto)] == [2]
    assert looks_at(world) == pytest.approx((-35.0, 5.0))


@pytest.mark.parametrize(
    ("place", "code", "message"),
    [
        ("gat", "unknown_place", "no place 'gat'; nearest: gate"),
        ("GATE", "unknown_place", "no place 'GATE'; nearest: gate"),
        ("x", "unknown_place", "no place 'x'; there are gate, yard, behind"),
        (
            "behind",
            "unreachable",
            "behind lies at pan 179.00°, tilt 0.00°, zoom 1018: outside the head's limits, pan -170",
        ),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence_and_nothing_changes(world, place, code, message) -> None:
    world.request("served", hold_s=60.0)
    world.run(until=State.LOCK)
    told = refused(goto(world, place))
    assert (told.token, told.code, told.field) == (7, code, "$.place")
    assert told.message.startswith(message)
    assert world.machine.state is State.LOCK
    assert world.results() == {}


def test_a_put_that_is_refused_is_told_to_the_journal(world) -> None:
    assert refused(goto(world, "nowhere", token=None)).token is None


def test_without_any_place_it_says_where_they_belong(make_world) -> None:
    world = make_world(presets=msgspec.convert({}, type(world_presets())))
    world.start()
    assert refused(goto(world)).message == "no place 'gate'; there are none; write them into presets.yaml"


def world_presets():
    from ptzd.presets import Presets

    return Presets()


def test_with_a_lease_its_owner_alone_may(world) -> None:
    lease(world, "take")
    world.run(1.0)
    assert refused(goto(world)).code == "leased"
    assert refused(goto(world, by="gate")).message.startswith("desk has the head for himself")
    goto(world, by="desk")
    world.run(1.0)
    assert [answer.place for answer in world.of(cmd.ReplyGoto)] == ["gate"]
    assert world.machine.state is State.MANUAL, "it is under his hand again, at that place"
    assert looks_at(world) == pytest.approx((40.0, -10.0))
    assert shown(world) is None


def test_his_hand_and_his_newest_word_go_before_a_place_that_he_asked_for(world) -> None:
    lease(world, "take")
    world.run(1.0)
    goto(world, by="desk", token=1)
    world.request("mine", token=2, by="desk")
    told = goto(world, "yard", by="desk", token=3)
    assert (refused(told).token, refused(told).message) == (1, "desk asked for yard")
    assert world.machine.state is State.GOTO, "his request waits for the place that he asked for after it"
    told = world.tell(ev.MoveAsked(token=4, wish=ev.MoveWish.BY, owner="desk", pan_deg=3.0))
    assert (refused(told).token, refused(told).message) == (3, "desk moves the head by hand")
    assert world.machine.state is State.MANUAL


def test_whoever_takes_the_head_ends_it(world) -> None:
    goto(world)
    told = lease(world, "take")
    assert refused(told).code == "preempted"
    assert refused(told).message == "desk has taken the head"
    assert any(isinstance(command, cmd.StopHead) for command in told)
    world.run(until=State.MANUAL)


def test_a_stop_ends_it_and_the_head_stays(world) -> None:
    goto(world)
    told = world.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    assert (refused(told).token, refused(told).code) == (7, "cancelled")
    world.run(60.0)
    assert world.machine.state is State.IDLE


def test_asked_before_a_stop_is_confirmed_it_waits_for_it(world) -> None:
    world.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    goto(world)
    assert world.of(cmd.MoveHead) == []
    assert shown(world).place == "gate"
    world.run(until=State.GOTO)
    assert len(world.of(cmd.MoveHead)) == 1


def test_hold_keeps_it_there_until_release(world) -> None:
    goto(world)
    world.run(1.0)
    world.tell(ev.ControlReceived(token=9, verb=ev.Verb.HOLD))
    assert shown(world).until_ns is None
    world.run(600.0)
    assert world.machine.state is State.GOTO
    world.tell(ev.ControlReceived(token=10, verb=ev.Verb.RELEASE))
    assert world.machine.state is State.IDLE
    world.run(until=State.HOME)


def test_a_held_head_goes_where_the_operator_says_and_is_kept_there(world) -> None:
    world.tell(ev.ControlReceived(token=9, verb=ev.Verb.HOLD))
    goto(world)
    world.run(600.0)
    assert world.machine.state is State.GOTO
    assert looks_at(world) == pytest.approx((40.0, -10.0))


def test_a_head_that_does_not_get_there_is_told(world) -> None:
    goto(world)
    (move,) = world.of(cmd.MoveHead)
    told = world.tell(ev.HeadStalled(move_id=move.move_id, reading=world.reading, reason="it rests elsewhere"))
    assert (refused(told).code, refused(told).message) == (
        "unreachable", "the head did not get to gate: it rests elsewhere",
    )  # fmt: skip
    assert world.machine.state is State.IDLE


@pytest.mark.parametrize("device", list(ev.Device))
def test_a_lost_device_ends_it(world, device) -> None:
    goto(world)
    told = world.tell(ev.DeviceLost(device=device, reason="unplugged"))
    assert refused(told).code == "device_lost"
    again = refused(goto(world, token=8))
    assert (again.code, "unplugged" in again.message) == ("device_lost", True)


def test_somebody_at_the_joystick_ends_it(world) -> None:
    goto(world)
    told = world.tell(ev.ForeignMotion(reading=world.reading))
    assert refused(told).code == "preempted"
    world.run(600.0)
    assert world.machine.state is State.IDLE


def test_a_shadow_says_where_the_head_would_be(make_world, config) -> None:
    world = make_world(shadow=msgspec.structs.replace(config.shadow, enabled=True))
    world.start()
    goto(world)
    world.run(1.0)
    assert world.of(cmd.ReplyGoto) == []
    (told,) = world.of(cmd.ReplyRefused)
    assert (told.token, told.code) == (7, "shadow")
    assert "the head would be at gate now, pan 40.00°, tilt -10.00°, 20.0° wide" in told.message


def test_another_calibration_of_the_mount_leads_to_the_same_direction(world, make_world, rig) -> None:
    """The fisheye is knocked by two degrees and calibrated anew: the place stays where it is in the scene."""
    turned = np.array(
        [[math.cos(0.035), 0.0, math.sin(0.035)], [0.0, 1.0, 0.0], [-math.sin(0.035), 0.0, math.cos(0.035)]]
    )
    other = make_world()
    knocked = type(rig)(
        fisheye=rig.fisheye, zoom=rig.zoom, head=rig.head, head_from_fisheye_rotation=turned,
        head_from_fisheye_translation=rig.head_from_fisheye_translation, metric=True, uncertainty=rig.uncertainty,
    )  # fmt: skip
    other = type(world)(knocked, world.machine.config)
    for each in (world, other):
        if each is other:
            each.start()
        goto(each)
        each.run(1.0)
    assert other.reading.pan_deg != pytest.approx(world.reading.pan_deg, abs=1.0)
    in_fisheye = bearing(math.radians(40.0), math.radians(-10.0))
    axis = knocked.head_from_camera(other.reading) @ np.array([0.0, 0.0, 1.0])
    assert axis == pytest.approx(turned @ in_fisheye)


def test_a_place_in_a_no_go_zone_is_refused(make_world) -> None:
    zone = HeadZone(
        name="sun",
        kind=ZoneKind.NO_GO,
        corners_deg=((30.0, -20.0), (50.0, -20.0), (50.0, 0.0), (30.0, 0.0)),
    )
    world = make_world(zones=(zone,))
    world.start()
    told = refused(goto(world))
    assert told.message.startswith("gate lies at pan 40.00°, tilt -10.00°, zoom 2709: in the no_go zone sun")
    assert world.of(cmd.MoveHead) == []


def test_settings_read_again_bring_other_places(world, config) -> None:
    places = {"tower": msgspec.structs.replace(config.presets.places["gate"], azimuth_deg=10.0)}
    presets = msgspec.structs.replace(config.presets, places=places)
    world.tell(ev.SettingsChanged(parts={"presets": msgspec.to_builtins(presets)}))
    assert refused(goto(world)).message == "no place 'gate'; there are tower"
    goto(world, "tower")
    world.run(1.0)
    assert looks_at(world) == pytest.approx((10.0, -10.0))
