"""The few bytes of JPEG that a source of pictures must know about: start, end, and how raw pixels become one."""

from __future__ import annotations

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ptzd.errors import DeviceGarbled

START_OF_IMAGE = b"\xff\xd8"
END_OF_IMAGE = b"\xff\xd9"
ENCODED_QUALITY = 95
"""Of pictures that arrive as raw pixels (OpenCV's scale, 0 to 100): above it files grow, matches do not get better."""


class Searchable(Protocol):
    """What :func:`complete_length` needs; ``bytes`` and ``mmap.mmap`` have it, so nothing is copied to look."""

    def __getitem__(self, where: slice, /) -> bytes: ...

    def rfind(self, sub: bytes, start: int = ..., end: int = ..., /) -> int:
        """Where the last one begins; below 0 when there is none."""
        ...


def complete_length(data: Searchable, used: int) -> int | None:
    """Length of the picture at the start of a buffer, from the start marker up to and with the end marker.

    Drivers deliver truncated pictures without an error flag and some cameras fill up the end with zeros, so the marker
    is looked for from behind and only zeros may follow it.

    Parameters
    ----------
    data : Searchable
        A buffer with the picture at its start.
    used : int
        How many bytes of it belong to the picture.

    Returns
    -------
    int or None
        Bytes of the complete picture; None when it does not start as one or is cut off.
    """
    if data[:2] != START_OF_IMAGE:
        return None
    at = data.rfind(END_OF_IMAGE, 2, used)
    if at < 0:
        return None
    length = at + len(END_OF_IMAGE)
    return None if data[length:used].strip(b"\0") else length


def encode_jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """Encode a picture of shape (h, w) grey or (h, w, 3) BGR at :data:`ENCODED_QUALITY`.

    Raises
    ------
    DeviceGarbled
        The encoder does not take a picture of this shape.
    """
    done, encoded = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, ENCODED_QUALITY])
    if not done:
        raise DeviceGarbled(f"a picture of shape {pixels.shape} cannot be encoded as JPEG")
    return encoded.tobytes()
