"""What the core does with zones: boxes in them are refused, no set point and no way enters them, and it is told."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ptzd.config import Home
from ptzd.config_zones import FisheyeZone, HeadZone
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.planning.reach import Reach, reach_of
from ptzd.control.planning.zones import zones_of
from ptzd.control.states import State
from ptzd.errors import ConfigError
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.sphere import pan_tilt
from ptzd.model import Box, HeadLimits, HeadReading, Motion, Outcome, ZoneKind
from tests.control.true_head import TrueHead

BOX = Box(x=330, y=230, w=40, h=32)
FAR = (1e5, math.inf)


def window(pan: float, tilt: float, half: float, kind: ZoneKind = ZoneKind.NO_GO, name: str = "window") -> HeadZone:
    """A zone of the head's directions, far away."""
    corners = (
        (pan - half, tilt - half),
        (pan + half, tilt - half),
        (pan + half, tilt + half),
        (pan - half, tilt + half),
    )
    return HeadZone(name=name, kind=kind, corners_deg=corners, range_m=FAR)


def where(rig, inverse_range: float, box: Box = BOX) -> tuple[float, float]:
    """Pan and tilt, deg, at which the head sees the middle of a box."""
    arc = EpipolarArc.of(rig, rig.fisheye.lift(np.array(box.centre))[0], 0.0, 1.0)
    pan, tilt = pan_tilt(arc.bearing(inverse_range))
    return math.degrees(float(pan)), math.degrees(float(tilt))


@pytest.mark.parametrize("kind", [ZoneKind.IGNORE, ZoneKind.PRIVACY])
def test_a_box_in_a_zone_that_is_closed_to_boxes_is_refused_by_its_name(make_world, kind) -> None:
    corners = ((300.0, 200.0), (400.0, 200.0), (400.0, 300.0), (300.0, 300.0))
    world = make_world(zones=(FisheyeZone(name="tree", kind=kind, corners_px=corners),))
    world.start()
    world.request("a")
    (refused,) = world.of(cmd.ReplyRefused)
    assert (refused.code, refused.field) == ("zone", "$.box")
    assert refused.message == f"the box's centre lies in the {kind} zone tree"
    world.request("b", box=Box(x=420, y=230, w=40, h=32))
    assert [reply.id for reply in world.of(cmd.ReplyAccepted)] == ["b"]
    world.tell(ev.UpdateReceived(id="b", box=BOX, told=True))
    (note,) = [told for told in world.of(cmd.PublishFeedback) if told.step == "note"]
    assert "zone tree" in str(note.detail["text"])
    assert world.machine.state is State.SCAN, "the request goes on with the box it had"


def test_a_no_go_zone_closes_nothing_to_boxes(make_world) -> None:
    corners = ((300.0, 200.0), (400.0, 200.0), (400.0, 300.0), (300.0, 300.0))
    world = make_world(zones=(FisheyeZone(name="sun", kind=ZoneKind.NO_GO, corners_px=corners, range_m=FAR),))
    world.start()
    world.request("a")
    assert world.of(cmd.ReplyAccepted)


def test_a_target_in_a_no_go_zone_is_held_from_beside_it(make_world, rig) -> None:
    pan, tilt = where(rig, 0.25)
    world = make_world(zones=(window(pan, tilt, 3.0),))
    world.start()
    world.request("a")
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.LOCKED
    assert "in the no_go zone window" in result.reason
    for move in world.of(cmd.MoveHead):
        assert abs(move.target.pan_deg - pan) > 3.0 or abs(move.target.tilt_deg - tilt) > 3.0


def test_a_target_deep_in_a_no_go_zone_is_not_gone_to_and_the_zone_is_named(make_world, rig) -> None:
    pan, tilt = where(rig, 0.25)
    world = make_world(zones=(window(pan, tilt + 14.0, 38.0, name="sun"),), home=Home(tilt_deg=-40.0))
    world.start()
    world.request("a")
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome in {Outcome.UNREACHABLE, Outcome.NOT_FOUND}
    assert "zone" in result.reason


