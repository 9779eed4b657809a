"""The V4L2 reader against the kernel's own drivers: uvcvideo with a software camera, vivid for raw formats."""

from __future__ import annotations

import asyncio
import os
import time
from contextlib import aclosing, suppress
from pathlib import Path

import cv2
import msgspec
import numpy as np
from checks import Checks, UvcCamera, shell

from ptzd.config import V4l2Source
from ptzd.devices.v4l2 import V4l2Fisheye
from ptzd.devices.v4l2_list import list_devices
from ptzd.errors import DeviceLost, DeviceRefused
from ptzd.runtime.clock import SteadyClock

WIDTH, HEIGHT, FPS = 640, 480, 5
STABLE_NAME = "/dev/ptzd/fisheye"
SETTINGS = V4l2Source(device=STABLE_NAME, size_px=(WIDTH, HEIGHT), fps=FPS, stall_s=6.0)
PICTURES = Path("/run/pictures")
LEAST = 100
"""Pictures, however short the soak."""
PARTS = 12
"""Of the soak, with a look at the memory in each; in the first third buffers and timers come to what they stay."""


def shown() -> set[bytes]:
    """The pictures that the camera shows."""
    return {path.read_bytes() for path in PICTURES.iterdir()}


def run(checks: Checks, soak_s: float) -> None:
    make_pictures()
    # the kernel merges small pages into one of 2 MiB when it finds the time: memory that nobody took would seem to grow
    shell("echo never > /sys/kernel/mm/transparent_hugepage/enabled")
    shell("modprobe uvcvideo nodrop=1; modprobe vhci-hcd")
    with UvcCamera(PICTURES, f"{WIDTH}x{HEIGHT}", FPS).plugged_in() as camera:
        checks.until("udev gives the camera its stable name", Path(STABLE_NAME).exists)
        check_list(checks)
        for suite in (pictures, refusals, controls, losses, slow_reader, damage, stall, unplug):
            print(f"-- {suite.__name__}", flush=True)
            asyncio.run(suite(checks, camera))
        print("-- soak", flush=True)
        asyncio.run(soak(checks, camera, soak_s))
    for form in ("YUYV", "GREY"):
        asyncio.run(raw(checks, form))


def make_pictures() -> None:
    PICTURES.mkdir(exist_ok=True)
    noise = np.random.default_rng(1).integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), np.uint8)
    scene = cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    for number in range(8):
        shown = cv2.circle(scene.copy(), (80 + 60 * number, 240), 40, (0, 0, 255), -1)
        (PICTURES / f"{number}.jpg").write_bytes(cv2.imencode(".jpg", shown)[1].tobytes())


def check_list(checks: Checks) -> None:
    offers, failures = list_devices()
    names = [name for offer in offers for name in offer.stable_names]
    checks.that("the list has the camera with its stable name first", names[:1] == [STABLE_NAME], names)
    checks.that("every node could be asked", not failures, failures)
    if offers:
        told = [f"{offer.fourcc} {size}" for offer in offers[0].formats for size in offer.sizes]
        checks.that("the list has its format, size and rate", told == ["MJPG 640x480 @ 5 fps"], told)
        keys = {control.key for control in offers[0].controls}
        checks.that("the list has its controls", {"brightness", "gain", "exposure_time_absolute"} <= keys, sorted(keys))


async def take(fisheye: V4l2Fisheye, count: int):
    async with aclosing(fisheye.pictures()) as stream:
        return [await anext(stream) for _ in range(count)]


async def pictures(checks: Checks, camera: UvcCamera) -> None:
    clock = SteadyClock()
    sources = shown()
    taken = await take(V4l2Fisheye(SETTINGS, clock), 12)
    checks.that("the bytes are the camera's own", all(picture.jpeg in sources for picture in taken))
    numbers = [picture.frame.seq for picture in taken]
    lost = sum(picture.lost_before for picture in taken)
    checks.that("gaps in the numbers are the losses", numbers[-1] - numbers[0] == len(taken) - 1 + lost, numbers)
    ages_s = [(picture.t_arrival_ns - picture.frame.t_capture_ns) / 1e9 for picture in taken]
    checks.that("stamps are of this clock and of now", all(-0.1 < age < 10 for age in ages_s), f"{max(ages_s):.3f} s")


