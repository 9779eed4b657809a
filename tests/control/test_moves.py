"""A person moves the head by hand: only with the lease, only where the head may go, and never for ever."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.planning.by_hand import within_limits
from ptzd.control.states import State
from ptzd.model import Box, HeadLimits, HeadPose, HeadReading, HeadSpeed, Lens, Motion, Outcome

SECOND_NS = 1_000_000_000


def take(world, owner: str = "desk", **fields: object) -> None:
    world.tell(ev.LeaseAsked(token=7, wish=ev.LeaseWish.TAKE, owner=owner, **fields))


def poll(world, motion: Motion = Motion.STABLE) -> list[cmd.Command]:
    return world.tell(ev.HeadPolled(reading=world.reading, motion=motion))


def move(world, wish: str, owner: str = "desk", **fields: object) -> cmd.ReplyMove | cmd.ReplyRefused:
    event = ev.MoveAsked(token=8, owner=owner, wish=ev.MoveWish(wish), **fields)
    told = world.tell(event)
    (reply,) = [command for command in told if isinstance(command, cmd.ReplyMove | cmd.ReplyRefused)]
    if isinstance(reply, cmd.ReplyRefused):
        assert not [command for command in told if isinstance(command, cmd.MoveHead | cmd.SteerHead)]
    return reply


def phase(world) -> str:
    return world.of(cmd.PublishStatus)[-1].phase


@pytest.fixture
def his(world):
    """A head that rests under the hand of "desk"."""
    take(world)
    world.run(until=State.MANUAL)
    poll(world)
    return world


def test_without_the_lease_nothing_moves(world) -> None:
    assert move(world, "by", pan_deg=5.0).code == "lost"
    take(world)
    told = move(world, "by", "gate", pan_deg=5.0)
    assert (told.code, told.message.split()[0]) == ("leased", "desk")


def test_it_goes_where_he_says_and_he_is_told_where_that_is(his) -> None:
    told = move(his, "to", pan_deg=20.0, tilt_deg=-10.0, hfov_deg=20.0)
    assert (told.pose.pan_deg, told.pose.tilt_deg) == pytest.approx((20.0, -10.0))
    assert told.hfov_deg == pytest.approx(20.0, abs=0.01)
    assert phase(his) == "moving"
    his.run(2.0)
    assert phase(his) == ""
    assert his.machine.state is State.MANUAL
    assert his.reading.pan_deg == pytest.approx(20.0)


def test_steps_add_up_while_the_head_is_on_its_way(his) -> None:
    move(his, "by", pan_deg=5.0)
    told = move(his, "by", pan_deg=5.0, tilt_deg=1.0)
    assert (told.pose.pan_deg, told.pose.tilt_deg) == pytest.approx((10.0, 1.0))


@given(x=st.floats(0, 639), y=st.floats(0, 479), pan=st.floats(-60, 60), zoom=st.floats(1, 6000))
def test_what_he_clicks_on_comes_to_the_centre(rig, new_world, x: float, y: float, pan: float, zoom: float) -> None:
    world = new_world()
    world.start()
    take(world)
    shown = HeadPose(pan_deg=pan, tilt_deg=-10.0, zoom=zoom)
    clicked = rig.lift_from_view(np.array([x, y]), HeadReading(pan_deg=pan, tilt_deg=-10.0, zoom=zoom))
    told = move(world, "point", point_px=(x, y), picture=shown)
    world.run(2.0)
    assert told.pose.zoom == zoom
    pixel, _ = rig.project_to_view(clicked, world.reading)
    # of a camera without misalignment the optical axis is its principal point
    assert pixel == pytest.approx(np.array([319.5, 239.5]), abs=0.01)


def test_a_box_fills_the_picture_as_asked(rig, his) -> None:
    box = Box(x=400, y=100, w=60, h=40)
    seen_at = his.reading
    told = move(his, "box", box_px=box, fill=0.5)
    corners = rig.lift_from_view(np.array(box.corners), seen_at)
    his.run(2.0)
    pixels, _ = rig.project_to_view(corners, his.reading)
    assert np.ptp(pixels[:, 0]) / 640 == pytest.approx(0.5, rel=0.05)
    assert told.hfov_deg < 15.0


def test_a_pixel_of_a_moving_picture_has_no_direction_unless_its_pose_comes_along(his) -> None:
    poll(his, Motion.MOVING)
    told = move(his, "point", point_px=(100.0, 100.0))
    assert (told.code, told.field) == ("invalid", "$.picture")
    shown = HeadPose(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    assert isinstance(move(his, "point", point_px=(100.0, 100.0), picture=shown), cmd.ReplyMove)


@pytest.mark.parametrize(
    ("wish", "fields", "field", "words"),
    [
        ("to", {"pan_deg": 175.0}, "$.to", "its limits are pan -170 to 170°, tilt -80 to 80°"),
        ("by", {"tilt_deg": -81.0}, "$.by", "tilt -81.00°"),
        ("by", {"pan_deg": 300.0}, "$.by", "camera's own pan 300.00°"),
        ("to", {"hfov_deg": 90.0}, "$.hfov_deg", "outside the calibrated range 3.3"),
        ("point", {"point_px": (640.0, 3.0)}, "$.point", "(640, 3) px reaches out of the picture of 640x480 px"),
        ("box", {"box_px": Box(x=600, y=3, w=50, h=20)}, "$.box", "reaches out of the picture"),
        ("speed", {"pan_deg_s": 101.0}, "$.speed", "at most 100°/s in pan and 90°/s in tilt"),
        ("speed", {"tilt_deg_s": -95.0}, "$.speed", "at most 100°/s in pan and 90°/s in tilt"),
    ],
)
def test_what_cannot_be_is_refused_and_nothing_moves(his, wish, fields, field, words) -> None:
    told = move(his, wish, **fields)
    assert told.field == field
    assert words in told.message
    assert his.machine.state is State.MANUAL


def test_a_speed_of_a_camera_that_does_not_say_how_fast_it_is(new_world) -> None:
    world = new_world()
    world.limits = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
    world.start()
    take(world)
    assert "set ptz.steer_top_deg_s" in move(world, "speed", pan_deg_s=1.0).message
    assert isinstance(move(world, "speed", zoom_rate=0.5), cmd.ReplyMove)


def test_a_speed_ends_by_itself(his) -> None:
    told = move(his, "speed", pan_deg_s=20.0, tilt_deg_s=-5.0)
    assert (told.pan_deg_s, told.tilt_deg_s, told.slowed_by) == (20.0, -5.0, "")
    (order,) = his.of(cmd.SteerHead)
    assert order.until_ns - his.t_ns == SECOND_NS * 3 // 10
    assert phase(his) == "steering"
    his.run(1.0)
    assert phase(his) == ""


def test_near_a_limit_it_is_slower_and_he_is_told(his) -> None:
    his.reading = HeadReading(pan_deg=165.0, tilt_deg=0.0, zoom=1.0)
    poll(his)
    told = move(his, "speed", pan_deg_s=50.0, zoom_rate=-0.5)
    assert told.pan_deg_s == pytest.approx(5 / 1.2)
    assert (told.zoom_rate, told.slowed_by) == (0.0, "pan 170, zoom 1")
    his.reading = HeadReading(pan_deg=168.0, tilt_deg=0.0, zoom=1.0)
    poll(his, Motion.MOVING)
    assert his.of(cmd.SteerHead)[-1].speed.pan_deg_s == pytest.approx(2 / 1.2)
    assert move(his, "speed", pan_deg_s=-50.0).slowed_by == "", "back is free"


@given(
    start=st.floats(-170, 170),
    top=st.floats(1, 150),
    seed=st.lists(st.floats(-1, 1), min_size=3, max_size=12),
    brake=st.floats(250, 600),
    delay=st.floats(0.05, 0.25),
)
def test_no_hand_steers_a_head_out_of_its_limits(start, top, seed, brake, delay) -> None:
    """A head that takes up orders late, brakes at its own rate, and reports late, at 10 Hz."""
    limits = HeadLimits(pan_deg=(-170, 170), tilt_deg=(-80, 80), zoom=(1, 9999), top_deg_s=(150, 150))
    step, place, speed = 0.01, start, 0.0
    reported = [start] * 15
    orders = [0.0] * (round(delay / step) + 1)
    wanted = granted = 0.0
    for tick in range(len(seed) * 100):
        if tick % 100 == 0:
            wanted = seed[tick // 100] * top
        if tick % 10 == 0:
            reading = HeadReading(pan_deg=reported[-15], tilt_deg=0.0, zoom=1.0)
            granted = within_limits(limits, reading, HeadSpeed(pan_deg_s=wanted))[0].pan_deg_s
        orders.append(granted)
        change = orders[-round(delay / step) - 1] - speed
        speed += math.copysign(min(abs(change), brake * step), change)
        place += speed * step
        reported.append(place)
        assert -170.3 <= place <= 170.3


def test_who_vanishes_in_the_middle_of_a_move_leaves_a_head_at_rest(his) -> None:
    move(his, "to", pan_deg=60.0)
    his.silent = {cmd.MoveHead}
    move(his, "to", pan_deg=-60.0)
    his.request("waits", token=2, hold_s=0.0)
    his.run(5.0, until=State.IDLE)
    assert type(his.done[-1]) is cmd.PublishStatus
    assert his.of(cmd.StopHead)
    assert his.of(cmd.PublishStatus)[-1].lease is None
    his.silent = set()
    his.run(until=State.HOME)
    assert his.results()["waits"][0].outcome is Outcome.LOCKED


def test_a_stop_ends_what_his_hand_does(his) -> None:
    move(his, "speed", pan_deg_s=20.0)
    his.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    assert move(his, "by", pan_deg=1.0).code == "stopping"
    his.run(until=State.MANUAL)
    assert phase(his) == ""
    assert isinstance(move(his, "by", pan_deg=1.0), cmd.ReplyMove)


def test_his_hand_goes_before_his_own_requests(his) -> None:
    his.request("mine", token=2, by="desk", hold_s=20.0)
    his.request("next", token=3, by="desk", hold_s=20.0)
    his.run(until=State.MATCH)
    move(his, "by", pan_deg=1.0)
    assert his.machine.state is State.MANUAL
    assert {name: result[0].outcome for name, result in his.results().items()} == dict.fromkeys(
        ("mine", "next"), Outcome.PREEMPTED
    )


def test_a_move_that_fails_is_told_in_status(his) -> None:
    his.silent = {cmd.MoveHead}
    move(his, "by", pan_deg=1.0)
    number = his.of(cmd.MoveHead)[-1].move_id
    his.tell(ev.HeadStalled(move_id=number, reading=his.reading, reason="rests elsewhere"))
    assert phase(his) == "rests elsewhere"


@pytest.mark.parametrize("device", list(ev.Device))
def test_with_a_device_lost_nobody_moves_anything(his, device) -> None:
    move(his, "speed", pan_deg_s=20.0)
    his.tell(ev.DeviceLost(device=device, reason="unplugged"))
    told = move(his, "by", pan_deg=1.0)
    assert told.code == "device_lost"
    assert "unplugged" in told.message


def test_a_hand_is_in_the_snapshot(rig, config, his) -> None:
    move(his, "speed", pan_deg_s=20.0)
    heir = Machine.restored(rig, config, his.machine.snapshot())
    event = ev.HeadPolled(reading=HeadReading(pan_deg=165.0, tilt_deg=0.0, zoom=1.0), motion=Motion.MOVING)
    assert heir.handle(event, his.t_ns + 1000) == his.machine.handle(event, his.t_ns + 1000) != []


def test_focus_is_told_when_the_camera_took_it_and_is_automatic_again_after_him(his) -> None:
    event = ev.MoveAsked(token=11, owner="desk", wish=ev.MoveWish.LENS, lens=Lens(focus=1200))
    assert not [command for command in his.tell(event) if isinstance(command, cmd.ReplyMove | cmd.ReplyRefused)]
    (order,) = his.of(cmd.SetLens)
    (told,) = his.tell(ev.LensAnswered(lens_id=order.lens_id))
    assert (told.token, told.lens) == (11, Lens(focus=1200))
    his.run(6.0)
    assert his.machine.state is not State.MANUAL
    assert his.of(cmd.SetLens)[-1].lens == Lens(focus=0)


@pytest.mark.parametrize(
    ("lens", "field", "words"),
    [
        (Lens(focus=5), "$.lens.focus", "the camera has 770 to 9999"),
        (Lens(iris=5), "$.lens.iris", "tells no limits of its iris"),
    ],
)
def test_a_focus_that_the_camera_has_not(his, lens, field, words) -> None:
    told = move(his, "lens", lens=lens)
    assert told.field == field
    assert words in told.message
    assert not his.of(cmd.SetLens)


@pytest.mark.parametrize("how", ["refused", "silent", "lost", "shutdown"])
def test_a_focus_that_is_not_taken_is_told_whatever_the_reason(his, how) -> None:
    his.tell(ev.MoveAsked(token=11, owner="desk", wish=ev.MoveWish.LENS, lens=Lens(focus=1200)))
    number = his.of(cmd.SetLens)[-1].lens_id
    if how == "refused":
        his.tell(ev.LensAnswered(lens_id=number, refused="Error: focus"))
    elif how == "silent":
        his.run(20.0)
    elif how == "lost":
        his.tell(ev.DeviceLost(device=ev.Device.PTZ, reason="cut"))
    else:
        his.tell(ev.ShutdownRequested())
    assert [refused.token for refused in his.of(cmd.ReplyRefused)] == [11]
    his.tell(ev.LensAnswered(lens_id=number))
    assert len(his.of(cmd.ReplyRefused)) == 1, "a late answer changes nothing"
    assert not his.of(cmd.ReplyMove)
