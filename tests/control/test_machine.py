from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from ptzd.config import core_parts
from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.machine import Machine
from ptzd.control.states import State
from ptzd.errors import ConfigError
from ptzd.model import Box, FrameRef, HeadReading, Outcome


def test_a_box_is_found_locked_held_and_the_head_goes_home(world) -> None:
    replies = world.request("a", zoom=ev.ZoomWish.FIT)
    assert [type(reply) for reply in replies[:2]] == [cmd.PinFrame, cmd.ReplyAccepted]
    assert world.machine.state is State.SCAN
    world.run(until=State.LOCK)
    world.run(until=State.IDLE)
    (result,) = world.results()["a"]
    assert result.outcome is Outcome.LOCKED
    assert result.range_m == pytest.approx(4.0, rel=1e-3)
    assert result.hfov_deg < 40
    world.run(30)
    assert world.machine.state is State.IDLE
    assert world.reading == HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=1.0)
    assert world.machine.deadline_ns() is None
    assert world.of(cmd.ReleaseFrames) == [cmd.ReleaseFrames(request_id="a")]


def test_the_lock_lasts_hold_s(world) -> None:
    world.request("a", hold_s=10.0)
    world.run(until=State.LOCK)
    locked_at = None
    while not world.results():
        world.run(0.05)
        if locked_at is None and any(step.step == "locked" for step in world.of(cmd.PublishFeedback)):
            locked_at = world.t_ns
    assert (world.t_ns - locked_at) / 1e9 == pytest.approx(10.0, abs=0.1)


def test_keep_does_not_zoom_and_hfov_is_obeyed(world) -> None:
    world.request("keep", zoom=ev.ZoomWish.KEEP, hold_s=0.0)
    world.run(20)
    world.request("hfov", zoom=ev.ZoomWish.HFOV, hfov_deg=20.0, hold_s=0.0)
    world.run(20)
    results = world.results()
    assert results["keep"][0].zoom == 1.0
    assert results["hfov"][0].hfov_deg == pytest.approx(20.0, abs=0.05)


def test_a_region_that_is_nowhere_is_not_found(world) -> None:
    world.inverse_range = 50.0
    world.request()
    world.run()
    assert world.results()["a"][0].outcome is Outcome.NOT_FOUND


def test_a_weak_match_is_never_a_lock(world) -> None:
    world.score = 0.3
    world.request()
    world.run()
    assert world.results()["a"][0].outcome in {Outcome.NOT_FOUND, Outcome.AMBIGUOUS}


def test_texture_free_is_refused_with_that_reason(world) -> None:
    world.texture = 0.2
    world.request()
    world.run()
    assert world.results()["a"][0].outcome is Outcome.NO_TEXTURE


def test_out_of_the_limits_is_unreachable_before_anything_moves(rig, config, make_world) -> None:
    world = make_world()
    world.limits = type(world.limits)(pan_deg=(100, 170), tilt_deg=(-80, 80), zoom=(1, 9999))
    world.reading = HeadReading(pan_deg=120, tilt_deg=0, zoom=1)
    world.start()
    world.request()
    assert world.results()["a"][0].outcome is Outcome.UNREACHABLE
    assert not world.of(cmd.MoveHead)


@pytest.mark.parametrize(
    ("fields", "code", "path"),
    [
        ({"box": Box(x=630, y=10, w=20, h=20)}, "outside", "$.box.x"),
        ({"box": Box(x=10, y=-3, w=20, h=20)}, "outside", "$.box.y"),
        ({"box": Box(x=10, y=10, w=7.9, h=20)}, "invalid", "$.box.w"),
        ({"box": Box(x=0, y=0, w=9, h=9)}, "outside", "$.box"),
        ({"frame_seq": 77}, "stale_frame", "$.frame"),
        ({"frame_t_capture_ns": 5}, "stale_frame", "$.frame"),
        ({"zoom": ev.ZoomWish.HFOV, "hfov_deg": 80.0}, "invalid", "$.zoom.hfov_deg"),
    ],
)
def test_refusals_come_before_anything_moves(world, fields: dict[str, object], code: str, path: str) -> None:
    (refused,) = world.request(**fields)
    assert isinstance(refused, cmd.ReplyRefused)
    assert (refused.code, refused.field) == (code, path)
    assert world.machine.state is State.IDLE