async def refusals(checks: Checks, camera: UvcCamera) -> None:
    for wrong, words in ((("size_px", (320, 240)), "640x480"), (("format", "YUYV"), "MJPG")):
        try:
            await take(V4l2Fisheye(msgspec.structs.replace(SETTINGS, **dict([wrong])), SteadyClock()), 1)
        except DeviceRefused as error:
            checks.that(f"{wrong[0]} {wrong[1]} is refused with what there is", words in str(error), error)
        else:
            checks.that(f"{wrong[0]} {wrong[1]} is refused", holds=False)
    first = V4l2Fisheye(SETTINGS, SteadyClock())
    async with aclosing(first.pictures()) as stream:
        await anext(stream)
        try:
            await take(V4l2Fisheye(SETTINGS, SteadyClock()), 1)
        except DeviceRefused as error:
            checks.that("a camera in use is refused with the cure", "another program" in str(error), error)
        else:
            checks.that("a camera in use is refused", holds=False)


async def controls(checks: Checks, camera: UvcCamera) -> None:
    wanted = {"brightness": 99, "auto_exposure": 1, "exposure_time_absolute": 50, "gain": 400, "focus": 1}
    fisheye = V4l2Fisheye(msgspec.structs.replace(SETTINGS, controls=wanted), SteadyClock())
    await take(fisheye, 1)
    told = fisheye.layout.shortfalls if fisheye.layout else ()
    checks.that("only what was not granted is said", len(told) == 2, told)
    checks.that("with value and range", told[:1] == ("gain: asked for 400, allowed are 0 to 100, is 100",))
    checks.that("or that it does not exist", "focus: no such control" in told[-1])


async def losses(checks: Checks, camera: UvcCamera) -> None:
    fisheye = V4l2Fisheye(SETTINGS, SteadyClock())
    async with aclosing(fisheye.pictures()) as stream:
        for _ in range(20):
            await anext(stream)
        camera.tell("drop 7")
        lost = [(await anext(stream)).lost_before for _ in range(12)]
    checks.that("pictures that the camera never sent are counted by the stamps", max(lost) >= 6, lost)


async def slow_reader(checks: Checks, camera: UvcCamera) -> None:
    clock = SteadyClock()
    fisheye = V4l2Fisheye(SETTINGS, clock)
    async with aclosing(fisheye.pictures()) as stream:
        await anext(stream)
        await asyncio.to_thread(watch, camera, 10)
        late = await anext(stream)
        checks.that("a reader that sleeps gets the newest", clock.now_ns() - late.frame.t_capture_ns < 3e9)
        checks.that("and is told what it missed", late.lost_before >= 8, late.lost_before)
        superseded = fisheye.tally.superseded
        watch(camera, 12)
        late = await anext(stream)
        after = await anext(stream)
        missed = late.lost_before + after.lost_before
        checks.that("pictures that the driver had no buffer for are counted too", missed >= 10, missed)
        checks.that("they are not those replaced by newer ones", fisheye.tally.superseded - superseded <= 8)


def watch(camera: UvcCamera, pictures: int) -> None:
    """Until the camera has sent so many; in the loop's own thread nothing else runs meanwhile."""
    enough = camera.sent() + pictures
    while camera.sent() < enough:
        time.sleep(0.2)


async def damage(checks: Checks, camera: UvcCamera) -> None:
    fisheye = V4l2Fisheye(SETTINGS, SteadyClock())
    sources = shown()
    async with aclosing(fisheye.pictures()) as stream:
        await anext(stream)
        camera.tell("truncate 3")
        whole = [(await anext(stream)).jpeg in sources for _ in range(8)]
        checks.that("cut-off pictures are counted", fisheye.tally.truncated == 3, fisheye.tally)
        camera.tell("fault 2")
        whole += [(await anext(stream)).jpeg in sources for _ in range(8)]
        checks.that("pictures that the driver marks are counted", fisheye.tally.flagged == 2, fisheye.tally)
        checks.that("none of them is delivered", all(whole))