def test_a_target_in_a_privacy_zone_is_not_looked_at(make_world, rig) -> None:
    pan, tilt = where(rig, 0.25)
    world = make_world(zones=(window(pan, tilt, 2.0, ZoneKind.PRIVACY),))
    world.start()
    world.request("a")
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.UNREACHABLE
    assert "the target lies in the privacy zone window" in result.reason


def test_beside_a_privacy_zone_the_picture_stays_wide(make_world, rig) -> None:
    pan, tilt = where(rig, 0.25)
    world = make_world(zones=(window(pan, tilt + 6.0, 1.5, ZoneKind.PRIVACY),))
    world.start()
    world.request("a", zoom=ev.ZoomWish.HFOV, hfov_deg=20.0)
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.LOCKED
    assert "shown no closer: zoomed in beside a privacy zone (window)" in result.reason
    assert result.zoom == 1.0
    assert {move.target.zoom for move in world.of(cmd.MoveHead)} == {1.0}
    free = make_world()
    free.start()
    free.request("a", zoom=ev.ZoomWish.HFOV, hfov_deg=20.0)
    free.run()
    assert free.results()["a"][0].zoom > 1.0


BESIDE = HeadReading(pan_deg=-60.0, tilt_deg=0.0, zoom=1.0)
SCREEN = tuple(
    HeadZone(name=f"screen{index}", kind=ZoneKind.NO_GO, corners_deg=corners, range_m=FAR)
    for index, corners in enumerate(
        ((-35.0, low), (-25.0, low), (-25.0, low + 42.0), (-35.0, low + 42.0))
        for low in (-88.0, -48.0, -8.0, 30.0, 45.0)
    )
)
"""Five zones one over the other, from the lowest tilt to over the highest."""


def beside(make_world, *zones: HeadZone):
    """A world whose head stands to the left of zones in the middle."""
    world = make_world(zones=zones)
    world.reading = BESIDE
    world.start()
    world.tell(ev.HeadPolled(reading=BESIDE, motion=Motion.STABLE))
    return world


def test_a_way_that_is_closed_is_refused_told_and_leaves_the_head_at_rest(make_world) -> None:
    world = beside(make_world, *SCREEN)
    world.run(20.0)  # it would go home of its own accord
    (refused,) = world.of(cmd.RefuseMove)
    assert refused.target == HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    assert refused.reason.startswith(
        "no way leads around the no_go zones (screen0, screen1, screen2, screen3, screen4) to pan 0.00"
    )
    assert world.of(cmd.MoveHead) == []
    assert world.machine.state is State.IDLE


def test_whoever_asks_for_home_behind_a_closed_way_is_told_and_what_runs_goes_on(make_world) -> None:
    world = beside(make_world, *SCREEN)
    world.request("a", box=Box(x=120, y=230, w=40, h=32))
    world.tell(ev.ControlReceived(token=7, verb=ev.Verb.HOME))
    (refused,) = world.of(cmd.ReplyRefused)
    assert (refused.token, refused.code) == (7, "zone")
    assert "no way leads around the no_go zones" in refused.message
    assert world.machine.state is State.SCAN


def test_a_request_behind_a_closed_way_ends_with_the_reason(make_world) -> None:
    world = beside(make_world, *SCREEN)
    world.request("a")
    world.run()
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.UNREACHABLE
    assert "no way leads around the no_go zones" in result.reason
    assert world.of(cmd.MoveHead) == []


def test_a_way_around_is_one_move_to_whoever_asked_for_it(make_world) -> None:
    world = beside(make_world, window(-30.0, 0.0, 8.0))
    world.tell(ev.ControlReceived(token=7, verb=ev.Verb.HOME))
    world.run(until=State.IDLE)
    legs = [move.target for move in world.of(cmd.MoveHead)]
    assert len(legs) > 1
    assert legs[-1] == HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    assert len({move.move_id for move in world.of(cmd.MoveHead)}) == len(legs)
    assert world.machine.state is State.IDLE


