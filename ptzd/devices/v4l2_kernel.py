"""A video device node: the four calls a reader makes, and what the kernel's refusals mean."""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
from ctypes import Structure
from typing import Protocol, Self

from ptzd.errors import DeviceError, DeviceLost, DeviceRefused

GONE = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO, errno.EIO, errno.ESHUTDOWN, errno.EPIPE, errno.EPROTO})
"""Answers of a device that is not there (any more), or whose cable or bus fails."""

CURES = {
    errno.EACCES: "let the user read it: add them to the group video",
    errno.EPERM: "let the service use it: DeviceAllow=char-video4linux rw",
    errno.EBUSY: "another program streams from it; stop that one",
    errno.ENOTTY: "this is not a video capture device; see `ptzd check` for those that are",
}


class Device(Protocol):
    """What a reader asks of the kernel; every call may raise OSError."""

    def fileno(self) -> int:
        """Descriptor that becomes readable when a buffer is full or the device is gone."""
        ...

    def ioctl(self, request: int, argument: Structure) -> None:
        """Do one request; the argument is changed in place."""
        ...

    def map(self, length: int, offset: int) -> mmap.mmap:
        """Map a buffer of the driver."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


class KernelDevice:
    """An open device node.

    Parameters
    ----------
    descriptor : int
        From ``os.open``, non-blocking; owned from now on.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    @classmethod
    def open(cls, path: str) -> Self:
        """Open a device node without ever waiting for it."""
        return cls(os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC))

    def fileno(self) -> int:
        """Descriptor for the event loop."""
        return self._descriptor

    def ioctl(self, request: int, argument: Structure) -> None:
        """Do one request, again when a signal interrupts it."""
        while True:
            try:
                fcntl.ioctl(self._descriptor, request, argument)
            except InterruptedError:
                continue
            return

    def map(self, length: int, offset: int) -> mmap.mmap:
        """Map a buffer of the driver."""
        return mmap.mmap(self._descriptor, length, mmap.MAP_SHARED, mmap.PROT_READ | mmap.PROT_WRITE, offset=offset)

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self._descriptor)


def device_error(error: OSError, device: str, doing: str) -> DeviceError:
    """Say a refusal of the kernel in the project's terms.

    Parameters
    ----------
    error : OSError
        What the kernel answered.
    device : str
        The name from the settings.
    doing : str
        What was tried, e.g. ``set the format``.

    Returns
    -------
    DeviceError
        ``DeviceLost`` when waiting or plugging in can help, else ``DeviceRefused``.
    """
    what = f"{device}: cannot {doing}: {error.strerror or error}"
    if error.errno in GONE:
        return DeviceLost(f"{what}; plug it in, or check the name with `ptzd check`")
    return DeviceRefused("; ".join(filter(None, (what, CURES.get(error.errno or 0)))))