def test_a_refused_put_gets_its_result(world) -> None:
    (result,) = world.request("put", token=None, frame_seq=99)
    assert result.outcome is Outcome.STALE_FRAME
    (rejected,) = world.request("put2", token=None, box=Box(x=630, y=10, w=20, h=20))
    assert rejected.outcome is Outcome.REJECTED


def test_an_old_frame_is_stale(world) -> None:
    world.t_ns += 10_000_000_000
    (refused,) = world.request(frame_seq=0)
    assert refused.code == "stale_frame"


def test_the_same_id_again_changes_nothing(world) -> None:
    first = world.request("a")
    again = world.request("a", token=2)
    assert next(reply for reply in again if isinstance(reply, cmd.ReplyAccepted)).frame == first[1].frame
    assert len(again) == 1
    world.run()
    (ended,) = world.request("a", token=3)
    assert ended.code == "ended"
    assert len(world.results()["a"]) == 1


def test_requests_are_served_in_order_and_higher_priority_pre_empts(world) -> None:
    world.request("first", hold_s=2.0)
    world.request("second", token=2, hold_s=0.0)
    world.request("urgent", token=3, priority=5, hold_s=0.0)
    world.run()
    order = [command.id for command in world.of(cmd.PublishResult)]
    assert order == ["first", "urgent", "second"]
    assert world.results()["first"][0].outcome is Outcome.PREEMPTED
    assert world.results()["second"][0].outcome is Outcome.LOCKED


def test_a_full_queue_says_busy(world) -> None:
    for index in range(9):
        world.request(f"r{index}", token=index)
    (refused,) = world.request("late", token=99)
    assert refused.code == "busy"


@pytest.mark.parametrize("stage", ["scan", "match", "lock", "home", "idle", "fault"])
@pytest.mark.parametrize("way", ["cancel", "stop", "shutdown", "fisheye", "ptz", "foreign"])
def test_every_end_at_every_stage_gives_one_result(make_world, stage: str, way: str) -> None:
    world = make_world()
    world.start()
    if stage == "match":
        world.silent = {cmd.RunMatch}
    if stage not in {"idle", "fault"}:
        world.request("a", hold_s=0.0 if stage == "home" else 60.0)
        state = {"scan": State.SCAN, "match": State.MATCH, "lock": State.LOCK, "home": State.HOME}[stage]
        world.run(until=state)
        assert world.machine.state is state
    if stage == "fault":
        world.tell(ev.DeviceLost(device=ev.Device.FISHEYE, reason="pulled"))
    moves = len(world.of(cmd.MoveHead))
    event = {
        "cancel": ev.CancelReceived(token=7, id="a"),
        "stop": ev.ControlReceived(token=7, verb=ev.Verb.STOP),
        "shutdown": ev.ShutdownRequested(),
        "fisheye": ev.DeviceLost(device=ev.Device.FISHEYE, reason="unplugged"),
        "ptz": ev.DeviceLost(device=ev.Device.PTZ, reason="no answer"),
        "foreign": ev.ForeignMotion(reading=world.reading),
    }[way]
    world.tell(event)
    if stage in {"scan", "match", "lock"}:
        (result,) = world.results()["a"]
        expected = {"cancel": "cancelled", "stop": "cancelled", "shutdown": "cancelled", "foreign": "preempted"}
        assert result.outcome == expected.get(way, "device_lost")
    if way in {"cancel", "stop", "shutdown", "fisheye"} and stage in {"scan", "match", "lock"}:
        assert any(isinstance(command, cmd.StopHead) for command in world.done)
    world.run(100)
    if way in {"stop", "shutdown", "fisheye", "ptz", "foreign"}:
        assert len(world.of(cmd.MoveHead)) == moves
    assert all(len(results) == 1 for results in world.results().values())
    if way == "shutdown":
        assert len(world.of(cmd.Finished)) == 1
    if way in {"cancel", "stop"}:
        assert [r for r in world.of(cmd.ReplyOutcome) + world.of(cmd.ReplyRefused) if r.token == 7]


@pytest.mark.parametrize("device", list(ev.Device))
def test_the_rig_recovers_when_the_device_is_back(world, device: ev.Device) -> None:
    world.request("a")
    world.tell(ev.DeviceLost(device=device, reason="gone"))
    assert world.machine.state is State.FAULT
    (refused,) = world.request("b", token=4)
    assert refused.code == "device_lost"
    assert "gone" in refused.message
    world.run(20)
    if device is ev.Device.PTZ:
        world.tell(ev.HeadReady(limits=world.limits, reading=world.reading))
    world.tell(ev.DeviceWell(device=device))
    world.frame(100)
    world.request("c", token=5)
    world.run()
    assert world.results()["c"][0].outcome is Outcome.LOCKED


