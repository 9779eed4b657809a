"""`ptzd run`: the real daemon out of its parts."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import signal
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal

import cv2
import msgspec

from ptzd.app.fingerprint import fingerprint, versions
from ptzd.app.loading import Loaded, load
from ptzd.app.motor_file import MotorBook, motor_path, motor_status, read_travel
from ptzd.app.ranges_file import RangesBook, digest_of, ranges_path, read_ranges
from ptzd.app.reloading import Reloader
from ptzd.bus.answers import LogHandler
from ptzd.bus.messages import LogReference
from ptzd.bus.server import ZenohBus
from ptzd.calibrate.watch import DriftWatch
from ptzd.config import Config, FilesSource, FisheyeSource, HttpSource
from ptzd.control.planning.zones import zones_of
from ptzd.control.states import State
from ptzd.devices.files import FilesFisheye
from ptzd.devices.http_fisheye import HttpFisheye
from ptzd.devices.v4l2 import V4l2Fisheye
from ptzd.devices.vapix.head import VapixHead
from ptzd.devices.vapix.shadow import ShadowHead
from ptzd.documents import parse_mapping
from ptzd.errors import LogError
from ptzd.evidence.illustrate import Illustrator
from ptzd.log.run_info import RunInfo
from ptzd.log.writer import McapLog
from ptzd.model import HomeAfter, ZoneKind
from ptzd.ports import Clock, FrameSource, PtzHead
from ptzd.runtime.blackening import fisheye_mask
from ptzd.runtime.clock import SteadyClock
from ptzd.runtime.daemon import Daemon
from ptzd.runtime.notify import Notifier
from ptzd.runtime.perception import ThreadPerception
from ptzd.runtime.privacy import PrivateFisheye, PrivateHead
from ptzd.runtime.roster import Roster
from ptzd.runtime.watchdog import Vital, Watchdog

OPENCV_THREADS = 1
"""Matching runs in one thread beside the loop; results do not depend on the number, latency of the loop does."""


CUT_EVERY_S = 2.0
"""Between two cuts of the log that are asked for: a client that asks in a loop would make files without end."""
VITAL_S = 10.0
"""Cameras deliver and are polled many times a second, and each poll is logged; reported losses are excused."""


_log = logging.getLogger(__name__)


@dataclass(slots=True)
class _Parts:
    """What the closures below need before it exists."""

    daemon: Daemon | None = None


async def run(loaded: Loaded, *, ready: Callable[[], None] = lambda: None) -> None:
    """Serve until SIGTERM or SIGINT. SIGHUP reads the settings again; from a terminal that closes it is the end.

    Parameters
    ----------
    loaded : Loaded
        Settings and calibration.
    ready : callable
        Called once, when requests can be served.
    """
    cv2.setNumThreads(OPENCV_THREADS)
    stop, again = asyncio.Event(), asyncio.Event()
    loop = asyncio.get_running_loop()
    wanted = {signal.SIGTERM: stop, signal.SIGINT: stop, signal.SIGHUP: stop if os.isatty(0) else again}
    for number, event in wanted.items():
        loop.add_signal_handler(number, event.set)
    try:
        await serve(loaded, stop, again=again, ready=ready)
    finally:
        for number in wanted:
            loop.remove_signal_handler(number)


async def serve(
    loaded: Loaded,
    stop: asyncio.Event,
    *,
    again: asyncio.Event | None = None,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Serve until ``stop`` is set: open the world, run the daemon in it, close it in reverse order.

    Whenever ``again`` is set the settings are read again. When the drift monitor has refined the calibration, all of it
    begins anew with that.

    Raises
    ------
    BusError, ConfigError, LogError
        When the bus, a camera's settings or the log cannot be opened.
    """
    while not stop.is_set():
        await _life(loaded, stop, again or asyncio.Event(), ready)
        if not stop.is_set():
            loaded = await asyncio.to_thread(partial(load, loaded.path, shadow=loaded.shadow))


