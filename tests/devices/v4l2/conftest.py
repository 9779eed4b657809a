"""A kernel with one video driver in it, as the reader sees it: descriptors, requests, mapped memory."""

from __future__ import annotations

import asyncio
import errno
import mmap
import os
import threading
from dataclasses import dataclass, field

import cv2
import numpy as np
import pytest

from ptzd.config import V4l2Source
from ptzd.devices import v4l2_abi as abi
from ptzd.devices import v4l2_stamps

PAGE = mmap.PAGESIZE
MONOTONIC_OFFSET_NS = 1_000_000_000_000


@dataclass
class FakeControl:
    id: int
    name: str
    low: int
    high: int
    value: int
    type: int = 1
    flags: int = 0
    refuses: int = 0


@dataclass
class FakeKernel:
    """A machine with (at most) one camera; tests plug it, feed it and look at what was left behind."""

    sizes: dict[str, list[tuple[int, int]]] = field(
        default_factory=lambda: {
            "MJPG": [(64, 48), (32, 24)],
            "YUYV": [(64, 48)],
            "GREY": [(64, 48)],
        }
    )
    fastest_fps: int = 30
    padding: int = 0
    controls: list[FakeControl] = field(default_factory=list)
    caps: int = abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
    stamps: int = abi.BUF_FLAG_TIMESTAMP_MONOTONIC
    open_error: int = errno.ENOENT
    plugged: bool = True
    started: threading.Semaphore = field(default_factory=lambda: threading.Semaphore(0))
    emptied: asyncio.Event = field(default_factory=asyncio.Event)
    fails: dict[int, int] = field(default_factory=dict)
    now_ns: int = 0
    """CLOCK_MONOTONIC: when the last picture was taken."""
    devices: list[FakeDevice] = field(default_factory=list)

    def open(self, path):
        if not self.plugged:
            raise OSError(self.open_error, os.strerror(self.open_error), path)
        device = FakeDevice(self)
        self.devices.append(device)
        return device

    @property
    def device(self):
        return self.devices[-1]

    @property
    def open_count(self):
        return sum(not device.closed for device in self.devices)

    def unplug(self):
        self.plugged = False
        for device in self.devices:
            device.hang_up()


