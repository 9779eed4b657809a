"""Pictures of the last seconds, by reference: one that was left out, or lies in an older file, can still be written."""

from __future__ import annotations

from collections import OrderedDict

from ptzd.model import FrameRef
from ptzd.ports import Picture

_REMEMBERED = 1024
Key = tuple[str, int, int]
Shown = tuple[str, Picture]
"""Topic and picture."""


def key_of(topic: str, frame: FrameRef) -> Key:
    """Names one picture of one topic; a stream that starts anew counts anew, so its time belongs to it."""
    return (topic, frame.seq, frame.t_capture_ns)


class RecentPictures:
    """Knows which pictures the present file has, which it could still get, and which are in use.

    Parameters
    ----------
    horizon_ns : int
        How long a picture can still be asked for, ns.
    """

    def __init__(self, horizon_ns: int) -> None:
        self._horizon_ns = horizon_ns
        self._recent: OrderedDict[Key, Shown] = OrderedDict()
        self._used: dict[str, dict[Key, Shown]] = {}
        self._wanted: OrderedDict[Key, None] = OrderedDict()
        self._written: OrderedDict[Key, None] = OrderedDict()

    def __len__(self) -> int:
        return len(self._recent)

    def add(self, topic: str, picture: Picture) -> None:
        """Take the newest picture in; those beyond the horizon are forgotten."""
        self._recent[key_of(topic, picture.frame)] = (topic, picture)
        oldest = picture.t_arrival_ns - self._horizon_ns
        while next(iter(self._recent.values()))[1].t_arrival_ns < oldest:
            self._recent.popitem(last=False)

    def written(self, topic: str, frame: FrameRef) -> bool:
        """Whether the present file has this picture."""
        return key_of(topic, frame) in self._written

    def wanted(self, topic: str, frame: FrameRef) -> bool:
        """Whether it was asked for before it came."""
        return key_of(topic, frame) in self._wanted

    def wrote(self, topic: str, frame: FrameRef) -> None:
        """The present file has it now."""
        key = key_of(topic, frame)
        self._wanted.pop(key, None)
        _remember(self._written, key)

    def want(self, topic: str, frame: FrameRef) -> Picture | None:
        """Ask for a picture: returns it when it is to be written now; one that comes later is :meth:`wanted`."""
        key = key_of(topic, frame)
        if key in self._written:
            return None
        known = self._find(key)
        if known is None:
            _remember(self._wanted, key)
            return None
        return known[1]

    def use(self, owner: str, topic: str, frame: FrameRef) -> None:
        """Keep a picture until :meth:`release` names the owner; every file that begins meanwhile gets it."""
        key = key_of(topic, frame)
        known = self._find(key)
        if known is not None:
            self._used.setdefault(owner, {})[key] = known

    def let_go(self, owner: str, topic: str, frames: tuple[FrameRef, ...]) -> None:
        """The owner uses these no more."""
        used = self._used.get(owner, {})
        for frame in frames:
            used.pop(key_of(topic, frame), None)

    def release(self, owner: str) -> None:
        """The owner uses no picture any more."""
        self._used.pop(owner, None)

    def begin_file(self) -> list[Shown]:
        """The present file ends; returns the pictures that the next one needs to replay alone."""
        self._written.clear()
        return list({key: shown for used in self._used.values() for key, shown in used.items()}.values())

    def _find(self, key: Key) -> Shown | None:
        if key in self._recent:
            return self._recent[key]
        return next((used[key] for used in self._used.values() if key in used), None)


def _remember(keys: OrderedDict[Key, None], key: Key) -> None:
    keys[key] = None
    while len(keys) > _REMEMBERED:
        keys.popitem(last=False)
