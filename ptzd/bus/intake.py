"""Events on their way from the bus to the core: first come, first served, bounded, with room kept for the operator."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable

from ptzd.control.events import CancelReceived, ControlReceived, Event, UpdateReceived

REQUESTS = 64
"""Most requests and refusals waiting for the core."""
URGENT = 64
"""Room beyond that for cancels and operator verbs, so that a flood of requests cannot keep a stop out."""


class EventQueue:
    """A bounded queue of events.

    Parameters
    ----------
    still_wanted : Callable[[Event], bool]
        Asked when an event is taken: False skips it, e.g. because its query was answered in the meantime.
    """

    def __init__(self, still_wanted: Callable[[Event], bool]) -> None:
        self._still_wanted = still_wanted
        self._events: deque[Event] = deque()
        self._changed = asyncio.Event()
        self._closed = False
        self._error: BaseException | None = None

    def offer(self, event: Event) -> bool:
        """Append an event; False without room for its kind. Of one request only the newest update by put waits."""
        if isinstance(event, UpdateReceived):
            self._withdraw_update(event.id)
        urgent = isinstance(event, CancelReceived | ControlReceived)
        if self._closed or len(self._events) >= REQUESTS + (URGENT if urgent else 0):
            return False
        self._events.append(event)
        self._changed.set()
        return True

    def close(self, error: BaseException | None = None) -> None:
        """End the iteration once what waits has been taken, with an error where there is one."""
        self._closed = True
        self._error = error
        self._changed.set()

    async def __aiter__(self) -> AsyncIterator[Event]:
        while True:
            await self._changed.wait()
            while self._events:
                event = self._events.popleft()
                if self._still_wanted(event):
                    yield event
            if self._error is not None:
                raise self._error
            if self._closed:
                return
            self._changed.clear()

    def _withdraw_update(self, request_id: str) -> None:
        for index, waiting in enumerate(self._events):
            if isinstance(waiting, UpdateReceived) and waiting.id == request_id and waiting.token is None:
                del self._events[index]
                return
