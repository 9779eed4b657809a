"""Pictures in memory: a ring of the fisheye's last seconds, and what requests have pinned."""

from __future__ import annotations

from collections import OrderedDict

from ptzd.model import FrameRef
from ptzd.ports import Picture


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

    def pin(self, request_id: str, frame: FrameRef, instead_of: tuple[FrameRef, ...] = ()) -> Picture | None:
        """Keep a frame for a request and let go those that it replaces; None when it is no longer here."""
        picture, kept = self.fisheye(frame), self._pinned.setdefault(request_id, {})
        if picture is not None:
            kept[frame] = picture
        for replaced in instead_of:
            kept.pop(replaced, None)
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
