"""JPEG pictures out of a ``multipart/x-mixed-replace`` stream, whatever the chunks, the framing and the faults.

Sans-IO: bytes go in, parts come out. A JPEG tells by itself where it ends, so the pictures are walked, and what cameras
put around them (blank lines, lengths a few bytes off, boundaries other than announced) does not matter. The boundary
tells only where a broken picture ends.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from ptzd.errors import DeviceGarbled
from ptzd.jpeg.walk import START, Walk, Walked

MAX_PART_BYTES = 20_000_000
"""A picture beyond this is none; the largest AXIS JPEG (4K at compression 0) stays under 10 MB."""
SHOWN_BYTES = 48
"""Of what was met in place of a picture, for the message."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One picture of the stream."""

    body: bytes
    complete: bool
    """Whether it is a JPEG from its first marker (SOI) to its last (EOI)."""


def boundary_of(content_type: str) -> str:
    """The boundary of a multipart content type, without quotes; "" when none is named.

    It ends at a semicolon or at the end, since some cameras announce one with spaces and without quotes.

    Raises
    ------
    DeviceGarbled
        When the content type is not multipart.
    """
    if not content_type.strip().lower().startswith("multipart/"):
        raise DeviceGarbled(
            f"expected an MJPEG stream (multipart/x-mixed-replace), got content type {content_type!r}; "
            "check that the address is that of the stream, not of a page or a single picture"
        )
    found = re.search(r'boundary\s*=\s*(?:"([^"]*)"?|([^;]*))', content_type, re.IGNORECASE)
    return "" if found is None else (found.group(1) or found.group(2) or "").strip()


class MultipartParser:
    """Incremental parser of an MJPEG stream.

    Parameters
    ----------
    boundary : str
        As announced, leading dashes or not; one without a name is not looked for.
    """

    def __init__(self, boundary: str) -> None:
        name = boundary.strip().strip("-").encode("latin-1", "replace")
        # two dashes and no more in front: looking for a run of any length takes its square in steps
        self._delimiter = re.compile(rb"--" + re.escape(name) + rb"-*[ \t]*\r?\n") if name else None
        self._buffer = bytearray()
        self._walk: Walk | None = None
        self._between = bytearray()
        self._bytes = 0
        self._damaged = 0
        self._whole = 0

    def feed(self, data: bytes) -> Iterator[Part]:
        """Take the next bytes; the pictures they complete, damaged ones included, are cut out one by one."""
        self._buffer += data
        self._bytes += len(data)
        return self._cut_out()

    def _cut_out(self) -> Iterator[Part]:
        parts: list[Part] = []
        while self._advance(parts):
            yield from parts
            parts.clear()

    def seen(self) -> str:
        """What came so far, for a message about a stream that shows nothing."""
        if not self._bytes:
            return "nothing came"
        counts = f"{self._bytes:,} bytes came, {self._whole} whole and {self._damaged} broken JPEG pictures in them"
        return counts if self._whole else f"{counts}; it begins with {bytes(self._between[:SHOWN_BYTES])!r}"

    def _advance(self, parts: list[Part]) -> bool:
        if self._walk is None:
            return self._seek_picture()
        walked = self._walk.go(self._buffer, len(self._buffer))
        if walked is Walked.WHOLE:
            # a boundary inside: a segment that was cut short took the pictures behind it for its own
            length = self._broken_length(self._walk.at)
            self._emit(parts, length, complete=length == self._walk.at)
        elif walked is Walked.BROKEN or len(self._buffer) > MAX_PART_BYTES:
            self._emit(parts, self._broken_length(self._walk.at), complete=False)
        else:
            return False
        return True

    def _broken_length(self, at: int) -> int:
        """Up to the next boundary: a segment that was cut short counts bytes of the next picture as its own."""
        cut = None if self._delimiter is None else self._delimiter.search(self._buffer, len(START), at)
        return at if cut is None else cut.start()

    def _seek_picture(self) -> bool:
        start = self._buffer.find(START)
        skipped = start if start >= 0 else max(len(self._buffer) - 1, 0)
        self._between += self._buffer[: min(skipped, SHOWN_BYTES - len(self._between))] if not self._whole else b""
        del self._buffer[:skipped]
        if start >= 0:
            self._walk = Walk()
        return start >= 0

    def _emit(self, parts: list[Part], length: int, *, complete: bool) -> None:
        body = bytes(self._buffer[:length])
        del self._buffer[:length]
        self._walk = None
        self._whole += complete
        self._damaged += not complete
        parts.append(Part(body=body, complete=complete))