async def stall(checks: Checks, camera: UvcCamera) -> None:
    fisheye = V4l2Fisheye(SETTINGS, SteadyClock())
    stream = fisheye.pictures()
    await anext(stream)
    camera.tell("stall")
    begin_s = time.monotonic()
    try:
        while True:
            await anext(stream)
    except DeviceLost as error:
        took_s = time.monotonic() - begin_s
        checks.that("a silent camera is lost after stall_s", 5.9 < took_s < 30, f"{took_s:.1f} s: {error}")
    camera.tell("resume")
    checks.that("and well again when it speaks", len(await take(fisheye, 2)) == 2)


async def unplug(checks: Checks, camera: UvcCamera) -> None:
    fisheye = V4l2Fisheye(msgspec.structs.replace(SETTINGS, stall_s=120.0), SteadyClock())
    for turn in (1, 2):
        stream = fisheye.pictures()
        await anext(stream)
        last = fisheye.tally.numbered - 1
        begin_s = time.monotonic()
        await asyncio.to_thread(camera.tell, "detach")
        try:
            while True:
                await anext(stream)
        except DeviceLost as error:
            took_s = time.monotonic() - begin_s
            checks.that(f"an unplugged camera is lost at once ({turn})", took_s < 20, f"{took_s:.2f} s: {error}")
        await asyncio.to_thread(camera.tell, "attach")
        picture = (await take(fisheye, 1))[0]
        checks.that(f"plugged in again it goes on under its name ({turn})", picture.frame.seq > last, fisheye.tally)


async def soak(checks: Checks, camera: UvcCamera, soak_s: float) -> None:
    """Every picture that the driver delivered comes out, and memory stays as it is."""
    fisheye = V4l2Fisheye(msgspec.structs.replace(SETTINGS, stall_s=120.0), SteadyClock())
    sent, memory_kib = camera.sent(), []
    async with aclosing(fisheye.pictures()) as stream:
        start_s = time.monotonic()
        while (passed_s := time.monotonic() - start_s) < soak_s or fisheye.tally.delivered < LEAST:
            await anext(stream)
            if passed_s >= len(memory_kib) * soak_s / PARTS:
                memory_kib.append(resident_kib())
        camera.tell("stall")
        with suppress(TimeoutError):
            while True:
                await asyncio.wait_for(anext(stream), 6)
    sent, tally = camera.tell("resume") - sent, fisheye.tally
    later_kib = memory_kib[PARTS // 3 :]
    grown_kib = max(later_kib) - later_kib[0]
    print(f"     {soak_s:g} s: {sent} pictures sent, {tally.delivered} came out", flush=True)
    checks.that(
        "none that the driver delivered was lost", tally.superseded + tally.flagged + tally.truncated == 0, tally
    )
    checks.that("and none that the camera sent, but for the first", sent - tally.delivered in (0, 1))
    checks.that("memory did not grow after a third", grown_kib < 512, f"{memory_kib} KiB")


def resident_kib() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


async def raw(checks: Checks, form: str) -> None:
    """The test picture of vivid, in formats that have to be encoded."""
    shell("modprobe vivid n_devs=1 node_types=0x1")
    device = shell("basename $(ls -d /sys/devices/platform/vivid.0/video4linux/video* | head -n 1)")
    settings = V4l2Source(device=f"/dev/{device}", size_px=(320, 180), fps=10, format=form, stall_s=20.0)
    try:
        taken = await take(V4l2Fisheye(settings, SteadyClock()), 3)
    except DeviceRefused as error:
        checks.that(f"{form} is read and encoded", holds=False, seen=error)
        return
    shown = cv2.imdecode(np.frombuffer(taken[-1].jpeg, np.uint8), cv2.IMREAD_COLOR)
    checks.that(f"{form} is read and encoded", shown.shape == (180, 320, 3) and shown.std() > 20, f"{shown.std():.0f}")
