"""Driver controls by name: found, set, read back, and what was not granted in words."""

from __future__ import annotations

import errno
import re
from collections.abc import Mapping
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


def list_controls(device: Device) -> tuple[ControlRange, ...]:
    """Controls that one integer can set, in the driver's order."""
    found: list[ControlRange] = []
    query = abi.ControlQuery(id=abi.CTRL_FLAG_NEXT_CTRL)
    while _asked(device, query):
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
        query = abi.ControlQuery(id=query.id | abi.CTRL_FLAG_NEXT_CTRL)
    return tuple(found)


def apply_controls(device: Device, wanted: Mapping[str, int]) -> tuple[str, ...]:
    """Set controls and read them back.

    In the order given: some are only accepted after another, e.g. an exposure time after manual exposure.

    Returns
    -------
    tuple of str
        One phrase per control that does not have the value asked for; empty when all have.
    """
    if not wanted:
        return ()
    known = {control.key: control for control in list_controls(device)}
    refusals = (_apply(device, known, key, value) for key, value in wanted.items())
    return tuple(refusal for refusal in refusals if refusal)


def _asked(device: Device, query: abi.ControlQuery) -> bool:
    try:
        device.ioctl(abi.QUERYCTRL, query)
    except OSError as error:
        if error.errno in NO_MORE:
            return False
        raise
    return True


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