@pytest.mark.parametrize("end", ["stop", "stalled", "silent"])
def test_what_ends_a_leg_ends_the_way(make_world, end) -> None:
    world = beside(make_world, window(-30.0, 0.0, 8.0))
    world.tell(ev.ControlReceived(token=7, verb=ev.Verb.HOME))
    (first,) = world.of(cmd.MoveHead)
    if end == "stop":
        world.tell(ev.ControlReceived(token=8, verb=ev.Verb.STOP))
    elif end == "stalled":
        world.tell(ev.HeadStalled(move_id=first.move_id, reading=BESIDE, reason="blocked"))
    else:
        world.silent.add(cmd.MoveHead)
        world._answers.clear()
    world.run(40.0)
    world.tell(ev.HeadArrived(move_id=first.move_id, reading=first.target))
    assert world.of(cmd.MoveHead)[:1] == [first]
    assert all(move.target == first.target for move in world.of(cmd.MoveHead)), "the second leg never begins"


def test_a_core_that_goes_on_from_a_snapshot_goes_on_with_the_way(make_world, rig) -> None:
    world = beside(make_world, window(-30.0, 0.0, 8.0))
    world.tell(ev.ControlReceived(token=7, verb=ev.Verb.HOME))
    (first,) = world.of(cmd.MoveHead)
    heir = Machine.restored(rig, world.machine.config, world.machine.snapshot())
    arrived = ev.HeadArrived(move_id=first.move_id, reading=first.target)
    assert heir.handle(arrived, world.t_ns) == world.machine.handle(arrived, world.t_ns)


def test_a_new_target_on_the_way_is_not_led_through_the_zone_by_a_short_cut(make_world) -> None:
    """Where the head is on its leg nobody knows: every place of it must be as good a start."""
    world = beside(make_world, window(-30.0, 0.0, 8.0))
    world.tell(ev.ControlReceived(token=7, verb=ev.Verb.HOME))
    (first,) = world.of(cmd.MoveHead)
    world.request("a")
    second = world.of(cmd.MoveHead)[1].target
    reach = reach_of(world.limits, world.rig, zones_of(world.machine.config, world.rig))
    assert reach.leg_free(world.machine._work.head.span, second)
    assert world.machine._work.head.span.pan_deg[0] == BESIDE.pan_deg
    assert second == first.target or second.pan_deg < -38.0


zone_settings = st.lists(
    st.tuples(st.floats(-80, 80), st.floats(-60, 60), st.floats(1.5, 20.0)), min_size=1, max_size=4
).map(
    lambda places: tuple(
        window(pan, tilt, min(half, 88.0 - abs(tilt)), name=f"z{index}")
        for index, (pan, tilt, half) in enumerate(places)
    )
)


def steered(world: TrueHead, chance: random.Random) -> None:
    """Somebody takes the head, turns it this way and that with and without a pause, sends it somewhere, and goes."""
    world.tell(ev.LeaseAsked(token=None, wish=ev.LeaseWish.TAKE, owner="desk", for_s=60.0))
    for _ in range(chance.randint(1, 5)):
        speed = {"pan_deg_s": chance.uniform(-90, 90), "tilt_deg_s": chance.uniform(-80, 80)}
        for _ in range(chance.randint(1, 12)):
            world.tell(ev.MoveAsked(token=None, owner="desk", wish=ev.MoveWish.SPEED, zoom_rate=0.0, **speed))
            world.run(chance.choice([0.1, 0.1, 0.2, 0.5]))
    place = {"pan_deg": chance.uniform(-80, 80), "tilt_deg": chance.uniform(-15, 15)}
    world.tell(ev.MoveAsked(token=None, owner="desk", wish=ev.MoveWish.TO, **place))
    world.run(chance.choice([0.2, 2.0]))
    world.tell(ev.LeaseAsked(token=None, wish=ev.LeaseWish.GIVE, owner="desk"))