@pytest.mark.parametrize("silent", [cmd.MoveHead, cmd.GrabView, cmd.RunMatch, cmd.StopHead])
def test_a_world_that_does_not_answer_ends_every_request(world, silent: type[cmd.Command]) -> None:
    world.silent = {silent}
    world.request("a", timeout_s=300.0)
    world.request("b", token=2, timeout_s=20.0)
    world.run(1000)
    assert set(world.results()) == {"a", "b"}
    assert world.machine.deadline_ns() is None


def test_hold_keeps_the_lock_until_release(world) -> None:
    world.request("a", hold_s=1.0)
    world.run(until=State.LOCK)
    world.tell(ev.ControlReceived(token=9, verb=ev.Verb.HOLD))
    world.run(60)
    assert not world.results()
    world.tell(ev.ControlReceived(token=10, verb=ev.Verb.RELEASE))
    assert world.results()["a"][0].outcome is Outcome.RELEASED


def test_a_lost_target_is_scanned_for_once_and_then_given_up(world) -> None:
    world.request("a", hold_s=300.0, timeout_s=200.0)
    world.run(until=State.LOCK)
    world.run(10)
    world.score = 0.05
    world.run(400)
    (result,) = world.results()["a"]
    assert result.outcome in {Outcome.LOST, Outcome.NOT_FOUND}
    assert any("again" in str(step.detail.get("text")) for step in world.of(cmd.PublishFeedback))


def test_a_moved_target_is_followed_without_a_new_scan(world) -> None:
    world.request("a", hold_s=30.0)
    world.run(until=State.LOCK)
    world.run(8)
    before = world.reading
    world.frame(5)
    world.tell(ev.UpdateReceived(id="a", box=Box(x=380, y=230, w=40, h=32), frame_seq=5))
    assert world.machine.state is State.LOCK
    world.run(8)
    assert world.reading.pan_deg - before.pan_deg > 5
    world.run(60)
    assert world.results()["a"][0].outcome is Outcome.LOCKED


def test_an_update_before_the_lock_is_taken_over_by_it(world) -> None:
    world.request("a", hold_s=1.0)
    world.frame(6)
    world.tell(ev.UpdateReceived(id="a", box=Box(x=350, y=230, w=40, h=32), frame_seq=6))
    world.run()
    assert world.results()["a"][0].outcome is Outcome.LOCKED
    assert world.of(cmd.RunMatch)[-1].frame.seq == 6


def test_a_snapshot_goes_on_exactly(rig, config, world) -> None:
    world.request("a", hold_s=3.0)
    world.run(3)
    twin = Machine.restored(rig, config, world.machine.snapshot())
    assert twin.snapshot() == world.machine.snapshot()
    told = len(world.told)
    done = len(world.done)
    world.run(60)
    assert world.replayed(twin, told) == world.done[done:]


def test_the_same_events_give_the_same_commands(rig, config, world) -> None:
    world.request("a")
    world.request("b", token=2, priority=3)
    world.run()
    twin = Machine(rig, config)
    assert world.replayed(twin) == world.done


def test_late_answers_are_ignored(world: object, make_world: Callable) -> None:
    world = make_world()
    world.start()
    world.request("a")
    number = world.of(cmd.MoveHead)[0].move_id
    world.tell(ev.CancelReceived(token=None, id="a"))
    commands = world.tell(ev.HeadArrived(move_id=number, reading=world.reading))
    assert commands == []


def test_unknown_cancel_is_refused(world) -> None:
    (refused,) = world.tell(ev.CancelReceived(token=3, id="nobody"))
    assert refused.code == "unknown_id"


def notes(commands) -> list[tuple[str, str]]:
    return [(told.id, told.detail["text"]) for told in commands if isinstance(told, cmd.PublishFeedback)]


def test_an_unknown_cancel_by_put_is_told_as_feedback(world) -> None:
    commands = world.tell(ev.CancelReceived(token=None, id="nobody"))
    assert notes(commands) == [
        ("nobody", "cancel refused: $.id: no request nobody is active, waiting or lately ended"),
    ]


