"""The PTZ camera as the daemon sees it: limits, moves, positions, pictures at rest."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import suppress
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Any, Self

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.address import Address
from ptzd.devices.vapix.capabilities import Capabilities, read_capabilities
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.credentials import Credentials, exposure, read_credentials
from ptzd.devices.vapix.feed import Feed, supervise
from ptzd.devices.vapix.mover import Mover
from ptzd.devices.vapix.poller import Poller
from ptzd.devices.vapix.poses import PoseRing, Stillness
from ptzd.devices.vapix.steering import Steering
from ptzd.devices.vapix.stream import ViewStream
from ptzd.devices.vapix.witness import MotionWitness
from ptzd.errors import ConfigError, DeviceError, DeviceLost, DeviceRefused
from ptzd.model import HeadLimits, HeadReading, HeadSpeed, Lens, Motion, ViewRef
from ptzd.ports import Clock, HeadPoll, Picture

LOGGER = logging.getLogger(__name__)

REST_S = 0.3
"""Equal reports over this long are rest: longer than any camera repeats an old report."""
REPORTS_APART = 3
"""Cameras repeat a report once or twice: so many later a head that turns has another one."""
LATENCY_S = 0.2
"""From an accepted command to motion, at most (0.08 to 0.2 s assumed for current cameras)."""
HALF_EXPOSURE_NS = 25_000_000
"""Of 1/20 s, the longest exposure that a camera in usual light takes."""
AFTER_NS = 50_000_000
"""Rest that must be reported beyond the exposure, for reports younger than assumed."""
GOODBYE_S = 1.0
"""For a last stop on the way out. The core has waited 3 s for its own; together the end stays below 5 s."""


def stillness_of(settings: Ptz) -> Stillness:
    """What rest means for a camera with these settings; older reports need longer proofs."""
    return Stillness(
        span_deg=settings.arrival_tolerance_deg / 2,
        span_zoom=settings.zoom_tolerance / 2,
        rest_s=max(REST_S, 1.5 * settings.report_lag_s),
        start_s=LATENCY_S + max(0.1, settings.move_spacing_s) + 1.5 * settings.report_lag_s,
    )


class VapixHead:
    """An AXIS camera behind :class:`ptzd.ports.PtzHead`.

    Parameters
    ----------
    settings : Ptz
        Camera, stream, timing.
    limits : Limits
        Where the head may go; intersected with the camera's own limits.
    clock : Clock
        Stamps reports and pictures.
    jitter : callable or None
        Random numbers in [0, 1) for the pauses between attempts; None = the system's.
    only_asks : bool
        Send nothing that moves or changes the camera.
    takes_over : bool
        The head is this client's alone: one that turns when it connects first is stopped.

    Attributes
    ----------
    capabilities : Capabilities or None
        What the camera said at the last :meth:`describe`.
    report_lag_ns : int
        What the time stamps of polls assume of the age of a report.
    """

    def __init__(
        self,
        settings: Ptz,
        limits: Limits,
        clock: Clock,
        *,
        jitter: Callable[[], float] | None = None,
        only_asks: bool = False,
        takes_over: bool = False,
    ) -> None:
        address = Address(
            url=settings.url,
            setting="ptz",
            allow_basic_over_http=settings.allow_basic_over_http,
            certificate_sha256=settings.certificate_sha256,
        )
        stillness = stillness_of(settings)
        self.capabilities: Capabilities | None = None
        self.report_lag_ns = round(settings.report_lag_s * 1e9)
        self._settings = settings
        self._limits = limits
        self._takes_over = takes_over and not only_asks
        self._settle_ns = round(settings.settle_s * 1e9)
        self._client = CameraClient(address, clock, only_asks=only_asks)
        self._poses = PoseRing(stillness, self._settle_ns)
        self._poller = Poller(settings, self._client, self._poses, clock)
        jitter = jitter or random.SystemRandom().random
        self._stream = ViewStream(settings, self._client, clock, jitter)
        self._witness = MotionWitness(self._client, self._poses, clock, settings.camera, jitter)
        self._mover = Mover(settings, self._client, self._poller, self._poses, clock, stillness)
        self._steering = Steering(settings, self._client, self._mover, self._poller, self._poses, clock)
        self._tasks: list[asyncio.Task[None]] = []

    async def __aenter__(self) -> Self:
        self._client.use(self._credentials())
        if (warning := exposure(self._settings.password_file, setting="ptz")) is not None:
            LOGGER.warning("%s", warning)
        await self._client.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if self._mover.under_way:
                with suppress(DeviceError, TimeoutError):
                    async with asyncio.timeout(GOODBYE_S):
                        await self._mover.stop()
        finally:
            await self._halt(DeviceLost("the daemon let go of the camera"))
            await self._steering.close()
            await self._mover.close()
            await self._client.__aexit__(kind, error, trace)

    def _credentials(self) -> Credentials:
        return read_credentials(self._settings.user, self._settings.password_file, setting="ptz")

    async def describe(self) -> HeadLimits:
        """Connect and read the camera's capabilities and limits; safe to call again after a loss.

        Returns when a position and a picture have come, so that what is described also works.

        Raises
        ------
        DeviceError
            The camera does not answer, refuses, or is not what the settings say.
        """
        await self._halt(DeviceLost("connecting anew"))
        self._stream.check_pause()
        try:
            return await self._connect()
        except DeviceError as error:
            await self._halt(DeviceLost(str(error)))
            raise

    async def _connect(self) -> HeadLimits:
        try:
            self._client.use(self._credentials())
            capabilities = await read_capabilities(self._client, self._settings, self._limits)
        except ConfigError as error:
            raise DeviceRefused(str(error)) from None
        self._note(capabilities)
        await self._steering.stop_what_turns()
        self._poses.reset()
        polls, pictures = self._poller.feed, self._stream.feed
        polls.open()
        pictures.open()
        self._start(self._poller.run(), polls, "the position reports")
        self._start(self._stream.run(), pictures, "the stream")
        self._start(self._witness.run(), polls, "the motion events")
        await polls.after(polls.count)
        await pictures.after(pictures.count)
        if self._takes_over:
            await self._stop_left_over()
            self._takes_over = False
        return capabilities.limits

    async def _stop_left_over(self) -> None:
        """End a turn that nobody will end: of a daemon that was killed while somebody steered."""
        polls, first = self._poller.feed, self._poses.latest
        with self._poller.eagerly():
            for _ in range(REPORTS_APART):
                await polls.after(polls.count)
        latest = self._poses.latest
        if first is not None and latest is not None and not self._poses.equal(first.reading, latest.reading):
            LOGGER.warning("%s: the head turns though nobody here moves it; stopped", self._client.origin)
            await self._mover.send_stops(asyncio.get_running_loop().time() + self._settings.stall_s)

    def _note(self, capabilities: Capabilities) -> None:
        before, self.capabilities = self.capabilities, capabilities
        for warning in capabilities.warnings:
            if before is None or warning not in before.warnings:
                LOGGER.warning("%s: %s", self._client.origin, warning)
        if before is not None and before.boot_id != capabilities.boot_id:
            LOGGER.warning("%s: the camera restarted; check that its zero is where it was", self._client.origin)

    def _start(self, work: Coroutine[None, None, None], feed: Feed[Any], name: str) -> None:
        task = asyncio.create_task(work, name=name)
        task.add_done_callback(partial(supervise, feed=feed, name=name))
        self._tasks.append(task)

    async def _halt(self, reason: DeviceLost) -> None:
        """End polls and stream; whoever waits for them hears the reason."""
        tasks, self._tasks = self._tasks, []
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        self._poller.feed.fail(reason)
        self._stream.feed.fail(reason)

    async def move(self, target: HeadReading) -> HeadReading:
        """Move and wait for rest at the target; returns the mean of the reports at rest.

        Raises
        ------
        MoveSuperseded
            A later move or a stop took its place.
        MoveStalled
            The head rests elsewhere, is still on its way after the time the distance needs, or the target is outside
            the limits (nothing is sent then).
        DeviceError
            The camera does not answer or refuses.
        """
        self._poller.feed.check()
        if self.capabilities is None:
            raise DeviceLost("not connected; describe() comes first")
        return await self._mover.move(target, self.capabilities.limits)

    async def steer(self, speed: HeadSpeed, until_ns: int) -> HeadReading:
        """Turn and zoom until then unless something newer comes; returns where the head rests afterwards.

        Raises
        ------
        MoveSuperseded, MoveStalled, DeviceError
            As of :meth:`move`.
        """
        if self.capabilities is None:
            raise DeviceLost("not connected; describe() comes first")
        return await self._steering.steer(speed, until_ns, self.capabilities.limits.top_deg_s)

    async def set_lens(self, lens: Lens) -> None:
        """Set focus and iris; returns when the camera took it all.

        Raises
        ------
        DeviceError
            The camera does not answer, or refuses: `DeviceRefused` says what.
        """
        self._poller.feed.check()
        for request in requests.lens(self._settings.camera, lens):
            await self._client.send(request)

    async def stop(self) -> None:
        """Stop all axes; returns when the camera took both stops and its reports show rest."""
        await self._mover.stop()

    async def grab(self, not_before_ns: int) -> tuple[Picture, ViewRef]:
        """The first picture exposed wholly at rest at or after ``not_before_ns``.

        The pose is the mean of the run of reports that enclose the exposure: at least ``settle_s`` of rest before it
        and a report after it. Waits as long as polls and pictures come.
        """
        polls, pictures = self._poller.feed, self._stream.feed
        count = polls.count
        while True:
            pictures.check()
            for picture in pictures.kept:
                view = self._at_rest(picture, not_before_ns)
                if view is not None:
                    return picture, view
            count, _ = await polls.after(count)

    def _at_rest(self, picture: Picture, not_before_ns: int) -> ViewRef | None:
        if picture.exposed_after_ns is None:
            return None
        start_ns = min(picture.frame.t_capture_ns - HALF_EXPOSURE_NS, picture.exposed_after_ns)
        end_ns = picture.frame.t_capture_ns + HALF_EXPOSURE_NS
        if start_ns < not_before_ns:
            return None
        run = self._poses.rest_over(start_ns - self._settle_ns, end_ns + AFTER_NS)
        if run is None:
            return None
        return ViewRef(frame=picture.frame, reading=run.mean, sigma_deg=run.sigma_deg)

    def polls(self) -> AsyncIterator[HeadPoll]:
        """Position reports as they come; raises when the camera is lost."""
        return self._poller.feed.listen()

    async def pictures(self) -> AsyncIterator[tuple[Picture, HeadReading, Motion]]:
        """Every picture of the stream with the pose it is believed to show; raises when the stream is lost."""
        reader = self._stream.feed.listen()
        async for picture in reader:
            known = self._poses.at(picture.frame.t_capture_ns)
            if known is not None:
                yield replace(picture, lost_before=picture.lost_before + reader.passed_by), *known
