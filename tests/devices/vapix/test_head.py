from __future__ import annotations

import asyncio

import pytest

from ptzd.config import Limits
from ptzd.devices.vapix.head import VapixHead
from ptzd.errors import DeviceLost, DeviceRefused
from ptzd.model import HeadReading, Motion
from ptzd.ports import MoveStalled, MoveSuperseded


def at(pan=0.0, tilt=0.0, zoom=1.0) -> HeadReading:
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=zoom)


async def test_describe_gives_the_limits_that_camera_and_settings_share(camera, settings_for, clock):
    camera.parameters = "root.PTZ.Various.V1.ReturnToOverview=30\nroot.PTZ.ImageSource.I0.PTZEnabled=true\n"
    limits = Limits(pan_deg=(-90.0, 200.0), tilt_deg=(-45.0, 30.0))
    async with VapixHead(settings_for(camera), limits, clock) as head:
        found = await head.describe()
    assert (found.pan_deg, found.tilt_deg, found.zoom) == ((-90.0, 170.0), (-20.0, 30.0), (1.0, 9999.0))
    assert not found.endless_pan
    assert head.capabilities.device.product == "AXIS M1065-LW Network Camera"
    assert [warning.partition(":")[0] for warning in head.capabilities.warnings] == [
        "PTZ.Various.V1.ReturnToOverview=30"
    ]


async def test_move_sends_one_request_and_arrives(head, camera):
    reading = await head.move(at(40, 20, 500))
    assert reading == at(40, 20, 500)
    assert camera.commands == [{"camera": "1", "pan": "40.0000", "tilt": "20.0000", "zoom": "500"}]


async def test_a_move_to_where_the_head_is_arrives_after_a_possible_start(head, camera):
    assert await head.move(at()) == at()


async def test_outside_the_limits_nothing_is_sent(head, camera):
    with pytest.raises(MoveStalled, match=r"pan 171\.00°.* outside the limits") as stalled:
        await head.move(at(171))
    assert stalled.value.reading == at()
    assert camera.commands == []


async def test_a_later_move_takes_the_place_of_the_first(head, camera):
    first = asyncio.create_task(head.move(at(100)))
    await asyncio.sleep(0.1)
    assert await head.move(at(-20)) == at(-20)
    with pytest.raises(MoveSuperseded):
        await first


async def test_of_a_burst_only_first_and_last_reach_the_camera(head, camera):
    moves = [asyncio.create_task(head.move(at(float(pan)))) for pan in range(10)]
    results = await asyncio.gather(*moves, return_exceptions=True)
    assert results[-1] == at(9)
    assert all(isinstance(result, MoveSuperseded) for result in results[:-1])
    assert len(camera.commands) <= 2
    assert camera.commands[-1]["pan"] == "9.0000"


async def test_a_head_that_rests_elsewhere_says_where(head, camera):
    camera.clamp = lambda pan, tilt, zoom: (min(pan, 30), tilt, zoom)
    with pytest.raises(MoveStalled, match=r"rests at pan 30\.00°") as stalled:
        await head.move(at(60))
    assert stalled.value.reading == at(30)


async def test_stop_ends_a_move_with_both_stops(head, camera, eventually):
    camera.speed_deg_s = 30
    move = asyncio.create_task(head.move(at(120)))
    await eventually(lambda: camera.place()[0] > 1)
    await head.stop()
    with pytest.raises(MoveSuperseded):
        await move
    assert camera.commands[1:] == [
        {"camera": "1", "continuouspantiltmove": "0,0", "continuouszoommove": "0"},
        {"camera": "1", "move": "stop"},
    ]
    pan = camera.place()[0]
    assert 1 < pan < 120
    await asyncio.sleep(0.1)
    assert camera.place()[0] == pan


async def test_a_cancelled_move_that_waits_is_not_sent_after_the_stop(head, camera, eventually):
    release = asyncio.Event()

    async def slow(request):
        if "pan" in request.query and "40.0000" in request.query["pan"]:
            await release.wait()

    camera.faults["/axis-cgi/com/ptz.cgi"] = slow
    first = asyncio.create_task(head.move(at(40)))
    await eventually(lambda: any("pan=40" in line for line in camera.seen))
    second = asyncio.create_task(head.move(at(50)))
    await asyncio.sleep(0.05)
    first.cancel()
    second.cancel()
    stop = asyncio.create_task(head.stop())
    await asyncio.sleep(0.05)
    release.set()
    await stop
    assert [sorted(command) for command in camera.commands] == [
        ["camera", "pan", "tilt", "zoom"],
        ["camera", "continuouspantiltmove", "continuouszoommove"],
        ["camera", "move"],
    ]


