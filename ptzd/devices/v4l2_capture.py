"""One opening of a video device: negotiate, map buffers, take the newest picture with one copy."""

from __future__ import annotations

import errno
import mmap
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass

from ptzd.config import V4l2Source
from ptzd.devices import v4l2_abi as abi
from ptzd.devices.v4l2_controls import apply_controls
from ptzd.devices.v4l2_kernel import Device, device_error
from ptzd.devices.v4l2_loss import Numbering
from ptzd.devices.v4l2_stamps import StampJudge
from ptzd.errors import DeviceRefused
from ptzd.jpeg.walk import whole_length

BUFFERS = 4
"""One being filled, one ready, two for the time that the loop is busy elsewhere (66 ms at 30 pictures/s)."""

BYTES_PER_PIXEL = {"YUYV": 2, "UYVY": 2, "GREY": 1}
"""Of the raw formats; MJPG and JPEG have no fixed size."""
SAME = {"MJPG": "JPEG", "JPEG": "MJPG"}
"""Two names for a series of whole JPEG pictures; drivers know one or the other."""


@dataclass(slots=True, kw_only=True)
class Tally:
    """What became of the pictures of a source, since it was made."""

    numbered: int = 0
    """Numbers given, lost pictures included."""
    delivered: int = 0
    superseded: int = 0
    """Whole pictures that a newer one replaced before they were taken."""
    flagged: int = 0
    """Marked as faulty by the driver."""
    undated: int = 0
    """With a time stamp that cannot be, while the stamps were still believed."""
    truncated: int = 0
    """Cut off, without a mark."""
    openings: int = 0

    @property
    def missing(self) -> int:
        """Pictures that never came: skipped by the driver or not sent by the camera."""
        return self.numbered - self.delivered - self.superseded - self.flagged - self.truncated - self.undated

    def summary(self) -> str:
        """One phrase for a person."""
        unusable = f"{self.flagged} faulty, {self.truncated} cut off"
        return f"{self.delivered} delivered, {self.superseded} replaced by newer ones, {unusable}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """What the driver granted."""

    format: str
    size_px: tuple[int, int]
    bytes_per_line: int
    """Of a raw picture, padding included; without meaning for MJPG."""
    period_s: float | None
    card: str
    shortfalls: tuple[str, ...]
    """What was asked for and not granted, one phrase each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One usable picture as the driver delivered it, copied out of its buffer."""

    number: int
    t_monotonic_ns: int | None
    """The driver's stamp on CLOCK_MONOTONIC (start of exposure on UVC cameras); None when it has another clock."""
    data: bytes


def negotiate(device: Device, settings: V4l2Source) -> Layout:
    """Set format, size, rate and controls and read back what the driver made of them.

    Raises
    ------
    DeviceRefused
        The node does not capture, or does not grant format or size: without them the calibration is wrong.
    OSError
        As the kernel answered.
    """
    capability = abi.Capability()
    device.ioctl(abi.QUERYCAP, capability)
    if not captures(capability):
        raise DeviceRefused(
            f"{settings.device}: does not stream single-planar video; see `ptzd check` for nodes that do"
        )
    pix = _set_format(device, settings)
    period_s, rate_shortfall = _set_rate(device, settings.fps)
    shortfalls = (*filter(None, (rate_shortfall,)), *apply_controls(device, settings.controls))
    return Layout(
        format=settings.format,
        size_px=settings.size_px,
        bytes_per_line=max(pix.bytesperline, BYTES_PER_PIXEL.get(settings.format, 0) * pix.width),
        period_s=period_s,
        card=capability.card.decode("utf-8", "replace"),
        shortfalls=shortfalls,
    )


def captures(capability: abi.Capability) -> bool:
    """Whether this node (not only the device it belongs to) streams video in."""
    of_node = capability.capabilities & abi.CAP_DEVICE_CAPS
    caps = capability.device_caps if of_node else capability.capabilities
    return bool(caps & abi.CAP_VIDEO_CAPTURE and caps & abi.CAP_STREAMING)


def _set_format(device: Device, settings: V4l2Source) -> abi.PixelFormat:
    width, height = settings.size_px
    wanted = abi.Format(type=abi.BUF_TYPE_VIDEO_CAPTURE)
    pix = wanted.fmt.pix
    pix.width, pix.height, pix.pixelformat, pix.field = width, height, abi.fourcc(settings.format), abi.FIELD_ANY
    device.ioctl(abi.S_FMT, wanted)
    granted = abi.fourcc_text(pix.pixelformat)
    if granted not in {settings.format, SAME.get(settings.format)} or (pix.width, pix.height) != (width, height):
        raise DeviceRefused(
            f"{settings.device}: asked for {settings.format} {width}x{height} px, the driver offers "
            f"{granted} {pix.width}x{pix.height} px; set fisheye.format and fisheye.size_px to one that `ptzd check` "
            "lists"
        )
    return pix


def _set_rate(device: Device, fps: float) -> tuple[float | None, str | None]:
    wanted = abi.StreamParameters(type=abi.BUF_TYPE_VIDEO_CAPTURE)
    wanted.timeperframe.numerator, wanted.timeperframe.denominator = 1000, round(fps * 1000)
    try:
        device.ioctl(abi.S_PARM, wanted)
    except OSError as error:
        if error.errno in (errno.EINVAL, errno.ENOTTY):
            return None, f"fps: asked for {fps:g}, the driver cannot set a rate"
        raise
    per_picture = wanted.timeperframe
    if not per_picture.numerator or not per_picture.denominator:
        return None, f"fps: asked for {fps:g}, the driver does not say which it uses"
    period_s = per_picture.numerator / per_picture.denominator
    granted = 1 / period_s
    return period_s, None if abs(granted - fps) < 0.01 * fps else f"fps: asked for {fps:g}, got {granted:.4g}"