class FakeDevice:
    def __init__(self, kernel):
        self.kernel = kernel
        self.closed = False
        self.streaming = False
        self.sequence = 0
        self.queued = []
        self.done = []
        self.dequeued = 0
        self.format = None
        self._ready = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._memory = os.memfd_create("frames")
        self._length = 0
        self._gone = False

    def fileno(self):
        return self._ready

    def map(self, length, offset):
        return mmap.mmap(self._memory, length, mmap.MAP_SHARED, offset=offset)

    def close(self):
        assert not self.closed, "closed twice"
        self.closed = True
        os.close(self._ready)
        os.close(self._memory)

    def hang_up(self):
        self._gone = True
        if not self.closed:
            os.eventfd_write(self._ready, 1)

    def shoot(self, data, *, t_ns=None, flags=0):
        """What the camera does: one picture into the next free buffer, or lost with its sequence number."""
        sequence, self.sequence = self.sequence, self.sequence + 1
        if not (self.streaming and self.queued):
            return
        index = self.queued.pop(0)
        os.pwrite(self._memory, data, index * self._length)
        at = sequence * 33_333_333 if t_ns is None else t_ns
        self.kernel.now_ns = at
        self.done.append((index, len(data), flags | self.kernel.stamps, at, sequence))
        os.eventfd_write(self._ready, 1)

    def ioctl(self, request, argument):
        assert not self.closed, "used after close"
        if self._gone:
            raise OSError(errno.ENODEV, os.strerror(errno.ENODEV))
        if request in self.kernel.fails:
            code = self.kernel.fails[request]
            raise OSError(code, os.strerror(code))
        HANDLERS[request](self, argument)

    def _querycap(self, argument):
        argument.driver, argument.card, argument.bus_info = b"fake", b"Fake Camera", b"usb-1"
        argument.capabilities = abi.CAP_DEVICE_CAPS | abi.CAP_VIDEO_CAPTURE | abi.CAP_STREAMING
        argument.device_caps = self.kernel.caps

    def _s_fmt(self, argument):
        pix = argument.fmt.pix
        name = abi.fourcc_text(pix.pixelformat)
        if name not in self.kernel.sizes:
            name = next(iter(self.kernel.sizes))
        pix.pixelformat = abi.fourcc(name)
        if (pix.width, pix.height) not in self.kernel.sizes[name]:
            pix.width, pix.height = self.kernel.sizes[name][0]
        pix.bytesperline = {"YUYV": 2, "UYVY": 2, "GREY": 1}.get(name, 0) * pix.width + self.kernel.padding
        self._length = -(-max(pix.width * pix.height * 3, pix.bytesperline * pix.height) // PAGE) * PAGE
        self.format = (name, pix.width, pix.height)

    def _s_parm(self, argument):
        per_picture = argument.timeperframe
        if per_picture.denominator / per_picture.numerator > self.kernel.fastest_fps:
            per_picture.numerator, per_picture.denominator = 1, self.kernel.fastest_fps

    def _reqbufs(self, argument):
        os.ftruncate(self._memory, argument.count * self._length)

    def _querybuf(self, argument):
        argument.m.offset, argument.length = argument.index * self._length, self._length

    def _qbuf(self, argument):
        assert argument.index not in self.queued, "queued twice"
        self.queued.append(argument.index)

    def _dqbuf(self, argument):
        if not self.done:
            raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
        argument.index, argument.bytesused, argument.flags, t_ns, argument.sequence = self.done.pop(0)
        argument.timestamp.tv_sec, nanoseconds = divmod(t_ns, 10**9)
        argument.timestamp.tv_usec = nanoseconds // 1000
        self.dequeued += 1
        if not self.done:
            os.eventfd_read(self._ready)
            self.kernel.emptied.set()

    def _streamon(self, argument):
        self.streaming = True
        self.kernel.started.release()

    def _streamoff(self, argument):
        self.streaming = False

    def _control(self, argument):
        for control in self.kernel.controls:
            if control.id == argument.id:
                if control.refuses:
                    raise OSError(control.refuses, os.strerror(control.refuses))
                return control
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def _g_ctrl(self, argument):
        argument.value = self._control(argument).value

    def _s_ctrl(self, argument):
        control = self._control(argument)
        control.value = min(max(argument.value, control.low), control.high)

    def _queryctrl(self, argument):
        after = argument.id & ~abi.CTRL_FLAG_NEXT_CTRL
        for control in sorted(self.kernel.controls, key=lambda control: control.id):
            if control.id > after:
                argument.id, argument.name, argument.type = control.id, control.name.encode(), control.type
                argument.minimum, argument.maximum, argument.step = control.low, control.high, 1
                argument.flags = control.flags
                return
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))

    def _enum_fmt(self, argument):
        name = self._nth(list(self.kernel.sizes), argument.index)
        argument.pixelformat, argument.description = abi.fourcc(name), f"{name} pictures".encode()

    def _enum_framesizes(self, argument):
        size = self._nth(self.kernel.sizes[abi.fourcc_text(argument.pixel_format)], argument.index)
        argument.type = abi.FRMSIZE_TYPE_DISCRETE
        argument.size.min_width, argument.size.max_width = size

    def _enum_frameintervals(self, argument):
        fps = self._nth([15, self.kernel.fastest_fps], argument.index)
        argument.interval.numerator, argument.interval.denominator = 1, fps

    @staticmethod
    def _nth(items, index):
        if index >= len(items):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        return items[index]


HANDLERS = {
    abi.QUERYCAP: FakeDevice._querycap,
    abi.S_FMT: FakeDevice._s_fmt,
    abi.S_PARM: FakeDevice._s_parm,
    abi.REQBUFS: FakeDevice._reqbufs,
    abi.QUERYBUF: FakeDevice._querybuf,
    abi.QBUF: FakeDevice._qbuf,
    abi.DQBUF: FakeDevice._dqbuf,
    abi.STREAMON: FakeDevice._streamon,
    abi.STREAMOFF: FakeDevice._streamoff,
    abi.G_CTRL: FakeDevice._g_ctrl,
    abi.S_CTRL: FakeDevice._s_ctrl,
    abi.QUERYCTRL: FakeDevice._queryctrl,
    abi.ENUM_FMT: FakeDevice._enum_fmt,
    abi.ENUM_FRAMESIZES: FakeDevice._enum_framesizes,
    abi.ENUM_FRAMEINTERVALS: FakeDevice._enum_frameintervals,
}


class OffsetClock:
    """The daemon's time is the monotonic one plus a constant."""

    def __init__(self):
        self.ns = MONOTONIC_OFFSET_NS

    def now_ns(self):
        self.ns += 1
        return self.ns

    def from_monotonic_ns(self, monotonic_ns):
        return monotonic_ns + MONOTONIC_OFFSET_NS


@pytest.fixture
def kernel(monkeypatch):
    machine = FakeKernel()
    monkeypatch.setattr(v4l2_stamps, "monotonic_ns", lambda: machine.now_ns)
    yield machine
    assert machine.open_count == 0, "a device was left open"


@pytest.fixture
def make_control():
    return FakeControl


@pytest.fixture
def clock():
    return OffsetClock()


@pytest.fixture
def settings():
    return V4l2Source(device="/dev/v4l/by-id/usb-fake-video-index0", size_px=(64, 48), stall_s=5.0)


@pytest.fixture
def jpeg():
    """Whole pictures that differ by their number."""

    def encode(number):
        pixels = np.full((48, 64, 3), number * 8 % 256, np.uint8)
        return cv2.imencode(".jpg", pixels)[1].tobytes()

    return encode
