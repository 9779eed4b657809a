"""Driver controls by name: found, set, read back, and what was not granted in words."""

from __future__ import annotations

import errno
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ptzd.devices import v4l2_abi as abi
from ptzd.devices.v4l2_kernel import Device

NO_MORE = frozenset({errno.EINVAL, errno.ENOTTY})
"""Answers to "what is the next control" that end the list (a driver without controls does not know the request)."""

NOT_GRANTED = frozenset({errno.EINVAL, errno.ERANGE, errno.EACCES, errno.EBUSY, errno.EIO, errno.EILSEQ, errno.ENOTTY})
"""Answers to a value that is not taken (at the moment); UVC cameras stall the request, which reads as EIO or EILSEQ."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlRange:
    """A control that a driver offers."""

    key: str
    """Name in settings, e.g. ``exposure_time_absolute``."""
    id: int
    low: int
    high: int
    step: int
    default: int


def control_key(name: str) -> str:
    """Name of a control as settings and ``v4l2-ctl`` write it: lower case, ``_`` between words."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


CLASSES = (0x00980000, 0x00990000, 0x009A0000, 0x009B0000, 0x009C0000, 0x009D0000, 0x009E0000, 0x009F0000)
"""Classes of controls (``V4L2_CTRL_CLASS_USER`` and on)."""
ID_OF_CLASS = 0x900
PER_CLASS = 64
"""Numbers looked at behind a control that cannot be asked; the largest class in use has some forty."""


def list_controls(device: Device) -> tuple[ControlRange, ...]:
    """Controls that one integer can set, in the driver's order; one that fails when it is asked for is left out.

    Raises
    ------
    OSError
        When the device is gone.
    """
    found: list[ControlRange] = []
    last = 0
    while (query := _next_control(device, last)) is not None:
        last = query.id
        if query.type in abi.CTRL_TYPES_OF_ONE_INTEGER and not query.flags & (
            abi.CTRL_FLAG_DISABLED | abi.CTRL_FLAG_READ_ONLY
        ):
            found.append(
                ControlRange(
                    key=control_key(query.name.decode("latin-1")),
                    id=query.id,
                    low=query.minimum,
                    high=query.maximum,
                    step=query.step,
                    default=query.default_value,
                )
            )
    return tuple(found)


def _next_control(device: Device, last: int) -> abi.ControlQuery | None:
    """The next control that answers; past one that does not, the numbers behind it are asked one by one."""
    query = abi.ControlQuery(id=last | abi.CTRL_FLAG_NEXT_CTRL)
    try:
        device.ioctl(abi.QUERYCTRL, query)
    except OSError as error:
        if error.errno in NO_MORE:
            return None
        if error.errno not in NOT_GRANTED:
            raise
        answers = (_asked(device, number) for number in _numbers_after(last))
        return next((answer for answer in answers if answer is not None), None)
    return query if query.id > last else None


def _numbers_after(last: int) -> Iterator[int]:
    for base in CLASSES:
        for number in range(base + ID_OF_CLASS, base + ID_OF_CLASS + PER_CLASS):
            if number > last:
                yield number


def _asked(device: Device, number: int) -> abi.ControlQuery | None:
    query = abi.ControlQuery(id=number)
    try:
        device.ioctl(abi.QUERYCTRL, query)
    except OSError as error:
        if error.errno in NOT_GRANTED:
            return None
        raise
    return query


def apply_controls(device: Device, wanted: Mapping[str, int]) -> tuple[str, ...]:
    """Set controls and read them back.

    What switches something automatic goes first, since the value it governs is not taken before (an exposure time
    after manual exposure), and what was not taken is set once more when the others are.

    Returns
    -------
    tuple of str
        One phrase per control that does not have the value asked for; empty when all have.
    """
    if not wanted:
        return ()
    known = {control.key: control for control in list_controls(device)}
    ordered = sorted(wanted.items(), key=lambda item: "auto" not in item[0])
    refused = [(key, value) for key, value in ordered if _apply(device, known, key, value)]
    refusals = (_apply(device, known, key, value) for key, value in refused)
    return tuple(refusal for refusal in refusals if refusal)


def _apply(device: Device, known: Mapping[str, ControlRange], key: str, value: int) -> str | None:
    control = known.get(key)
    if control is None:
        return f"{key}: no such control (has {', '.join(known) or 'none'})"
    asked = f"{key}: asked for {value}, allowed are {control.low} to {control.high}"
    try:
        device.ioctl(abi.S_CTRL, abi.Control(id=control.id, value=value))
        readback = abi.Control(id=control.id)
        device.ioctl(abi.G_CTRL, readback)
    except OSError as error:
        if error.errno in NOT_GRANTED:
            return f"{asked}: {error.strerror}"
        raise
    return None if readback.value == value else f"{asked}, is {readback.value}"