class Capture:
    """A device that streams; made by :func:`open_capture`, owns what it is given.

    Parameters
    ----------
    device : Device
        Negotiated, its buffers handed to the driver, streaming.
    name : str
        For messages.
    layout : Layout
        What the driver granted.
    maps : list of mmap
        The driver's buffers by index.
    tally : Tally
        Counts on over all openings of a source.
    """

    def __init__(self, device: Device, name: str, layout: Layout, maps: list[mmap.mmap], tally: Tally) -> None:
        self.layout = layout
        self.tally = tally
        self._device = device
        self._name = name
        self._maps = maps
        self._numbering = Numbering(layout.period_s, tally.numbered)
        self.stamps = StampJudge()

    def fileno(self) -> int:
        """Readable when :meth:`newest` has something to say."""
        return self._device.fileno()

    def newest(self) -> Shot | None:
        """Take all full buffers, keep the newest usable picture, give the buffers back; never waits.

        Raises
        ------
        DeviceError
            The device is gone.
        """
        held: tuple[abi.Buffer, int, int] | None = None
        try:
            for _ in range(2 * BUFFERS):
                buffer = self._dequeue()
                if buffer is None:
                    break
                dated = self.stamps.judge(_stamp_ns(buffer))
                number = self._number(buffer)
                length = self._usable_length(buffer)
                if length is not None and not dated:
                    self.tally.undated += 1
                    length = None
                if length is None:
                    self._enqueue(buffer)
                    continue
                if held is not None:
                    self.tally.superseded += 1
                    self._enqueue(held[0])
                held = (buffer, number, length)
            if held is None:
                return None
            buffer, number, length = held
            shot = Shot(number=number, t_monotonic_ns=self._stamp_ns(buffer), data=self._maps[buffer.index][:length])
            self._enqueue(buffer)
        except OSError as error:
            raise device_error(error, self._name, "read a picture") from error
        return shot

    def close(self) -> None:
        """Stop streaming and release everything; a device that is gone is released all the same."""
        with suppress(OSError):
            self._device.ioctl(abi.STREAMOFF, abi.StreamType(type=abi.BUF_TYPE_VIDEO_CAPTURE))
        for mapped in self._maps:
            mapped.close()
        self._maps.clear()
        self._device.close()

    def _dequeue(self) -> abi.Buffer | None:
        buffer = _blank_buffer(0)
        try:
            self._device.ioctl(abi.DQBUF, buffer)
        except BlockingIOError:
            return None
        return buffer

    def _enqueue(self, buffer: abi.Buffer) -> None:
        self._device.ioctl(abi.QBUF, _blank_buffer(buffer.index))

    def _number(self, buffer: abi.Buffer) -> int:
        number = self._numbering.note(buffer.sequence, self._stamp_ns(buffer))
        self.tally.numbered = self._numbering.next
        return number

    def _stamp_ns(self, buffer: abi.Buffer) -> int | None:
        return _stamp_ns(buffer) if self.stamps.believed else None

    def _usable_length(self, buffer: abi.Buffer) -> int | None:
        if buffer.flags & abi.BUF_FLAG_ERROR:
            self.tally.flagged += 1
            return None
        length = self._whole_length(buffer)
        if length is None:
            self.tally.truncated += 1
        return length

    def _whole_length(self, buffer: abi.Buffer) -> int | None:
        if self.layout.format not in BYTES_PER_PIXEL:
            return whole_length(self._maps[buffer.index], buffer.bytesused)
        whole = self.layout.bytes_per_line * self.layout.size_px[1]
        return whole if buffer.bytesused >= whole else None


def open_capture(settings: V4l2Source, open_device: Callable[[str], Device], tally: Tally) -> Capture:
    """Open, negotiate and start streaming; takes as long as the camera needs (run it off the loop).

    Raises
    ------
    DeviceLost, DeviceRefused
        The device is not there, or does not do what it is asked; nothing stays open.
    """
    doing = "open it"
    try:
        with ExitStack() as undo:
            device = open_device(settings.device)
            undo.callback(device.close)
            doing = "set it up"
            layout = negotiate(device, settings)
            doing = "start it"
            maps = _map_buffers(device, undo)
            device.ioctl(abi.STREAMON, abi.StreamType(type=abi.BUF_TYPE_VIDEO_CAPTURE))
            undo.pop_all()
    except OSError as error:
        raise device_error(error, settings.device, doing) from error
    tally.openings += 1
    return Capture(device, settings.device, layout, maps, tally)


def _map_buffers(device: Device, undo: ExitStack) -> list[mmap.mmap]:
    request = abi.RequestBuffers(count=BUFFERS, type=abi.BUF_TYPE_VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)
    device.ioctl(abi.REQBUFS, request)
    maps = []
    for index in range(request.count):
        buffer = _blank_buffer(index)
        device.ioctl(abi.QUERYBUF, buffer)
        maps.append(undo.enter_context(device.map(buffer.length, buffer.m.offset)))
        device.ioctl(abi.QBUF, _blank_buffer(index))
    return maps


def _blank_buffer(index: int) -> abi.Buffer:
    return abi.Buffer(index=index, type=abi.BUF_TYPE_VIDEO_CAPTURE, memory=abi.MEMORY_MMAP)


def _stamp_ns(buffer: abi.Buffer) -> int | None:
    if buffer.flags & abi.BUF_FLAG_TIMESTAMP_MASK != abi.BUF_FLAG_TIMESTAMP_MONOTONIC:
        return None
    return buffer.timestamp.tv_sec * 1_000_000_000 + buffer.timestamp.tv_usec * 1_000
