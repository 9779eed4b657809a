"""Pixels out of a JPEG, and back. A picture that the decoder had to mend is refused: what it fills in is no scene."""

from __future__ import annotations

import re

import cv2
import numpy as np
import simplejpeg
from numpy.typing import NDArray

from ptzd.errors import DeviceGarbled
from ptzd.jpeg.others import claimed_size
from ptzd.jpeg.walk import START, read_header, whole_length

Pixels = NDArray[np.uint8]

MAX_PIXELS = 64_000_000
"""Largest picture that is decoded, twice what the largest fisheye sends (8192×4096): a header can claim 65535×65535."""
ENCODED_QUALITY = 95
"""Of pictures that arrive as raw pixels (0 to 100): above it files grow, matches do not get better."""

_SURPLUS = re.compile(r"(\d+) extraneous bytes before marker 0xd9")


def decode_grey(jpeg: bytes) -> Pixels:
    """Decode a JPEG to its stored grey values, shape (h, w).

    Raises
    ------
    DeviceGarbled
        When the bytes are not one whole, undamaged JPEG of at most `MAX_PIXELS`.
    """
    return _decode(jpeg, "GRAY")[..., 0]


def decode_bgr(jpeg: bytes) -> Pixels:
    """Decode a JPEG to its stored colours, shape (h, w, 3), blue first; raises as `decode_grey`."""
    return _decode(jpeg, "BGR")


def decode_file(data: bytes) -> Pixels:
    """Decode a picture of any usual format to its stored grey values, shape (h, w); JPEG as by `decode_grey`.

    Raises
    ------
    DeviceGarbled
        When it is damaged, larger than `MAX_PIXELS`, or no picture.
    """
    if data[:2] == START:
        return decode_grey(data)
    return _decode_other(data, cv2.IMREAD_GRAYSCALE)


def decode_file_bgr(data: bytes) -> Pixels:
    """Decode a picture of any usual format to its stored colours, shape (h, w, 3) BGR; raises as `decode_file`."""
    if data[:2] == START:
        return decode_bgr(data)
    return _decode_other(data, cv2.IMREAD_COLOR)


def _decode_other(data: bytes, flags: int) -> Pixels:
    _refuse_huge(*claimed_size(data))
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:  # sizes that OpenCV refuses by itself
        pixels = None
    if pixels is None:
        raise DeviceGarbled(f"not a picture: {len(data)} bytes that begin with {data[:8].hex(' ')} cannot be decoded")
    return np.asarray(pixels, np.uint8)


def _refuse_huge(width: int, height: int) -> None:
    if width <= 0 or height <= 0 or width * height > MAX_PIXELS:
        raise DeviceGarbled(f"picture: its header says {width}×{height} px, at most {MAX_PIXELS:,} pixels are decoded")


def _decode(jpeg: bytes, colours: str) -> Pixels:
    if jpeg[:2] != START:
        raise DeviceGarbled(f"picture: {len(jpeg)} bytes do not start with a JPEG's marker ff d8")
    _refuse_huge(*read_header(jpeg).size_px)
    length = whole_length(jpeg, len(jpeg))
    if length is None:
        raise DeviceGarbled(f"picture: the JPEG of {len(jpeg)} bytes is cut off, its end marker ff d9 is missing")
    data = jpeg[:length]
    try:
        return np.asarray(simplejpeg.decode_jpeg(data, colorspace=colours), np.uint8)
    except ValueError as error:
        if not _padded(data, str(error)):
            raise DeviceGarbled(f"picture: the JPEG of {len(jpeg)} bytes is damaged: {error}") from None
    return np.asarray(simplejpeg.decode_jpeg(data, colorspace=colours, strict=False), np.uint8)


def _padded(data: bytes, complaint: str) -> bool:
    """Whether all that the decoder found too much is the filling in front of the end marker."""
    surplus = _SURPLUS.search(complaint)
    return surplus is not None and not data[-2 - int(surplus[1]) : -2].strip(b"\0\xff")


def encode_jpeg(pixels: Pixels) -> bytes:
    """Encode a picture of shape (h, w) grey or (h, w, 3) BGR at `ENCODED_QUALITY`.

    Raises
    ------
    DeviceGarbled
        When the encoder does not take a picture of this shape.
    """
    done, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, ENCODED_QUALITY])
    if not done:
        raise DeviceGarbled(f"a picture of shape {pixels.shape} cannot be encoded as JPEG")
    return encoded.tobytes()
