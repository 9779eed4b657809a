"""A fisheye that serves MJPEG over HTTP."""

from __future__ import annotations

import asyncio
import logging
import random
from collections.abc import AsyncIterator, Callable
from dataclasses import replace
from functools import partial
from types import TracebackType
from typing import Self

from yarl import URL

from ptzd.backoff import Backoff
from ptzd.config import HttpSource
from ptzd.devices.mjpeg_http import read_mjpeg
from ptzd.devices.vapix.address import Address
from ptzd.devices.vapix.answers import accepted
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.credentials import Credentials, exposure, read_credentials
from ptzd.devices.vapix.feed import Feed, supervise
from ptzd.devices.vapix.requests import Request
from ptzd.errors import ConfigError, DeviceError, DeviceRefused
from ptzd.model import FrameRef
from ptzd.ports import Clock, Picture

LOGGER = logging.getLogger(__name__)


class HttpFisheye:
    """An MJPEG camera behind :class:`ptzd.ports.FrameSource`: newest wins, losses are counted.

    Parameters
    ----------
    settings : HttpSource
    clock : Clock
        Stamps the arrivals.
    jitter : callable or None
        Random numbers in [0, 1) for the pauses between attempts; None = the system's.
    """

    def __init__(self, settings: HttpSource, clock: Clock, *, jitter: Callable[[], float] | None = None) -> None:
        address = Address(
            url=settings.url,
            setting="fisheye",
            allow_basic_over_http=settings.allow_basic_over_http,
            certificate_sha256=settings.certificate_sha256,
        )
        self._settings = settings
        self._clock = clock
        self._client = CameraClient(address, clock)
        self._request = Request(path=URL(settings.url).raw_path_qs, parse=accepted)
        self._latency_ns = round(settings.latency_s * 1e9)
        self._backoff = Backoff(jitter=jitter or random.SystemRandom().random)
        self._feed: Feed[Picture] = Feed(1)
        self._seq = 0
        self._next_seq = 0
        self._failed = False
        self._reading: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._client.use(self._credentials())
        if (warning := exposure(self._settings.password_file, setting="fisheye")) is not None:
            LOGGER.warning("%s", warning)
        await self._client.__aenter__()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._disconnect()
        await self._client.__aexit__(kind, error, trace)

    def _credentials(self) -> Credentials | None:
        if self._settings.user is None:
            return None
        return read_credentials(self._settings.user, self._settings.password_file, setting="fisheye")

    async def pictures(self) -> AsyncIterator[Picture]:
        """Pictures from now on; those that the caller was too slow for are counted in ``lost_before``.

        After a failure the next call tries again with growing pauses until the camera is back.

        Raises
        ------
        DeviceError
            Once per loss: not reachable, refused, cut, no complete picture for ``stall_s``, not an MJPEG stream.
        """
        patient, self._failed = self._failed, False
        while True:
            if patient:
                await asyncio.sleep(self._backoff.pause_s())
            count = self._feed.count
            try:
                await self._connect()
                while True:
                    count, picture = await self._feed.after(count)
                    patient = False
                    yield self._with_losses(picture)
            except DeviceError:
                if not patient:
                    self._failed = True
                    raise
            finally:
                await self._disconnect()

    async def _connect(self) -> None:
        await self._disconnect()
        try:
            self._client.use(self._credentials())
        except ConfigError as error:
            raise DeviceRefused(str(error)) from None
        self._feed.open()
        self._reading = asyncio.create_task(self._read())
        self._reading.add_done_callback(partial(supervise, feed=self._feed, name="the fisheye's stream"))

    async def _disconnect(self) -> None:
        reading, self._reading = self._reading, None
        if reading is not None:
            reading.cancel()
            await asyncio.gather(reading, return_exceptions=True)

    async def _read(self) -> None:
        await read_mjpeg(
            self._client, self._request, clock=self._clock, stall_s=self._settings.stall_s, deliver=self._take
        )

    def _take(self, jpeg: bytes | None, arrival_ns: int) -> None:
        seq, self._seq = self._seq, self._seq + 1
        if jpeg is None:
            return
        frame = FrameRef(seq=seq, t_capture_ns=arrival_ns - self._latency_ns)
        self._feed.publish(Picture(frame=frame, t_arrival_ns=arrival_ns, jpeg=jpeg))
        self._backoff.reset()

    def _with_losses(self, picture: Picture) -> Picture:
        """Numbers are given on arrival, so a gap is what was damaged or came while the caller was busy."""
        lost, self._next_seq = picture.frame.seq - self._next_seq, picture.frame.seq + 1
        return replace(picture, lost_before=lost)
