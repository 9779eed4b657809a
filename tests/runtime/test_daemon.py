"""The daemon on fakes: readiness, what is published, and an end in order whatever happens."""

from __future__ import annotations

import asyncio

import msgspec
import pytest

from ptzd.control import commands as cmd
from ptzd.control import events as ev
from ptzd.control.states import State
from ptzd.errors import BusError, DeviceLost
from ptzd.model import Box, Motion
from ptzd.outgoing import ImageAttachment
from ptzd.ports import HeadPoll
from ptzd.runtime.clock import SteadyClock
from ptzd.runtime.daemon import Daemon


class Running:
    """A daemon under way and the means to end it."""

    def __init__(self, daemon: Daemon, task: asyncio.Task[None], stop: asyncio.Event, said: list[str]) -> None:
        self.daemon, self.task, self.stop, self.said = daemon, task, stop, said

    @property
    def state(self) -> State:
        return self.daemon.pump.machine.state

    async def end(self) -> None:
        self.stop.set()
        await self.task


@pytest.fixture
async def running(rig, config, fisheye, head, bus, log, perception):
    stop, said = asyncio.Event(), []
    daemon = Daemon(
        rig=rig, config=config, clock=SteadyClock(), fisheye=fisheye, head=head, bus=bus, log=log,
        perception=perception, answering=lambda: said.append("answering"), serving=lambda: said.append("serving"),
    )  # fmt: skip
    task = asyncio.create_task(daemon.run(stop))
    yield Running(daemon, task, stop, said)
    stop.set()
    await asyncio.gather(task, return_exceptions=True)


@pytest.fixture
def well(fisheye, head, picture, poll, settled):
    async def make() -> None:
        """Both devices deliver."""
        fisheye.put(picture(0))
        head.polled.put(poll())
        await settled()
        head.seen.put((picture(1), poll().reading, Motion.STABLE))
        await settled()

    return make


async def test_it_serves_when_both_devices_are_well(running, well, log) -> None:
    await well()
    assert running.state is State.IDLE
    assert running.said == ["answering", "serving"]
    assert isinstance(log.cuts[0][1], ev.Snapshot)
    assert log.cuts[0][0] == 1, "the first thing in the log is the snapshot"


async def test_it_answers_but_does_not_serve_with_a_device_lost(running, fisheye, settled) -> None:
    fisheye.put(DeviceLost("unplugged"))
    await settled()
    assert running.said == ["answering"]
    assert running.state is State.STARTING


async def test_the_pose_goes_to_bus_and_log(running, well, bus, log) -> None:
    await well()
    pose = bus.poses[-1]
    assert pose.hfov_deg == pytest.approx(60.0, abs=0.2)
    assert pose.moving is False
    assert ("/pose", msgspec.to_builtins(pose)) in log.documents
    assert log.documents[-1][1]["moving"] is False


async def test_a_zoom_outside_the_calibration_has_no_field_of_view(running, poll) -> None:
    shown = poll()
    beyond = HeadPoll(
        reading=type(shown.reading)(pan_deg=0, tilt_deg=0, zoom=12000), t_ns=shown.t_ns, motion=Motion.MOVING
    )
    pose = running.daemon.pose(beyond)
    assert pose.hfov_deg is None
    assert pose.moving is True


async def test_pictures_are_offered_only_to_listeners(running, well, bus, fisheye, picture, settled) -> None:
    await well()
    assert bus.images == []
    bus.wanted = {"image/fisheye"}
    shown = picture(9)
    fisheye.put(shown)
    await settled()
    ((key, jpeg, attachment),) = bus.images
    assert (key, jpeg) == ("image/fisheye", shown.jpeg)
    assert attachment == ImageAttachment(seq=9, t_capture_ns=shown.frame.t_capture_ns, w=640, h=480)


async def test_ptz_pictures_carry_their_pose(running, well, bus, head, picture, poll, settled) -> None:
    await well()
    bus.wanted = {"image/ptz"}
    head.seen.put((picture(9), poll(12.0).reading, Motion.MOVING))
    await settled()
    ((key, _, attachment),) = bus.images
    assert key == "image/ptz"
    assert attachment.pan_deg == pytest.approx(12.0)
    assert attachment.motion == "moving"


async def test_the_end_gives_results_stops_the_head_and_finishes(running, well, bus, head, story, settled) -> None:
    await well()
    head.gate.clear()
    box = Box(x=330, y=230, w=40, h=32)
    bus.incoming.put_nowait(ev.RequestReceived(token=1, id="a", box=box))
    await settled()
    assert running.state is State.SCAN
    await running.end()
    results = [what for name, what in story if name == "performed" and isinstance(what, cmd.PublishResult)]
    assert [(result.id, result.outcome) for result in results] == [("a", "cancelled")]
    assert head.calls[-1] == "stop"
    assert running.state is State.STOPPED


async def test_the_end_does_not_wait_for_a_camera_that_is_lost(running, fisheye, head, settled) -> None:
    head.polled.put(DeviceLost("gone"))
    await settled()
    await running.end()
    assert "stop" not in head.calls


async def test_a_broken_bus_ends_the_daemon_in_order(running, well, bus, head, log, settled) -> None:
    await well()
    bus.incoming.put_nowait(BusError("the session is gone"))
    with pytest.raises(BusError, match="session is gone"):
        await running.task
    assert running.state is State.STOPPED
    assert head.calls[-1] == "stop"


async def test_a_defect_in_a_hand_ends_the_daemon_in_order(running, well, bus, head, settled) -> None:
    await well()
    head.error = ZeroDivisionError("somebody divided")
    bus.incoming.put_nowait(ev.RequestReceived(token=1, id="a", box=Box(x=330, y=230, w=40, h=32)))
    with pytest.raises(ZeroDivisionError):
        await running.task
    assert running.state is State.STOPPED
