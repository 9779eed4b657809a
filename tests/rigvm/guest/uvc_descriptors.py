"""What a USB video camera tells of itself: one MJPG size, one bulk endpoint, three controls (UVC 1.0, USB 2.0)."""

from __future__ import annotations

import struct
from dataclasses import dataclass

VENDOR, PRODUCT = 0x1D6B, 0x0102
STRINGS = ("ptzd", "Fisheye UVC Sim", "SIM0001")
BULK_IN = 0x81
PAYLOAD_BYTES = 16384

CAMERA, PROCESSING, OUTPUT = 1, 2, 3
"""Entities of the control interface."""

STANDARD_DEVICE, STANDARD_CONFIGURATION, STANDARD_STRING = 1, 2, 3
STANDARD_INTERFACE, STANDARD_ENDPOINT, STANDARD_ASSOCIATION = 4, 5, 11
CLASS_INTERFACE = 0x24
VIDEO_CLASS = 0x0E


@dataclass(frozen=True, kw_only=True)
class Mode:
    """The one size and rate of the camera."""

    width: int
    height: int
    fps: int

    @property
    def interval_100ns(self) -> int:
        return 10_000_000 // self.fps

    @property
    def longest_frame(self) -> int:
        return self.width * self.height * 2

    def probe(self) -> bytes:
        """The answer to every negotiation: this mode or nothing."""
        return struct.pack(
            "<HBBIHHHHHII", 1, 1, 1, self.interval_100ns, 0, 0, 0, 0, 0, self.longest_frame, PAYLOAD_BYTES
        )


def _descriptor(kind: int, form: str, *values: int | bytes) -> bytes:
    body = struct.pack("<" + form, *values)
    return bytes([len(body) + 2, kind]) + body


def device_descriptor() -> bytes:
    return _descriptor(STANDARD_DEVICE, "HBBBBHHHBBBB", 0x0200, 0xEF, 2, 1, 64, VENDOR, PRODUCT, 0x0010, 1, 2, 3, 1)


def string_descriptor(index: int) -> bytes:
    text = struct.pack("<H", 0x0409) if index == 0 else STRINGS[index - 1].encode("utf-16le")
    return bytes([len(text) + 2, STANDARD_STRING]) + text


def _control_interface() -> bytes:
    auto_exposure_and_time, brightness, gain = 0b1010, 1 << 0, 1 << 9
    camera = _descriptor(
        CLASS_INTERFACE, "BBHBBHHHB3s", 2, CAMERA, 0x0201, 0, 0, 0, 0, 0, 3, bytes([auto_exposure_and_time, 0, 0])
    )
    processing = _descriptor(CLASS_INTERFACE, "BBBHBHB", 5, PROCESSING, CAMERA, 0, 2, brightness | gain, 0)
    output = _descriptor(CLASS_INTERFACE, "BBHBBB", 3, OUTPUT, 0x0101, 0, PROCESSING, 0)
    units = camera + processing + output
    header = _descriptor(CLASS_INTERFACE, "BHHIBB", 1, 0x0100, 13 + len(units), 48_000_000, 1, 1)
    return _descriptor(STANDARD_INTERFACE, "BBBBBBB", 0, 0, 0, VIDEO_CLASS, 1, 0, 2) + header + units


def _streaming_interface(mode: Mode) -> bytes:
    bits_per_s = mode.width * mode.height * 16 * mode.fps
    mjpeg = _descriptor(CLASS_INTERFACE, "BBBBBBBBB", 6, 1, 1, 1, 1, 0, 0, 0, 0)
    size = _descriptor(
        CLASS_INTERFACE,
        "BBBHHIIIIBI",
        *(7, 1, 0, mode.width, mode.height, bits_per_s, bits_per_s),
        *(mode.longest_frame, mode.interval_100ns, 1, mode.interval_100ns),
    )
    colour = _descriptor(CLASS_INTERFACE, "BBBB", 0x0D, 1, 1, 4)
    formats = mjpeg + size + colour
    header = _descriptor(CLASS_INTERFACE, "BBHBBBBBBBB", 1, 1, 14 + len(formats), BULK_IN, 0, OUTPUT, 0, 0, 0, 1, 0)
    interface = _descriptor(STANDARD_INTERFACE, "BBBBBBB", 1, 0, 1, VIDEO_CLASS, 2, 0, 0)
    return interface + header + formats + _descriptor(STANDARD_ENDPOINT, "BBHB", BULK_IN, 2, 512, 0)


def configuration_descriptor(mode: Mode) -> bytes:
    association = _descriptor(STANDARD_ASSOCIATION, "BBBBBB", 0, 2, VIDEO_CLASS, 3, 0, 2)
    body = association + _control_interface() + _streaming_interface(mode)
    return _descriptor(STANDARD_CONFIGURATION, "HBBBBB", 9 + len(body), 2, 1, 0, 0x80, 250) + body
