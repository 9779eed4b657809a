"""Pictures in memory: a ring of the fisheye's last seconds, and what requests have pinned."""

from __future__ import annotations

from collections import OrderedDict

from ptzd.errors import DeviceGarbled
from ptzd.model import FrameRef
from ptzd.ports import Picture

_SIZE_MARKERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG start-of-frame markers SOF0…SOF15 (ITU-T T.81, table B.1)."""


def jpeg_size_px(jpeg: bytes) -> tuple[int, int]:
    """Width and height of a JPEG from its header, without decoding it.

    Raises
    ------
    DeviceGarbled
        When there is no frame header.
    """
    position = 2
    while position + 9 < len(jpeg) and jpeg[position] == 0xFF:
        marker = jpeg[position + 1]
        if marker in _SIZE_MARKERS:
            height = int.from_bytes(jpeg[position + 5 : position + 7])
            width = int.from_bytes(jpeg[position + 7 : position + 9])
            return width, height
        position += 2 + int.from_bytes(jpeg[position + 2 : position + 4])
    raise DeviceGarbled(f"a picture of {len(jpeg)} bytes has no JPEG frame header; is the stream really JPEG?")


class FrameStore:
    """Bytes of fisheye frames and PTZ views, by reference.

    Parameters
    ----------
    ring : int
        Fisheye frames kept besides the pinned ones; at least the core's ring, so that what it accepts is here.
    """

    def __init__(self, ring: int) -> None:
        self._ring_size = ring
        self._ring: OrderedDict[FrameRef, Picture] = OrderedDict()
        self._pinned: dict[str, dict[FrameRef, Picture]] = {}
        self._views: OrderedDict[FrameRef, Picture] = OrderedDict()

    def add(self, picture: Picture) -> None:
        """Put the newest fisheye frame into the ring."""
        self._ring[picture.frame] = picture
        while len(self._ring) > self._ring_size:
            self._ring.popitem(last=False)

    def pin(self, request_id: str, frame: FrameRef) -> Picture | None:
        """Keep a frame for a request; None when it is no longer here."""
        picture = self.fisheye(frame)
        if picture is not None:
            self._pinned.setdefault(request_id, {})[frame] = picture
        return picture

    def release(self, request_id: str) -> None:
        """Let the frames of a request go."""
        self._pinned.pop(request_id, None)

    def clear_ring(self) -> None:
        """Forget the ring: after a loss, sequence numbers start anew."""
        self._ring.clear()

    def fisheye(self, frame: FrameRef) -> Picture | None:
        """A fisheye frame from the ring or the pinned ones."""
        if frame in self._ring:
            return self._ring[frame]
        return next((pinned[frame] for pinned in self._pinned.values() if frame in pinned), None)

    def add_view(self, picture: Picture) -> None:
        """Keep a PTZ picture that was grabbed; only a scan's worth of them is needed."""
        self._views[picture.frame] = picture
        while len(self._views) > self._ring_size:
            self._views.popitem(last=False)

    def view(self, frame: FrameRef) -> Picture | None:
        """A grabbed PTZ picture."""
        return self._views.get(frame)
