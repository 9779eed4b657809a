from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest

from ptzd.control import events as ev
from ptzd.errors import DeviceGarbled, DeviceLost, DeviceRefused
from ptzd.runtime import watch
from ptzd.runtime.frames import FrameStore
from ptzd.runtime.watch import FisheyeWatch, HeadWatch


@pytest.fixture
def told() -> list[ev.Event]:
    return []


@pytest.fixture
def pauses(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Pauses between attempts are noted instead of waited for."""
    noted: list[float] = []
    sleep = asyncio.sleep

    async def quick(seconds: float) -> None:
        if seconds:
            noted.append(seconds)
        await sleep(0)

    monkeypatch.setattr(watch.asyncio, "sleep", quick)
    return noted


@pytest.fixture
async def fisheye_watch(fisheye, log, told):
    frames = FrameStore(8)
    shown: list[int] = []
    made = FisheyeWatch(
        source=fisheye, tell=told.append, frames=frames, log=log, size_px=(640, 480),
        shown=lambda picture: shown.append(picture.frame.seq),
    )  # fmt: skip
    made.frames_kept, made.shown_seqs = frames, shown
    running = asyncio.create_task(made.run())
    yield made
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


@pytest.fixture
async def head_watch(head, log, told):
    polled: list[float] = []
    shown: list[int] = []
    made = HeadWatch(
        head=head, tell=told.append, log=log,
        polled=lambda poll: polled.append(poll.reading.pan_deg),
        shown=lambda picture, reading, motion: shown.append(picture.frame.seq),
    )  # fmt: skip
    made.polled_pans, made.shown_seqs = polled, shown
    running = asyncio.create_task(made.run())
    yield made
    running.cancel()
    await asyncio.gather(running, return_exceptions=True)


def kinds(told: list[ev.Event]) -> list[str]:
    return [type(event).__name__ for event in told]


async def test_a_frame_is_in_ring_and_log_before_the_core_hears_of_it(
    fisheye_watch, fisheye, log, told, picture, settled
) -> None:
    fisheye.put(picture(0))
    fisheye.put(picture(1, lost_before=3))
    await settled()
    assert kinds(told) == ["FrameArrived", "DeviceWell", "FrameArrived"]
    assert all(fisheye_watch.frames_kept.fisheye(event.frame) for event in told if isinstance(event, ev.FrameArrived))
    assert [topic for topic, _ in log.pictures] == ["/fisheye/image"] * 2
    assert fisheye_watch.shown_seqs == [0, 1]
    assert (fisheye_watch.frames_seen, fisheye_watch.frames_lost) == (2, 3)


async def test_a_fisheye_is_lost_once_and_well_once(fisheye_watch, fisheye, told, picture, pauses, settled) -> None:
    old = picture(0)
    fisheye.put(old)
    for _ in range(3):
        fisheye.put(DeviceLost("unplugged"))
    fisheye.put(DeviceLost("still unplugged"))
    await settled()
    assert kinds(told) == ["FrameArrived", "DeviceWell", "DeviceLost", "DeviceLost"]
    assert [event.reason for event in told[2:]] == ["unplugged", "still unplugged"]
    assert fisheye_watch.frames_kept.fisheye(old.frame) is None, "sequence numbers start anew"
    assert fisheye_watch.health.lost_since_start == 1
    fisheye.put(picture(0))
    await settled()
    assert kinds(told)[4:] == ["FrameArrived", "DeviceWell"]
    assert pauses == [0.5, 1.0, 2.0, 4.0]


async def test_pictures_of_another_size_are_refused(fisheye_watch, fisheye, told, picture, pauses, settled) -> None:
    fisheye.put(picture(0, width=320, height=240))
    await settled()
    assert kinds(told) == ["DeviceLost"]
    assert "320×240" in told[0].reason
    assert "640×480" in told[0].reason
    assert pauses == [0.5]


async def test_a_picture_that_is_none_is_a_garbled_device(
    fisheye_watch, fisheye, told, picture, pauses, settled
) -> None:
    fisheye.put(replace(picture(0), jpeg=b"<html>"))
    fisheye.put(picture(1))
    await settled()
    assert kinds(told) == ["DeviceLost", "FrameArrived", "DeviceWell"]


async def test_a_head_is_well_when_a_picture_came(head_watch, head, told, picture, poll, log, settled) -> None:
    head.polled.put(poll(1.0))
    await settled()
    assert kinds(told) == ["HeadReady", "HeadPolled"]
    head.seen.put((picture(5), poll().reading, poll().motion))
    await settled()
    assert kinds(told) == ["HeadReady", "HeadPolled", "DeviceWell"]
    assert head_watch.last_poll.reading.pan_deg == 1.0
    assert (head_watch.polled_pans, head_watch.shown_seqs) == ([1.0], [5])
    assert [topic for topic, _ in log.pictures] == ["/ptz/image"]


async def test_foreign_motion_is_told_before_its_position(head_watch, head, told, poll, settled) -> None:
    head.polled.put(poll())
    head.polled.put(poll(9.0, foreign=True))
    await settled()
    assert kinds(told)[2:] == ["ForeignMotion", "HeadPolled"]


async def test_a_lost_head_is_connected_to_again(head_watch, head, told, picture, poll, pauses, settled) -> None:
    head.polled.put(poll())
    head.seen.put((picture(5), poll().reading, poll().motion))
    await settled()
    head.polled.put(DeviceLost("no answer"))
    await settled()
    assert kinds(told)[-1] == "DeviceLost"
    head.polled.put(poll())
    head.seen.put((picture(6), poll().reading, poll().motion))
    await settled()
    assert kinds(told)[-3:] == ["HeadReady", "HeadPolled", "DeviceWell"]
    assert head.calls == ["describe", "describe"]
    assert head_watch.health.lost_since_start == 1


async def test_a_failed_command_breaks_the_connection(head_watch, head, told, picture, poll, pauses, settled) -> None:
    head.polled.put(poll())
    await settled()
    head_watch.report_lost(DeviceGarbled("nonsense"))
    await settled()
    assert kinds(told)[-1] == "DeviceLost"
    assert head.calls == ["describe", "describe"]


async def test_a_refusal_is_told_once_and_asked_about_again(head_watch, head, told, pauses, settled) -> None:
    head.refuse = DeviceRefused("401")
    head.polled.put(head.refuse)
    await settled(20)
    assert len(pauses) > 1, "it was tried again; a client that may not send yet answers by itself"
    assert kinds(told) == ["DeviceLost"]
    assert pauses == sorted(pauses)


def test_a_turned_camera_is_told_once_per_turn(caplog) -> None:
    turns = watch.Turns("PTZ")
    for orientation in (1, 6, 6, 1, 8):
        turns.note(orientation)
    assert [record.getMessage().split(",")[0] for record in caplog.records] == [
        f"PTZ: its pictures carry EXIF orientation {number}" for number in (6, 8)
    ]


async def test_a_fisheye_that_changes_its_size_while_running_is_lost_with_both_sizes(
    fisheye_watch, fisheye, told, picture, pauses, settled
) -> None:
    fisheye.put(picture(0))
    await settled()
    assert fisheye_watch.health.well
    fisheye.put(picture(1, width=320, height=240))
    await settled()
    assert not fisheye_watch.health.well
    lost = [event.reason for event in told if isinstance(event, ev.DeviceLost)]
    assert "320×240" in lost[-1]
    assert "640×480" in lost[-1]
