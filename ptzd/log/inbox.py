"""The queue between the loop and the writer's thread: pictures are refused when it is full, all else never."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from ptzd.config import LogSettings
from ptzd.control.commands import Command
from ptzd.control.events import Event
from ptzd.log.protobuf import CompressedImage, encode_image
from ptzd.log.run_info import RunInfo


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """One message on its way to the file."""

    topic: str
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes | CompressedImage
    droppable: bool = False
    """Whether it may be left out when the disk cannot follow."""
    source: Event | Command | None = None
    """What viewer documents are derived from."""

    def payload(self) -> bytes:
        """Serialised message."""
        return self.data if isinstance(self.data, bytes) else encode_image(self.data)


@dataclass(frozen=True, slots=True)
class Cut:
    """Between the records before and behind it the file ends and the next begins."""


@dataclass(frozen=True, slots=True)
class Adopt:
    """Files that begin from here on are written with these settings, and say so at their head."""

    settings: LogSettings
    run: RunInfo


@dataclass(frozen=True, slots=True)
class Settle:
    """Calls back, in the writer's thread, when all before it is in a closed chunk or file."""

    done: Callable[[], None]


@dataclass(frozen=True, slots=True)
class End:
    """Nothing comes behind it."""


Item = Record | Cut | Adopt | Settle | End


class Inbox:
    """First in, first out, for one thread that takes.

    Parameters
    ----------
    droppable : int
        How many droppable records may wait.
    """

    def __init__(self, droppable: int) -> None:
        self._limit = droppable
        self._waiting = 0
        self._items: deque[Item] = deque()
        self._changed = threading.Condition()

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: Item) -> bool:
        """Take an item on; False when it is droppable and the queue is full of those."""
        with self._changed:
            if isinstance(item, Record) and item.droppable:
                if self._waiting >= self._limit:
                    return False
                self._waiting += 1
            self._items.append(item)
            self._changed.notify()
        return True

    def take(self, timeout_s: float) -> Item | None:
        """Oldest item; None when none came in time."""
        with self._changed:
            if not self._items and not self._changed.wait_for(lambda: bool(self._items), timeout_s):
                return None
            item = self._items.popleft()
            if isinstance(item, Record) and item.droppable:
                self._waiting -= 1
            return item
