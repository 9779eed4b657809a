"""The camera's one MJPEG stream, kept alive."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from ptzd.backoff import Backoff
from ptzd.config import Ptz
from ptzd.devices.mjpeg_http import read_mjpeg
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.failures import Overloaded
from ptzd.devices.vapix.feed import Feed
from ptzd.errors import DeviceGarbled, DeviceLost
from ptzd.jpeg.walk import read_header
from ptzd.model import FrameRef
from ptzd.ports import Clock, Picture

KEPT_PICTURES = 16
PICTURES_PER_STALL = 3
BURST_SHARE = 0.5
"""Of the frame interval: pictures that come faster than this have waited in a queue on their way."""


class ViewStream:
    """Pictures of the PTZ with numbers and capture times.

    Parameters
    ----------
    settings : Ptz
    client : CameraClient
    clock : Clock
    jitter : callable
        Random numbers in [0, 1) for the pauses between attempts.

    Attributes
    ----------
    damaged : int
        Pictures that came incomplete and were not delivered.
    """

    def __init__(self, settings: Ptz, client: CameraClient, clock: Clock, jitter: Callable[[], float]) -> None:
        self.feed: Feed[Picture] = Feed(KEPT_PICTURES)
        self.damaged = 0
        self._request = requests.video(settings.camera, settings.size_px, settings.fps, settings.compression)
        self._size_px = settings.size_px
        self._latency_ns = round(settings.image_latency_s * 1e9)
        self._stall_s = max(settings.stall_s, PICTURES_PER_STALL / settings.fps)
        self._client = client
        self._clock = clock
        self._backoff = Backoff(jitter=jitter)
        self._seq = 0
        self._lost = 0
        self._interval_ns = round(1e9 / settings.fps)
        self._last: Picture | None = None
        self._delivered_s = 0.0
        self._not_before_s = 0.0

    def check_pause(self) -> None:
        """Raise when the camera is overloaded and has not yet had its rest."""
        rest_s = self._not_before_s - asyncio.get_running_loop().time()
        if rest_s > 0:
            raise Overloaded(f"{self._client.origin}: stream overloaded (503); asked again in {rest_s:.1f} s", rest_s)

    async def run(self) -> None:
        """Read the stream, connect again when it is cut; returns never.

        Raises
        ------
        DeviceError
            Without a picture for ``stall_s``, refused, overloaded (503), or not what was asked for.
        """
        loop = asyncio.get_running_loop()
        self._delivered_s = loop.time()
        while True:
            try:
                await read_mjpeg(
                    self._client, self._request, clock=self._clock, stall_s=self._stall_s, deliver=self._take
                )
            except Overloaded as error:
                self._not_before_s = loop.time() + max(error.retry_after_s or 0.0, self._backoff.pause_s())
                raise
            except DeviceLost:
                pause_s = self._backoff.pause_s()
                if loop.time() + pause_s - self._delivered_s >= self._stall_s:
                    raise
                await asyncio.sleep(pause_s)

    def _take(self, jpeg: bytes | None, arrival_ns: int) -> None:
        seq, self._seq = self._seq, self._seq + 1
        if jpeg is None:
            self.damaged += 1
            self._lost += 1
            return
        self._check_size(jpeg)
        picture = Picture(
            frame=FrameRef(seq=seq, t_capture_ns=arrival_ns - self._latency_ns),
            t_arrival_ns=arrival_ns,
            jpeg=jpeg,
            lost_before=self._lost,
            exposed_after_ns=self._exposed_after_ns(arrival_ns),
        )
        self._last = picture
        self.feed.publish(picture)
        self._lost = 0
        self._delivered_s = asyncio.get_running_loop().time()
        self._backoff.reset()

    def _exposed_after_ns(self, arrival_ns: int) -> int | None:
        """Earliest time at which a picture that arrives now can have been exposed.

        MJPEG carries no time, so a picture that a busy network or camera held back looks fresh. It is younger than the
        one before it; and in a burst, which is a queue running empty, each is only as young as the first of them.
        """
        last = self._last
        if last is None:
            return None
        if arrival_ns - last.t_arrival_ns < BURST_SHARE * self._interval_ns:
            return last.exposed_after_ns
        return last.frame.t_capture_ns

    def _check_size(self, jpeg: bytes) -> None:
        width, height = read_header(jpeg).size_px
        wanted = self._size_px
        if (width, height) != wanted:
            raise DeviceGarbled(
                f"the camera sends pictures of {width}×{height} px, not {wanted[0]}×{wanted[1]} px; "
                "set ptz.size_px to a size it has and calibrate at that"
            )
