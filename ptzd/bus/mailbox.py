"""From Zenoh's threads into the loop: bounded, never blocking the sender."""

from __future__ import annotations

import asyncio
import threading
from collections import deque
from typing import Generic, TypeVar

_T = TypeVar("_T")


class Mailbox(Generic[_T]):
    """A mailbox that any thread may fill and one task empties.

    Parameters
    ----------
    loop : asyncio.AbstractEventLoop
        The loop of the task that empties it.
    capacity : int
        Most items waiting.
    evict : bool
        What a full box does: drop its oldest item (newest wins), or turn the new one away.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, capacity: int, *, evict: bool) -> None:
        self._loop = loop
        self._capacity = capacity
        self._evict = evict
        self._items: deque[_T] = deque()
        self._lock = threading.Lock()
        self._filled = asyncio.Event()
        self._closed = False
        self.dropped = 0
        """Items evicted or turned away so far."""

    def push(self, item: _T) -> bool:
        """Put an item in, from any thread; False when it was turned away."""
        with self._lock:
            if self._closed:
                return False
            if len(self._items) >= self._capacity:
                self.dropped += 1
                if not self._evict:
                    return False
                self._items.popleft()
            first = not self._items
            self._items.append(item)
        if first:
            self._wake()
        return True

    def close(self) -> None:
        """Take nothing more, from any thread; what waits can still be taken."""
        with self._lock:
            self._closed = True
        self._wake()

    async def take(self) -> list[_T]:
        """Everything that waits, as soon as there is something; empty when closed and empty."""
        await self._filled.wait()
        with self._lock:
            batch = list(self._items)
            self._items.clear()
            if not self._closed:
                self._filled.clear()
        return batch

    def _wake(self) -> None:
        try:
            self._loop.call_soon_threadsafe(self._filled.set)
        except RuntimeError:
            # The loop has ended: nobody will read any more, and the sender must not hear of it.
            self._closed = True