async def test_polls_tell_moving_then_stable(head, camera, eventually):
    camera.speed_deg_s = 60
    seen = []

    async def follow():
        async for poll in head.polls():
            seen.append(poll)  # noqa: PERF401 (the list is read while this runs)

    follower = asyncio.create_task(follow())
    await head.move(at(50))
    await eventually(lambda: seen[-1].motion is Motion.STABLE)
    follower.cancel()
    motions = [poll.motion for poll in seen]
    assert Motion.MOVING in motions
    assert motions[-1] is Motion.STABLE
    assert not any(poll.foreign for poll in seen)
    assert [poll.t_ns for poll in seen] == sorted(poll.t_ns for poll in seen)


async def test_motion_that_nobody_here_asked_for_is_foreign(head, camera):
    await head.move(at(5))
    polls = head.polls()
    camera.go(30, 0, 1)
    while not (await anext(polls)).foreign:
        pass
    while (poll := await anext(polls)).motion is not Motion.STABLE:
        pass
    assert not poll.foreign
    assert poll.reading.pan_deg == 30
    assert len(camera.commands) == 1


async def test_a_grabbed_picture_was_exposed_at_rest(head, camera, clock):
    await head.move(at(25, 10, 300))
    asked_ns = clock.now_ns()
    picture, view = await head.grab(asked_ns)
    assert view.frame == picture.frame
    assert picture.frame.t_capture_ns >= asked_ns
    assert view.reading == at(25, 10, 300)
    assert 0 < view.sigma_deg < 0.02


async def test_no_picture_of_a_moving_head_is_grabbed(head, camera, clock, eventually):
    camera.speed_deg_s = 60
    moving = asyncio.create_task(head.move(at(60)))
    await eventually(lambda: camera.place()[0] > 1)
    _, view = await head.grab(clock.now_ns())
    await moving
    assert view.reading == at(60)


async def test_pictures_come_with_a_pose_and_a_label(head, camera):
    pictures = head.pictures()
    picture, reading, motion = await anext(pictures)
    again, _, _ = await anext(pictures)
    assert again.frame.seq == picture.frame.seq + 1
    assert reading == at()
    assert motion in Motion
    await pictures.aclose()


@pytest.mark.parametrize("call", ["move", "grab", "stop", "polls", "pictures"])
async def test_a_lost_camera_ends_every_call(head, camera, call):
    calls = {
        "move": lambda: head.move(at(10)),
        "grab": lambda: head.grab(2**62),
        "stop": head.stop,
        "polls": lambda: _last(head.polls()),
        "pictures": lambda: _last(head.pictures()),
    }
    if call == "grab":
        waiting = asyncio.create_task(calls[call]())
        await asyncio.sleep(0.05)
    await camera.down()
    with pytest.raises(DeviceLost, match=r"127\.0\.0\.1"):
        await (waiting if call == "grab" else calls[call]())


async def _last(items) -> None:
    async for _ in items:
        pass


async def test_a_camera_that_comes_back_works_again(head, camera, serve):
    port = int(camera.url.rpartition(":")[2])
    await camera.down()
    with pytest.raises(DeviceLost):
        await _last(head.polls())
    with pytest.raises(DeviceLost, match="cannot connect"):
        await head.describe()
    await serve(camera, port)
    await head.describe()
    assert await head.move(at(15)) == at(15)


async def test_a_camera_that_starts_is_not_ready_and_a_restart_is_noticed(head, camera, caplog):
    camera.ready, camera.boot_id = False, "second"
    with pytest.raises(DeviceLost, match="is starting"):
        await head.describe()
    camera.ready = True
    await head.describe()
    assert "the camera restarted" in caplog.text


async def test_leaving_stops_a_move_under_way(camera, settings_for, clock, eventually):
    camera.speed_deg_s = 20
    async with VapixHead(settings_for(camera), Limits(), clock) as head:
        await head.describe()
        move = asyncio.create_task(head.move(at(100)))
        await eventually(lambda: camera.place()[0] > 1)
        move.cancel()
    assert camera.commands[-1]["move"] == "stop"
    assert camera.place()[0] < 100


async def test_limits_without_anything_in_common_are_refused_by_name(camera, settings_for, clock):
    async with VapixHead(settings_for(camera), Limits(tilt_deg=(-90.0, -30.0)), clock) as head:
        with pytest.raises(DeviceRefused, match=r"limits\.tilt_deg: -90 to -30 is outside what the camera can do"):
            await head.describe()
    assert camera.commands == []