@settings(max_examples=25, deadline=None)
@given(
    zones=zone_settings,
    seed=st.integers(0, 2**32 - 1),
    profile=st.sampled_from(["v5915", "dome"]),
    home=st.tuples(st.floats(-60, 60), st.floats(-15, 15)),
    cut=st.tuples(st.floats(0.0, 60.0), st.floats(0.0, 30.0)),
)
def test_nothing_enters_a_no_go_zone_by_the_simulators_truth(rig, config, zones, seed, profile, home, cut) -> None:
    endless = profile == "dome"
    limits = HeadLimits(
        pan_deg=(-180.0, 180.0) if endless else (-170.0 + cut[0], 170.0 - cut[0]),
        tilt_deg=(-89.0 + cut[1], 19.0) if endless else (-19.0, 89.0 - cut[1]),
        zoom=(1.0, 9999.0),
        endless_pan=endless,
        top_deg_s=(100.0, 90.0),
    )
    rest = Home(pan_deg=home[0], tilt_deg=home[1], idle_s=0.5)
    chosen = msgspec.structs.replace(config, zones=zones, home=rest)
    reach: Reach = reach_of(limits, rig, zones_of(chosen, rig))
    assume(reach.contains(HeadReading(pan_deg=home[0], tilt_deg=home[1], zoom=1.0)))
    world = TrueHead(rig, chosen, profile=profile, limits=limits, seed=seed)
    world.start()
    chance = random.Random(seed)
    for number in range(12):
        world.tell(ev.FrameArrived(frame=world.frame()))
        act = chance.choice(["request", "request", "request", "update", "stop", "home", "cancel", "hand", "hand"])
        name = f"r{number}"
        if act == "request":
            box = Box(x=chance.uniform(120, 480), y=chance.uniform(90, 350), w=40, h=32)
            world.tell(
                ev.RequestReceived(token=None, id=name, box=box, hold_s=1.0, priority=chance.choice([0, 1, 2, 3]))
            )
        elif act == "update":
            box = Box(x=chance.uniform(120, 480), y=chance.uniform(90, 350), w=40, h=32)
            world.tell(ev.UpdateReceived(id=f"r{number - 1}", box=box))
        elif act == "hand":
            steered(world, chance)
        elif act == "cancel":
            world.tell(ev.CancelReceived(token=None, id=f"r{number - 1}"))
        else:
            world.tell(ev.ControlReceived(token=None, verb=ev.Verb(act)))
        world.run(chance.choice([0.1, 0.3, 0.6, 1.5, 4.0]))
    world.run(10.0)
    assert world.trespassed() == []


def test_steered_towards_a_zone_it_slows_down_and_stops_before_it_by_the_truth(rig, config) -> None:
    zone = window(40.0, 0.0, 8.0)
    limits = replace(V5915, top_deg_s=(100.0, 90.0))
    world = TrueHead(rig, msgspec.structs.replace(config, zones=(zone,)), profile="v5915", limits=limits, seed=3)
    world.start()
    world.tell(ev.LeaseAsked(token=1, wish=ev.LeaseWish.TAKE, owner="desk", for_s=60.0))
    world.run(1.0)
    for _ in range(60):
        asked = ev.MoveAsked(
            token=2, owner="desk", wish=ev.MoveWish.SPEED, pan_deg_s=60.0, tilt_deg_s=0.0, zoom_rate=0.0
        )
        world.tell(asked)
        world.run(0.1)
    assert world.trespassed() == []
    replies = [told for told in world.done if isinstance(told, cmd.ReplyMove)]
    assert replies[-1].slowed_by == "zones window"
    assert replies[0].pan_deg_s > 10.0
    assert replies[-1].pan_deg_s < 1.0
    assert 25.0 < world.poses[-1].pan_deg < 32.0, "it gets near, and no nearer"


