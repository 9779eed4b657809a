"""Sizes that pictures of other formats claim, read before anything is decoded."""

from __future__ import annotations

import re

from ptzd.errors import DeviceGarbled

Size = tuple[int, int]

_PNG = b"\x89PNG\r\n\x1a\n"
_PNM = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,20})(?:\s|#[^\n]*\n)+(\d{1,20})")
_TIFF_ORDERS = {b"II*\0": "little", b"MM\0*": "big"}
_TIFF_SIZE = {0x0100: 0, 0x0101: 1}
"""Tags of width and height (TIFF 6.0)."""
_TIFF_SHORT = 3


def claimed_size(data: bytes) -> Size:
    """Width and height in the header of a PNG, BMP, TIFF or PNM file.

    Raises
    ------
    DeviceGarbled
        When it is none of these, or its header is cut off.
    """
    size = None
    if data[:8] == _PNG and len(data) >= 24:
        size = int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    elif data[:2] == b"BM" and len(data) >= 26:
        size = _bmp(data)
    elif data[:4] in _TIFF_ORDERS:
        size = _tiff(data)
    elif (pnm := _PNM.match(data)) is not None:
        size = int(pnm[1]), int(pnm[2])
    if size is None:
        raise DeviceGarbled(
            f"not a picture: {len(data)} bytes that begin with {data[:8].hex(' ')} have no header of "
            "JPEG, PNG, BMP, TIFF or PGM"
        )
    return size


def _bmp(data: bytes) -> Size:
    if int.from_bytes(data[14:18], "little") == 12:  # OS/2's header
        return int.from_bytes(data[18:20], "little"), int.from_bytes(data[20:22], "little")
    # a negative height means that rows go from top to bottom
    return int.from_bytes(data[18:22], "little", signed=True), abs(int.from_bytes(data[22:26], "little", signed=True))


def _tiff(data: bytes) -> Size | None:
    little = _TIFF_ORDERS[data[:4]] == "little"

    def number(at: int, size: int) -> int:
        return int.from_bytes(data[at : at + size], "little" if little else "big")

    directory = number(4, 4)
    size = [0, 0]
    for at in range(directory + 2, min(directory + 2 + 12 * number(directory, 2), len(data) - 11), 12):
        if (place := _TIFF_SIZE.get(number(at, 2))) is not None:
            size[place] = number(at + 8, 2 if number(at + 2, 2) == _TIFF_SHORT else 4)
    return (size[0], size[1]) if all(size) else None