async def _life(loaded: Loaded, stop: asyncio.Event, again: asyncio.Event, ready: Callable[[], None]) -> None:
    """One calibration's life: until ``stop``, or until there is a refined one."""
    config, clock, parts, end = loaded.config, SteadyClock(), _Parts(), asyncio.Event()
    digest = digest_of(loaded.calibration_text)

    async def follow_stop() -> None:
        await stop.wait()
        end.set()

    async with AsyncExitStack() as stack:
        notifier = stack.enter_context(Notifier(os.environ))
        illustrate = Illustrator(loaded.rig).documents
        log = await stack.enter_async_context(McapLog(config.log, _run_info(loaded), clock, illustrate=illustrate))
        bus = await stack.enter_async_context(_bus(config, log, clock, parts))
        bus.set_calibration(parse_mapping(loaded.calibration_text))
        fisheye = await stack.enter_async_context(open_fisheye(config.fisheye, clock))
        head = await stack.enter_async_context(open_head(config, clock))
        fisheye, head = await asyncio.to_thread(without_private, loaded, fisheye, head)
        perception = await stack.enter_async_context(ThreadPerception(loaded.rig))

        drift = DriftWatch(
            loaded.rig, config, loaded.calibration_text, log, idle=lambda: _idle(parts.daemon), renew=end.set
        )
        parts.daemon = Daemon(
            rig=loaded.rig,
            config=config,
            clock=clock,
            fisheye=fisheye,
            head=head,
            bus=bus,
            log=log,
            perception=perception,
            answering=lambda: notifier.ready(f"rig {config.rig} answers"),
            serving=ready,
            travel=await asyncio.to_thread(read_travel, motor_path(config)),
            compare=perception.compare,
            ranges=await asyncio.to_thread(read_ranges, config, digest, clock.now_ns()),
            watching=(drift.seen,) if config.drift.monitor else (),
        )
        bus.on_image_query(parts.daemon.gallery.newest)
        bus.on_log_query(_log_handler(log, parts.daemon))
        machine = parts.daemon.pump.machine
        book = MotorBook(motor_path(config), lambda: (machine.travel, machine.config.motor), log, clock)
        ranges = RangesBook(ranges_path(config, digest), digest, lambda: machine.ranges.locks, clock.now_ns)
        watch = Watchdog(notifier, _vitals(parts.daemon, log), lambda: str(machine.state))
        pump = parts.daemon.pump
        roster = Roster(lambda: pump.machine.config.presets, pump.tell)
        adopt = partial(_adopt, log, parts.daemon)
        reloader = Reloader(loaded, again, adopt, notifier)
        try:
            await parts.daemon.run(
                end, follow_stop, reloader.run, drift.run, watch.run, roster.run, book.run, ranges.run
            )
        finally:
            await book.keep()
            await ranges.keep()
            if stop.is_set() or not end.is_set():
                notifier.stopping("stopping")


def _bus(config: Config, log: McapLog, clock: Clock, parts: _Parts) -> ZenohBus:
    return ZenohBus(
        config.bus,
        config.rig,
        clock,
        results_kept_s=config.queue.results_kept_s,
        log_reference=lambda: _log_reference(log, clock),
        status_extra=lambda: _status_extra(log, parts.daemon, clock),
    )


def _idle(daemon: Daemon | None) -> bool:
    return daemon is not None and daemon.pump.machine.state is State.IDLE


def _run_info(loaded: Loaded) -> RunInfo:
    return RunInfo(
        rig=loaded.config.rig,
        config_text=loaded.config_text,
        calibration_text=loaded.calibration_text,
        seed=loaded.config.search.seed,
        versions=versions(),
        fingerprint=fingerprint(),
    )


def _adopt(log: McapLog, daemon: Daemon, loaded: Loaded) -> None:
    """The log first: the core's change ends its file, and the next one says at its head what holds in it."""
    log.adopt(loaded.config.log, _run_info(loaded))
    daemon.adopt(loaded.config)