@pytest.mark.parametrize("zoom", [1.0, 3000.0])
def test_a_window_may_be_steered_past_but_not_into_and_what_stops_in_it_moves_off(make_world, rig, zoom) -> None:
    world = make_world(zones=(window(10.0, 0.0, 3.0, ZoneKind.PRIVACY),), home=Home(pan_deg=-60.0))
    world.start()
    world.tell(ev.LeaseAsked(token=1, wish=ev.LeaseWish.TAKE, owner="desk", for_s=60.0))
    world.run(1.0)
    world.reading = HeadReading(pan_deg=10.0, tilt_deg=1.0, zoom=zoom)
    world.tell(ev.HeadPolled(reading=world.reading, motion=Motion.MOVING))
    asked = ev.MoveAsked(token=2, owner="desk", wish=ev.MoveWish.SPEED, pan_deg_s=5.0, tilt_deg_s=0.0, zoom_rate=0.5)
    world.limits = replace(world.limits, top_deg_s=(100.0, 90.0))
    world.tell(ev.HeadReady(limits=world.limits, reading=world.reading))
    world.tell(asked)
    reply = world.of(cmd.ReplyMove)[-1]
    assert (reply.pan_deg_s, reply.zoom_rate, reply.slowed_by) == (5.0, 0.0, "privacy zones window")
    steer = world.of(cmd.SteerHead)[-1]
    world.tell(ev.HeadArrived(move_id=steer.move_id, reading=world.reading))
    off = world.of(cmd.MoveHead)[-1].target
    reach = reach_of(world.limits, rig, zones_of(world.machine.config, rig))
    assert reach.contains(off)
    assert abs(off.pan_deg - 10.0) < 6.0


def test_a_move_by_hand_into_a_zone_is_refused_by_its_name(make_world) -> None:
    world = make_world(zones=(window(40.0, 0.0, 8.0),))
    world.start()
    world.tell(ev.LeaseAsked(token=1, wish=ev.LeaseWish.TAKE, owner="desk", for_s=60.0))
    world.run(1.0)
    world.tell(ev.MoveAsked(token=2, owner="desk", wish=ev.MoveWish.TO, pan_deg=40.0, tilt_deg=0.0))
    refused = world.of(cmd.ReplyRefused)[-1]
    assert (refused.token, refused.code, refused.field) == (2, "zone", "$.to")
    assert refused.message == "pan 40.00°, tilt 0.00° is in the no_go zone window"
    assert world.of(cmd.MoveHead) == []


def test_the_truth_would_tell_of_a_trespass(rig, config) -> None:
    """Without zones in the core the same head goes straight through: the law above is no empty one."""
    zone = window(30.0, 0.0, 5.0)
    rest = Home(pan_deg=0.0, tilt_deg=0.0)
    world = TrueHead(rig, msgspec.structs.replace(config, home=rest), profile="v5915", limits=V5915, seed=1)
    world.no_go = list(zones_of(msgspec.structs.replace(config, zones=(zone,)), rig))
    world.start()
    world._perform(cmd.MoveHead(move_id=1, target=HeadReading(pan_deg=60.0, tilt_deg=0.0, zoom=1.0)))
    world.run(3.0)
    assert world.trespassed() == ["window"]


V5915 = HeadLimits(pan_deg=(-170.0, 170.0), tilt_deg=(-19.0, 89.0), zoom=(1.0, 9999.0))


@pytest.mark.parametrize(
    ("zone", "says"),
    [
        (window(0.0, 0.0, 75.0), "split it into smaller ones"),
        (
            HeadZone(name="bow", kind=ZoneKind.NO_GO, corners_deg=((0, 0), (9, 9), (9, 0), (0, 9)), range_m=FAR),
            "the edge from corner 1 to 2 crosses that from corner 3 to 4: give the corners in the order of a walk",
        ),
        (
            FisheyeZone(name="out", kind=ZoneKind.IGNORE, corners_px=((0, 0), (30, 0), (0, 30))),
            "outside the fisheye's image circle",
        ),
    ],
)
def test_what_is_no_zone_is_told_with_its_place(config, rig, zone, says) -> None:
    with pytest.raises(ConfigError, match=says) as error:
        zones_of(msgspec.structs.replace(config, zones=(window(90.0, 0.0, 2.0), zone)), rig)
    assert str(error.value).startswith(f"zones[1] ({zone.name}): ")
    assert "\n" not in str(error.value)
