"""JPEG pictures out of a ``multipart/x-mixed-replace`` stream, whatever the chunks and the faults.

Sans-IO: bytes go in, parts come out. A part is cut by its ``Content-Length`` as soon as the last byte is there, else at
the next boundary. Damage costs the damaged part only: the parser looks for the next boundary and goes on.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from ptzd.devices.jpeg import complete_length
from ptzd.errors import DeviceGarbled

MAX_PART_BYTES = 20_000_000
"""A part beyond this is no picture; the largest AXIS JPEG (4K at compression 0) stays under 10 MB."""
MAX_HEADER_BYTES = 16_384

_BLANK_LINE = re.compile(rb"\r?\n\r?\n")
_BARE_MARKERS = frozenset({0x01, *range(0xD0, 0xD8)})
_FRAME_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One part of the stream: header names in lower case, the body untouched."""

    headers: dict[str, str]
    body: bytes

    @property
    def complete(self) -> bool:
        """Whether the body is a JPEG from its first marker (SOI) to its last (EOI)."""
        return complete_length(self.body, len(self.body)) is not None


def jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Width and height in px from the frame header (ITU T.81, B.2.2); None when there is none."""
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:
            return None
        marker = data[at + 1]
        if marker == 0xFF:
            at += 1
        elif marker in _BARE_MARKERS:
            at += 2
        elif marker in _FRAME_MARKERS:
            return int.from_bytes(data[at + 7 : at + 9]), int.from_bytes(data[at + 5 : at + 7])
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4])
    return None


def boundary_of(content_type: str) -> str:
    """The boundary parameter of a multipart content type.

    Raises
    ------
    DeviceGarbled
        When the content type is not multipart or names no boundary.
    """
    found = re.search(r'boundary=(?:"([^"]+)"|([^\s;"]+))', content_type, re.IGNORECASE)
    if not content_type.strip().lower().startswith("multipart/") or found is None:
        raise DeviceGarbled(f"expected multipart/x-mixed-replace with a boundary, got content type {content_type!r}")
    return found.group(1) or found.group(2)


class MultipartParser:
    """Incremental parser of an MJPEG stream.

    Parameters
    ----------
    boundary : str
        As announced; leading dashes are dropped, for cameras that announce ``--name`` and send ``--name``.
    """

    def __init__(self, boundary: str) -> None:
        name = boundary.strip().lstrip("-")
        if not name:
            raise DeviceGarbled(f"multipart boundary {boundary!r} has no name")
        self._delimiter = b"--" + name.encode("latin-1", "replace")
        self._line = re.compile(re.escape(self._delimiter) + rb"(?:--)?[ \t]*\r?\n")
        self._buffer = bytearray()
        self._headers: dict[str, str] | None = None
        self._length: int | None = None
        self._scanned = 0

    def feed(self, data: bytes) -> list[Part]:
        """Take the next bytes of the stream, return the parts they complete, damaged ones included.

        Raises
        ------
        DeviceGarbled
            When a part grows beyond :data:`MAX_PART_BYTES`; the stream is of no use then.
        """
        self._buffer += data
        parts: list[Part] = []
        while self._advance(parts):
            pass
        return parts

    def _advance(self, parts: list[Part]) -> bool:
        if self._headers is None:
            return self._seek_part()
        if self._length is not None:
            return self._take_counted(parts, self._headers, self._length)
        return self._take_delimited(parts, self._headers)

    def _seek_part(self) -> bool:
        """Drop everything up to a boundary line, then read the headers behind it."""
        line = self._line.search(self._buffer)
        if line is None:
            self._drop_noise()
            return False
        blank = _BLANK_LINE.search(self._buffer, line.end() - 1)
        if blank is None:
            if len(self._buffer) - line.end() > MAX_HEADER_BYTES:
                del self._buffer[: line.end()]
                return True
            return False
        head = bytes(self._buffer[line.end() : blank.start()])
        again = self._line.search(head)
        if again is not None:
            del self._buffer[: line.end() + again.start()]
            return True
        del self._buffer[: blank.end()]
        self._headers = _headers(head)
        self._length = _content_length(self._headers)
        self._scanned = 0
        return True

    def _drop_noise(self) -> None:
        """Keep only what may be the beginning of a boundary line."""
        start = self._buffer.rfind(self._delimiter)
        if start >= 0 and len(self._buffer) - start <= len(self._delimiter) + 64:
            del self._buffer[:start]
        else:
            del self._buffer[: max(0, len(self._buffer) - len(self._delimiter))]

    def _take_counted(self, parts: list[Part], headers: dict[str, str], length: int) -> bool:
        if len(self._buffer) < length:
            return False
        body = bytes(self._buffer[:length])
        if complete_length(body, length) is None:
            # A picture cut short by the camera has swallowed the parts behind it: give them back.
            cut = self._line.search(self._buffer)
            if cut is not None and cut.start() < length:
                body = _without_line_end(bytes(self._buffer[: cut.start()]))
                length = cut.start()
        self._emit(parts, headers, body, length)
        return True

    def _take_delimited(self, parts: list[Part], headers: dict[str, str]) -> bool:
        line = self._line.search(self._buffer, self._scanned)
        if line is None:
            if len(self._buffer) > MAX_PART_BYTES:
                raise DeviceGarbled(f"a part grew beyond {MAX_PART_BYTES} bytes without an end; not an MJPEG stream")
            self._scanned = max(0, len(self._buffer) - len(self._delimiter) - 64)
            return False
        body = _without_line_end(bytes(self._buffer[: line.start()]))
        self._emit(parts, headers, body, line.start())
        return True

    def _emit(self, parts: list[Part], headers: dict[str, str], body: bytes, consumed: int) -> None:
        del self._buffer[:consumed]
        self._headers = None
        parts.append(Part(headers=headers, body=body))


def _headers(head: bytes) -> dict[str, str]:
    lines = head.decode("latin-1").splitlines()
    pairs = (line.partition(":") for line in lines if ":" in line)
    return {name.strip().lower(): value.strip() for name, _, value in pairs}


def _content_length(headers: dict[str, str]) -> int | None:
    text = headers.get("content-length", "")
    if not (text.isascii() and text.isdigit()):
        return None
    if len(text) > 12 or int(text) > MAX_PART_BYTES:
        raise DeviceGarbled(f"a part announces {text[:20]} bytes, more than {MAX_PART_BYTES}; not an MJPEG stream")
    return int(text)


def _without_line_end(body: bytes) -> bytes:
    if body.endswith(b"\r\n"):
        return body[:-2]
    return body[:-1] if body.endswith(b"\n") else body