@asynccontextmanager
async def open_fisheye(settings: FisheyeSource, clock: Clock) -> AsyncIterator[FrameSource]:
    """Open the frame source that the settings name."""
    source: V4l2Fisheye | HttpFisheye | FilesFisheye
    match settings:
        case HttpSource():
            source = HttpFisheye(settings, clock)
        case FilesSource():
            source = FilesFisheye(settings, clock)
        case _:
            source = V4l2Fisheye(settings, clock)
    async with source:
        yield source


@asynccontextmanager
async def open_head(config: Config, clock: Clock) -> AsyncIterator[PtzHead]:
    """Open the PTZ camera; in shadow mode it is only asked, and an imagined head moves in its place."""
    async with VapixHead(config.ptz, config.limits, clock, only_asks=config.shadow.enabled, takes_over=True) as camera:
        if not config.shadow.enabled:
            yield camera
            return
        _log.warning("shadow mode: everything is decided and logged, nothing moves; `stop` stops no camera either")
        yield ShadowHead(camera, config.ptz, config.shadow, clock)


def without_private(loaded: Loaded, fisheye: FrameSource, head: PtzHead) -> tuple[FrameSource, PtzHead]:
    """Both cameras, without what privacy zones cover; themselves where there are none."""
    zones = tuple(zone for zone in zones_of(loaded.config, loaded.rig) if zone.kind is ZoneKind.PRIVACY)
    if not zones:
        return fisheye, head
    mask = fisheye_mask(loaded.rig, zones)
    return PrivateFisheye(fisheye, mask), PrivateHead(head, loaded.rig, zones)


def _log_reference(log: McapLog, clock: Clock) -> LogReference | None:
    current = log.current_file
    return None if current is None else LogReference(file=current.name, t_ns=clock.now_ns())


def _status_extra(log: McapLog, daemon: Daemon | None, clock: Clock) -> Mapping[str, object]:
    stats = msgspec.to_builtins(log.stats())
    current = log.current_file
    extra: dict[str, object] = {
        "versions": {"ptzd": versions()["ptzd"]},
        "log": {**stats, "file": "" if current is None else str(current)},
    }
    if daemon is None:
        return extra
    machine = daemon.pump.machine
    extra["home_after"] = HomeAfter(after_s=machine.config.home.idle_s)
    extra["motor"] = motor_status(machine.travel, machine.config.motor, clock.now_ns())
    pose = daemon.head_watch.last_poll
    fisheye = daemon.fisheye_watch
    extra["devices"] = {
        "fisheye_frames": fisheye.frames_seen,
        "fisheye_lost": fisheye.frames_lost,
        "fisheye_losses": fisheye.health.lost_since_start,
        "ptz_losses": daemon.head_watch.health.lost_since_start,
    }
    return extra if pose is None else {**extra, "pose": daemon.pose(pose)}


def _log_handler(log: McapLog, daemon: Daemon) -> LogHandler:
    cut_s = -math.inf

    async def handle(action: Literal["list", "rotate"]) -> list[str]:
        nonlocal cut_s
        if action == "rotate":
            now_s = asyncio.get_running_loop().time()
            if now_s < cut_s + CUT_EVERY_S:
                wait_s = cut_s + CUT_EVERY_S - now_s
                raise LogError(f"the file was cut a moment ago; one in {CUT_EVERY_S:g} s, again in {wait_s:.1f} s")
            cut_s = now_s
            daemon.pump.cut_log()
            await log.settled()
        return [str(path) for path in log.closed_files()]

    return handle


def _vitals(daemon: Daemon, log: McapLog) -> tuple[Vital, ...]:
    """What must be alive for the service manager to be told so; a device that was reported lost is excused."""
    fisheye, head = daemon.fisheye_watch, daemon.head_watch
    return (
        Vital(
            name="fisheye",
            progress=lambda: fisheye.frames_seen,
            limit_s=VITAL_S,
            excused=lambda: not fisheye.health.well,
        ),
        Vital(
            name="ptz",
            progress=lambda: head.last_poll.t_ns if head.last_poll else 0,
            limit_s=VITAL_S,
            excused=lambda: not head.health.well,
        ),
        Vital(name="log", progress=lambda: log.beats, limit_s=VITAL_S),
    )