@pytest.mark.parametrize(("token", "told", "noted"), [(None, True, 1), (None, False, 0), (5, True, 0)])
def test_an_update_of_an_unknown_id_is_refused_to_whoever_can_hear(world, token, told, noted) -> None:
    box = Box(x=350, y=230, w=40, h=32)
    commands = world.tell(ev.UpdateReceived(id="nobody", box=box, token=token, told=told))
    assert len(notes(commands)) == noted
    refusals = [(command.token, command.code) for command in commands if isinstance(command, cmd.ReplyRefused)]
    assert refusals == ([(5, "unknown_id")] if token else [])


def test_an_update_by_query_is_answered(world) -> None:
    world.request("a")
    world.frame(6)
    good, outside = Box(x=350, y=230, w=40, h=32), Box(x=9000, y=230, w=40, h=32)
    taken = world.tell(ev.UpdateReceived(id="a", box=good, frame_seq=6, token=7))
    assert cmd.ReplyOutcome(token=7, outcome="updated") in taken
    refused = world.tell(ev.UpdateReceived(id="a", box=outside, frame_seq=6, token=8))
    assert [command.token for command in refused if isinstance(command, cmd.ReplyRefused)] == [8]
    assert len(notes(refused)) == 1


def test_a_message_about_a_request_that_is_none_is_told_to_it_and_it_goes_on(world) -> None:
    world.request("a", hold_s=1.0)
    garbled = ev.PayloadRefused(token=None, code="not_json", message="no JSON", field="$", about="a")
    assert notes(world.tell(garbled)) == [("a", "message refused: $: no JSON")]
    world.run()
    assert world.results()["a"][0].outcome is Outcome.LOCKED


@pytest.mark.parametrize("token", [None, 6])
def test_a_home_that_cannot_be_is_refused_also_to_a_put(world, token) -> None:
    world.tell(ev.DeviceLost(device=ev.Device.PTZ, reason="unplugged"))
    commands = world.tell(ev.ControlReceived(token=token, verb=ev.Verb.HOME))
    assert [(command.token, command.code) for command in commands if isinstance(command, cmd.ReplyRefused)] == [
        (token, "device_lost")
    ]


def test_the_ring_forgets(world) -> None:
    for seq in range(1, 400):
        world.t_ns += 1_000_000
        world.frame(seq)
    (refused,) = world.request(frame_seq=0)
    assert refused.code == "stale_frame"
    accepted = world.request(frame_seq=399, token=4)
    assert isinstance(accepted[0], cmd.PinFrame)
    assert accepted[0].frame == FrameRef(seq=399, t_capture_ns=accepted[0].frame.t_capture_ns)


def test_a_stop_without_a_camera_is_tried_and_refused_at_once(world) -> None:
    world.tell(ev.DeviceLost(device=ev.Device.PTZ, reason="no answer"))
    commands = world.tell(ev.ControlReceived(token=9, verb=ev.Verb.STOP))
    assert cmd.StopHead() in commands
    (refused,) = [command for command in commands if isinstance(command, cmd.ReplyRefused)]
    assert (refused.token, refused.code) == (9, "device_lost")
    assert "no answer" in refused.message


def test_other_settings_hold_from_the_next_decision_on(world) -> None:
    """What is no part of the core, or does not hold what it must, is refused and changes nothing."""
    before = world.machine.config
    strict = msgspec.structs.replace(
        before, search=msgspec.structs.replace(before.search, accept_probability=1.0, certain_probability=1.0)
    )
    world.request("before", hold_s=0.0)
    world.run(until=State.LOCK)
    world.tell(ev.SettingsChanged(parts=core_parts(strict)))
    world.run()
    assert [result.outcome for result in world.results()["before"]] == [Outcome.LOCKED]
    world.frame(1)
    world.request("after", token=2)
    world.run()
    assert [result.outcome for result in world.results()["after"]] != [Outcome.LOCKED]
    for parts in ({"ptz": {}}, {"lock": {"fill": 7.0}}):
        with pytest.raises(ConfigError, match=next(iter(parts))):
            world.tell(ev.SettingsChanged(parts=parts))
    assert world.machine.config == strict


def test_a_picture_may_take_as_long_as_the_stream_may_be_silent(make_world, config) -> None:
    waited = {}
    for stall_s in (5.0, 60.0):
        world = make_world(ptz=msgspec.structs.replace(config.ptz, stall_s=stall_s))
        world.silent = {cmd.GrabView}
        world.start()
        world.request("a", hold_s=0.0, timeout_s=600.0)
        world.run(600.0, until=State.IDLE)
        waited[stall_s] = world.results()["a"][0].elapsed_ms
    assert waited[60.0] - waited[5.0] >= 55_000
