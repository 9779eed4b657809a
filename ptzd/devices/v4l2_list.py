"""Which capture devices there are, under which stable names, and what they can do."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from contextlib import closing
from ctypes import Structure
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from ptzd.devices import v4l2_abi as abi
from ptzd.devices.v4l2_capture import captures
from ptzd.devices.v4l2_controls import ControlRange, list_controls
from ptzd.devices.v4l2_kernel import Device, KernelDevice, device_error
from ptzd.errors import DeviceError

STABLE_NAMES = ("ptzd/*", "v4l/by-id/*", "v4l/by-path/*")
"""Below ``/dev``, best first: the shipped udev rule, the camera's serial number, the socket it is plugged into."""

LONGEST_LIST = 256
"""Of formats, sizes and rates: a driver that answers for ever is cut off."""

_Item = TypeVar("_Item", bound=Structure)


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeOffer:
    """A size of a format, or a range of sizes."""

    smallest_px: tuple[int, int]
    largest_px: tuple[int, int]
    """Same as the smallest for a single size."""
    fps: tuple[float, ...]
    """Rates that the driver lists for the largest size, fastest first; empty when it lists none."""

    def __str__(self) -> str:
        low, high = ("x".join(map(str, size)) for size in (self.smallest_px, self.largest_px))
        rates = f" @ {', '.join(f'{rate:g}' for rate in self.fps)} fps" if self.fps else ""
        return (low if low == high else f"{low} to {high}") + rates


@dataclass(frozen=True, slots=True, kw_only=True)
class FormatOffer:
    """A pixel format with its sizes."""

    fourcc: str
    description: str
    sizes: tuple[SizeOffer, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceOffer:
    """A capture device."""

    path: str
    """The node, e.g. ``/dev/video0``; its number changes at every replug."""
    stable_names: tuple[str, ...]
    """For settings, best first."""
    card: str
    driver: str
    bus: str
    formats: tuple[FormatOffer, ...]
    controls: tuple[ControlRange, ...]

    def lines(self) -> list[str]:
        """What a person needs to write settings: the name to use, sizes with rates, controls with ranges."""
        name = self.stable_names[0] if self.stable_names else f"{self.path} (no stable name)"
        return [
            f"{name}: {self.card} ({self.path}, {self.driver}, {self.bus})",
            *(f"  {offer.fourcc}: {'; '.join(map(str, offer.sizes)) or 'sizes not told'}" for offer in self.formats),
            *(
                f"  {control.key}: {control.low} to {control.high}, default {control.default}"
                for control in self.controls
            ),
        ]


def list_devices(
    root: Path = Path("/dev"), open_device: Callable[[str], Device] = KernelDevice.open
) -> tuple[tuple[DeviceOffer, ...], tuple[DeviceError, ...]]:
    """Capture devices of this machine; blocks for as long as the devices take to answer.

    Parameters
    ----------
    root : Path
        Where device nodes and their stable names are.
    open_device : callable
        Opens a device node by its path.

    Returns
    -------
    offers : tuple of DeviceOffer
        By number of the node. Nodes that do not capture (metadata, outputs, radios) are left out.
    failures : tuple of DeviceError
        Nodes that could not be asked, e.g. for want of permission.
    """
    offers: list[DeviceOffer] = []
    failures: list[DeviceError] = []
    for path in sorted(root.glob("video[0-9]*"), key=lambda path: int(path.name.removeprefix("video"))):
        try:
            with closing(open_device(str(path))) as device:
                offer = _describe(device, path, root)
        except OSError as error:
            failures.append(device_error(error, str(path), "ask what it offers"))
            continue
        if offer is not None:
            offers.append(offer)
    return tuple(offers), tuple(failures)


def _describe(device: Device, path: Path, root: Path) -> DeviceOffer | None:
    capability = abi.Capability()
    device.ioctl(abi.QUERYCAP, capability)
    if not captures(capability):
        return None
    card, driver, bus = (
        text.decode("utf-8", "replace") for text in (capability.card, capability.driver, capability.bus_info)
    )
    return DeviceOffer(
        path=str(path),
        stable_names=_stable_names(path, root),
        card=card,
        driver=driver,
        bus=bus,
        formats=tuple(_formats(device)),
        controls=list_controls(device),
    )


def _stable_names(path: Path, root: Path) -> tuple[str, ...]:
    node = path.resolve()
    links = (link for pattern in STABLE_NAMES for link in sorted(root.glob(pattern)))
    return tuple(str(link) for link in links if link.resolve() == node)


def _formats(device: Device) -> Iterator[FormatOffer]:
    for found in _enumerate(
        device, abi.ENUM_FMT, lambda index: abi.FormatDescription(index=index, type=abi.BUF_TYPE_VIDEO_CAPTURE)
    ):
        yield FormatOffer(
            fourcc=abi.fourcc_text(found.pixelformat),
            description=found.description.decode("latin-1"),
            sizes=tuple(_sizes(device, found.pixelformat)),
        )


def _sizes(device: Device, pixelformat: int) -> Iterator[SizeOffer]:
    for found in _enumerate(
        device, abi.ENUM_FRAMESIZES, lambda index: abi.FrameSizeEnum(index=index, pixel_format=pixelformat)
    ):
        if found.type == abi.FRMSIZE_TYPE_DISCRETE:
            smallest = largest = (found.size.min_width, found.size.max_width)
        else:
            smallest = (found.size.min_width, found.size.min_height)
            largest = (found.size.max_width, found.size.max_height)
        yield SizeOffer(smallest_px=smallest, largest_px=largest, fps=_rates(device, pixelformat, largest))


def _rates(device: Device, pixelformat: int, size_px: tuple[int, int]) -> tuple[float, ...]:
    width, height = size_px
    found = _enumerate(
        device,
        abi.ENUM_FRAMEINTERVALS,
        lambda index: abi.FrameIntervalEnum(index=index, pixel_format=pixelformat, width=width, height=height),
    )
    rates = (item.interval.denominator / item.interval.numerator for item in found if item.interval.numerator)
    return tuple(sorted(rates, reverse=True))


def _enumerate(device: Device, request: int, make: Callable[[int], _Item]) -> Iterator[_Item]:
    for index in range(LONGEST_LIST):
        item = make(index)
        try:
            device.ioctl(request, item)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY):
                return
            raise
        yield item
