"""The fisheye behind a kernel driver: an endless series of pictures that heals itself.

The device's descriptor is watched by the event loop; nothing waits in a thread while the camera is silent. Opening,
closing and encoding raw pixels, which take time, run off the loop.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncGenerator, Callable
from contextlib import aclosing, suppress
from types import TracebackType
from typing import Self

import cv2
import numpy as np

from ptzd.config import V4l2Source
from ptzd.devices.v4l2_capture import BYTES_PER_PIXEL, Capture, Layout, Shot, Tally, open_capture
from ptzd.devices.v4l2_kernel import Device, KernelDevice
from ptzd.errors import DeviceError, DeviceLost
from ptzd.jpeg.pixels import encode_jpeg
from ptzd.model import FrameRef
from ptzd.ports import Clock, Picture

FIRST_WAIT_S = 0.25
LONGEST_WAIT_S = 4.0
"""Between two attempts to open a device that is gone: quick enough after a replug, quiet enough over a night."""

_log = logging.getLogger(__name__)


class V4l2Fisheye:
    """A :class:`ptzd.ports.FrameSource` on a V4L2 capture device.

    Parameters
    ----------
    settings : V4l2Source
        Device, format, size, rate, controls.
    clock : Clock
        Turns the driver's stamps into the daemon's time.
    open_device : callable
        Opens a device node by its name.

    Attributes
    ----------
    tally : Tally
        What became of the pictures so far.
    layout : Layout or None
        What the driver granted at the last opening.
    """

    def __init__(
        self, settings: V4l2Source, clock: Clock, *, open_device: Callable[[str], Device] = KernelDevice.open
    ) -> None:
        self.tally = Tally()
        self.layout: Layout | None = None
        self._settings = settings
        self._clock = clock
        self._open_device = open_device
        self._streaming: AsyncGenerator[Picture, None] | None = None
        self._loss_told = False
        self._stamps_told = False
        self._last_number: int | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._streaming is not None:
            await self._streaming.aclose()

    def pictures(self) -> AsyncGenerator[Picture, None]:
        """Pictures from now on; see :class:`ptzd.ports.FrameSource`.

        A camera has one reader: a new series ends the one before, whoever still holds it.
        """
        self._streaming = self._healing(self._streaming)
        return self._streaming

    async def _healing(self, before: AsyncGenerator[Picture, None] | None) -> AsyncGenerator[Picture, None]:
        if before is not None:
            await before.aclose()
        wait_s = FIRST_WAIT_S
        while True:
            try:
                async with aclosing(self._opening()) as opening:
                    async for picture in opening:
                        wait_s, self._loss_told = FIRST_WAIT_S, False
                        yield picture
            except DeviceError as error:
                if not self._loss_told:
                    self._loss_told = True
                    raise
                _log.debug("still waiting: %s", error)
            await asyncio.sleep(wait_s)
            wait_s = min(2 * wait_s, LONGEST_WAIT_S)

    async def _opening(self) -> AsyncGenerator[Picture, None]:
        """Pictures of one opening, until the device is lost."""
        capture = await self._open()
        try:
            self._tell_shortfalls(capture.layout)
            with _Newest(capture, self._clock) as newest:
                while True:
                    shot, t_arrival_ns = await self._next(newest)
                    self._tell_stamps(capture.stamps.complaint)
                    yield await self._picture(shot, t_arrival_ns, capture.layout)
        finally:
            await asyncio.to_thread(capture.close)

    async def _open(self) -> Capture:
        opening = asyncio.ensure_future(asyncio.to_thread(open_capture, self._settings, self._open_device, self.tally))
        try:
            return await asyncio.shield(opening)
        except asyncio.CancelledError:
            with suppress(DeviceError):
                (await opening).close()
            raise

    def _tell_shortfalls(self, layout: Layout) -> None:
        told = () if self.layout is None else self.layout.shortfalls
        if layout.shortfalls and layout.shortfalls != told:
            _log.warning("%s: not granted: %s", self._settings.device, "; ".join(layout.shortfalls))
        self.layout = layout

    def _tell_stamps(self, complaint: str) -> None:
        if complaint and not self._stamps_told:
            _log.warning("%s: %s", self._settings.device, complaint)
        self._stamps_told = bool(complaint)

    async def _next(self, newest: _Newest) -> tuple[Shot, int]:
        try:
            async with asyncio.timeout(self._settings.stall_s):
                return await newest.take()
        except TimeoutError:
            raise DeviceLost(
                f"{self._settings.device}: no usable picture for {self._settings.stall_s:g} s "
                f"({self.tally.summary()}); check cable, light and power"
            ) from None

    async def _picture(self, shot: Shot, t_arrival_ns: int, layout: Layout) -> Picture:
        jpeg = shot.data
        if layout.format in BYTES_PER_PIXEL:
            jpeg = await asyncio.to_thread(encode_raw, shot.data, layout)
        stamp_ns = shot.t_monotonic_ns
        t_capture_ns = t_arrival_ns if stamp_ns is None else self._clock.from_monotonic_ns(stamp_ns)
        lost = 0 if self._last_number is None else shot.number - self._last_number - 1
        self._last_number = shot.number
        self.tally.delivered += 1
        return Picture(
            frame=FrameRef(seq=shot.number, t_capture_ns=t_capture_ns),
            t_arrival_ns=t_arrival_ns,
            jpeg=jpeg,
            lost_before=lost,
        )


class _Newest:
    """The newest picture of a capture, kept up to date by the event loop until it is taken."""

    def __init__(self, capture: Capture, clock: Clock) -> None:
        self._capture = capture
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._wake = asyncio.Event()
        self._outcome: tuple[Shot, int] | Exception | None = None

    def __enter__(self) -> Self:
        self._loop.add_reader(self._capture.fileno(), self._readable)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._loop.remove_reader(self._capture.fileno())

    async def take(self) -> tuple[Shot, int]:
        """The newest picture and its time of arrival; waits for one; raises what ended the capture."""
        while self._outcome is None:
            self._wake.clear()
            await self._wake.wait()
        outcome = self._outcome
        if isinstance(outcome, Exception):
            raise outcome
        self._outcome = None
        return outcome

    def _readable(self) -> None:
        try:
            shot = self._capture.newest()
        except Exception as error:  # noqa: BLE001  # raised again by take(): a callback of the loop has nobody to tell
            self._loop.remove_reader(self._capture.fileno())
            self._outcome = error
        else:
            if shot is None:
                return
            if self._outcome is not None:
                self._capture.tally.superseded += 1
            self._outcome = (shot, self._clock.now_ns())
        self._wake.set()


def encode_raw(data: bytes, layout: Layout) -> bytes:
    """Encode the rows of a raw picture, which may be padded, as JPEG.

    Parameters
    ----------
    data : bytes
        ``bytes_per_line`` times height bytes.
    layout : Layout
        Format ``YUYV`` or ``UYVY`` (two pixels in four bytes) or ``GREY``.
    """
    width, height = layout.size_px
    rows = np.frombuffer(data, np.uint8).reshape(height, layout.bytes_per_line)
    pixels = rows[:, : width * BYTES_PER_PIXEL[layout.format]]
    if layout.format == "GREY":
        return encode_jpeg(pixels)
    conversion = cv2.COLOR_YUV2BGR_UYVY if layout.format == "UYVY" else cv2.COLOR_YUV2BGR_YUYV
    return encode_jpeg(np.asarray(cv2.cvtColor(pixels.reshape(height, width, 2), conversion), np.uint8))
