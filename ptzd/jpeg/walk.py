"""The marker segments of a JPEG (ITU-T T.81, annex B), walked as the bytes come in."""

from __future__ import annotations

import mmap
import re
from dataclasses import dataclass
from enum import Enum

from ptzd.errors import DeviceGarbled

START = b"\xff\xd8"
END = b"\xff\xd9"

_BARE = frozenset({0x01, *range(0xD0, 0xD8)})
"""Markers without a segment: TEM and the restarts."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Start of frame: SOF0…SOF15 (table B.1)."""
_SCAN = 0xDA
_EXIF = 0xE1
UPRIGHT = 1
"""EXIF orientation of a picture that is shown as stored."""
_MARKER_IN_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
"""The first marker behind entropy-coded data: there a byte FF is followed by 00, and restarts belong to it."""
_ORIENTATION = 0x0112
"""EXIF tag (EXIF 2.3, 4.6.4)."""

Buffer = bytes | bytearray | mmap.mmap


class Walked(Enum):
    """How far a walk came."""

    MORE = "more"
    """Everything so far is in order; more bytes are needed."""
    WHOLE = "whole"
    """The end marker was reached."""
    BROKEN = "broken"
    """What follows cannot belong to this picture."""


class Walk:
    """One picture at the start of a growing buffer.

    Attributes
    ----------
    at : int
        Bytes understood so far: the picture's length when whole; where it breaks off when broken.
    size_px : (int, int) or None
        Width and height, once the frame header was met.
    orientation : int
        Of the EXIF part, 1 to 8; 1 when there is none.
    """

    def __init__(self) -> None:
        self.at = len(START)
        self.size_px: tuple[int, int] | None = None
        self.orientation = UPRIGHT
        self._in_scan = False
        self._scanned = False

    def go(self, data: Buffer, used: int) -> Walked:
        """Walk on in a buffer whose first ``used`` bytes have come; called again with more of the same bytes."""
        while True:
            walked = self._scan(data, used) if self._in_scan else self._segment(data, used)
            if walked is not None:
                return walked

    def _scan(self, data: Buffer, used: int) -> Walked | None:
        found = _MARKER_IN_SCAN.search(data, self.at, used)
        if found is None:
            self.at = max(self.at, used - 1)
            return Walked.MORE
        self.at, self._in_scan = found.start(), False
        return None

    def _segment(self, data: Buffer, used: int) -> Walked | None:
        if used - self.at < 2:
            return Walked.MORE
        if data[self.at] != 0xFF:
            return Walked.BROKEN
        marker = data[self.at + 1]
        if marker == 0xFF or marker in _BARE:
            self.at += 1 if marker == 0xFF else 2
            return None
        if marker == END[1] and self.size_px is not None and self._scanned:
            self.at += 2
            return Walked.WHOLE
        if marker < 0xC0 or marker in {START[1], END[1]}:
            return Walked.BROKEN
        return self._with_length(marker, data, used)

    def _with_length(self, marker: int, data: Buffer, used: int) -> Walked | None:
        if used - self.at < 4:
            return Walked.MORE
        end = self.at + 2 + int.from_bytes(data[self.at + 2 : self.at + 4])
        if end < self.at + 4:
            return Walked.BROKEN
        if end > used:
            return Walked.MORE
        body = bytes(data[self.at + 4 : end])
        if marker in _FRAMES:
            if len(body) < 6:
                return Walked.BROKEN
            self.size_px = (int.from_bytes(body[3:5]), int.from_bytes(body[1:3]))
        elif marker == _EXIF and body.startswith(b"Exif\0\0"):
            self.orientation = _orientation(body[6:])
        self._in_scan = marker == _SCAN
        self._scanned |= self._in_scan
        self.at = end
        return None


def _orientation(tiff: bytes) -> int:
    """Orientation in the first directory of a TIFF header; 1 when it says none or nonsense."""
    order = {b"II*\0": "little", b"MM\0*": "big"}.get(tiff[:4])
    if order is None:
        return 1

    def number(at: int, size: int) -> int:
        return int.from_bytes(tiff[at : at + size], "little" if order == "little" else "big")

    directory = number(4, 4)
    for entry in range(directory + 2, min(directory + 2 + 12 * number(directory, 2), len(tiff) - 11), 12):
        if number(entry, 2) == _ORIENTATION:
            value = number(entry + 8, 2)
            return value if 1 <= value <= 8 else 1
    return 1


@dataclass(frozen=True, slots=True, kw_only=True)
class Header:
    """What a picture says of itself before it is decoded."""

    size_px: tuple[int, int]
    """Width and height of the stored pixels."""
    orientation: int
    """How EXIF would have it turned, 1 (not at all) to 8; nothing here turns it."""


def read_header(jpeg: bytes) -> Header:
    """Read size and orientation without decoding.

    Raises
    ------
    DeviceGarbled
        When there is no frame header, with the first bytes.
    """
    walk = Walk()
    if jpeg[:2] == START:
        walk.go(jpeg, len(jpeg))
    if walk.size_px is None:
        raise DeviceGarbled(
            f"a picture of {len(jpeg)} bytes has no JPEG frame header, it begins with {jpeg[:8].hex(' ')}; "
            "is the stream really JPEG?"
        )
    return Header(size_px=walk.size_px, orientation=walk.orientation)


def turned(camera: str, orientation: int) -> str:
    """What to tell the person who mounts a camera that asks viewers to turn its picture."""
    return (
        f"{camera}: its pictures carry EXIF orientation {orientation}, which viewers apply and ptzd does not: boxes "
        "and calibration are in pixels as stored; switch the camera's rotation off, or draw boxes in stored pixels"
    )


def whole_length(data: Buffer, used: int) -> int | None:
    """Length of the picture at the start of a buffer, from its start marker up to and with its own end marker.

    Drivers and small cameras leave older bytes behind the picture, and deliver truncated ones without an error flag.

    Parameters
    ----------
    data : bytes, bytearray or mmap
        A buffer with the picture at its start; looked at in place.
    used : int
        How many bytes of it have been written.

    Returns
    -------
    int or None
        Bytes of the whole picture; None when it does not start as one or is cut off.
    """
    walk = Walk()
    if used < 4 or data[:2] != START or walk.go(data, used) is not Walked.WHOLE:
        return None
    return walk.at
