"""Pictures that were not written when they came, kept for as long as a request may still use them."""

from __future__ import annotations

from collections import OrderedDict

from ptzd.model import FrameRef
from ptzd.ports import Picture

_REMEMBERED = 1024
Key = tuple[str, int, int]


def key_of(topic: str, frame: FrameRef) -> Key:
    """Names one picture of one topic; a stream that starts anew counts anew, so its time belongs to it."""
    return (topic, frame.seq, frame.t_capture_ns)


class LatePictures:
    """Decides between now, later and never; holds references, not copies.

    Parameters
    ----------
    horizon_ns : int
        How long a skipped picture can still be asked for, ns.
    """

    def __init__(self, horizon_ns: int) -> None:
        self._horizon_ns = horizon_ns
        self._skipped: OrderedDict[Key, Picture] = OrderedDict()
        self._wanted: OrderedDict[Key, None] = OrderedDict()
        self._written: OrderedDict[Key, None] = OrderedDict()

    def __len__(self) -> int:
        return len(self._skipped)

    def seen(self, topic: str, picture: Picture) -> bool:
        """Whether this picture is already with the writer."""
        return key_of(topic, picture.frame) in self._written

    def is_wanted(self, topic: str, picture: Picture) -> bool:
        """Whether it was asked for before it came."""
        return key_of(topic, picture.frame) in self._wanted

    def skip(self, topic: str, picture: Picture) -> None:
        """Keep a picture that is not written now; forget those beyond the horizon."""
        self._skipped[key_of(topic, picture.frame)] = picture
        oldest = picture.t_arrival_ns - self._horizon_ns
        while next(iter(self._skipped.values())).t_arrival_ns < oldest:
            self._skipped.popitem(last=False)

    def wrote(self, topic: str, frame: FrameRef) -> None:
        """Remember that the writer has it."""
        key = key_of(topic, frame)
        self._wanted.pop(key, None)
        self._skipped.pop(key, None)
        _remember(self._written, key)

    def want(self, topic: str, frame: FrameRef) -> Picture | None:
        """Ask for a picture: returns it when it was skipped; one that comes later is kept by :meth:`is_wanted`."""
        key = key_of(topic, frame)
        if key in self._written:
            return None
        if key in self._skipped:
            return self._skipped[key]
        _remember(self._wanted, key)
        return None


def _remember(keys: OrderedDict[Key, None], key: Key) -> None:
    keys[key] = None
    while len(keys) > _REMEMBERED:
        keys.popitem(last=False)
