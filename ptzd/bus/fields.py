"""What messages are made of: the root of those that come in, and fields that several of them have."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta, Struct

from ptzd.model import MIN_BOX_SIDE_PX

END = r"$(?!\n)"
"""End of a text: Python's ``$`` alone would let a trailing newline through."""
Id = Annotated[str, Meta(pattern=rf"^[A-Za-z0-9._-]{{1,64}}{END}", description="1 to 64 of A-Z a-z 0-9 . _ -")]
Label = Annotated[
    str, Meta(max_length=64, pattern=rf"^[^\x00-\x1f\x7f-\x9f]*{END}", description="free text, no control characters")
]
Pixel = Annotated[float, Meta(ge=-1e6, le=1e6)]
Side = Annotated[float, Meta(ge=MIN_BOX_SIDE_PX, le=1e6)]
Counter = Annotated[int, Meta(ge=0, le=(1 << 63) - 1)]
Metres = Annotated[float, Meta(gt=0, le=1e9)]
Seconds = Annotated[float, Meta(ge=0, le=86400, description="s, at most one day")]
Document = dict[str, Any]
Plain = float | int | str | bool | None
Timeout = Annotated[float, Meta(gt=0, le=86400, description="s, at most one day")]


class Incoming(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, omit_defaults=True):
    """A message to the daemon."""


class BoxPx(Incoming, frozen=True):
    """Rectangle in the fisheye picture, pixel centres at integers; centre = (x + w/2, y + h/2)."""

    x: Pixel
    y: Pixel
    w: Side
    h: Side
