"""Events on their way from the bus to the core: bounded, in order, the operator's in a queue of their own and first."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Callable

from ptzd.control.events import (
    CancelReceived,
    ControlReceived,
    Event,
    GotoAsked,
    HomeAfterAsked,
    LeaseAsked,
    MoveAsked,
    PatrolAsked,
    RequestReceived,
    UpdateReceived,
)

Moving = RequestReceived | GotoAsked | PatrolAsked
"""What moves the head when it is taken up."""
REQUESTS = 64
"""Most requests and refusals waiting for the core."""
URGENT = 64
"""Most operator's verbs waiting, and room for cancels beyond the requests: a flood of these keeps neither out."""

PLACES = 32
"""Room for an operator's places, patrols and the way home beyond the requests; cancels have more."""


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
        self._urgent: deque[Event] = deque()
        self._changed = asyncio.Event()
        self._closed = False
        self._error: BaseException | None = None

    def offer(self, event: Event) -> bool:
        """Append an event; False without room for its kind. Of one request only the newest update by put waits."""
        if isinstance(event, UpdateReceived):
            self._withdraw_update(event.id)
        lane, room = self._events, REQUESTS
        if isinstance(event, ControlReceived | LeaseAsked | MoveAsked):
            lane, room = self._urgent, URGENT
        elif isinstance(event, GotoAsked | PatrolAsked | HomeAfterAsked):
            # in order, for a stop takes them out; and beyond the requests, for a person wants it
            room += PLACES
        elif isinstance(event, CancelReceived):
            # in order, for it must not overtake the request that it takes back
            room += URGENT
        if self._closed or len(lane) >= room:
            return False
        lane.append(event)
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
            while self._urgent or self._events:
                event = (self._urgent or self._events).popleft()
                if self._still_wanted(event):
                    yield event
            if self._error is not None:
                raise self._error
            if self._closed:
                return
            self._changed.clear()

    def withdraw_requests(self) -> list[Moving]:
        """Take out what waits and would move the head, e.g. because an operator's stop overtakes it."""
        taken = [event for event in self._events if isinstance(event, Moving)]
        self._events = deque(event for event in self._events if not isinstance(event, Moving))
        return taken

    def _withdraw_update(self, request_id: str) -> None:
        for index, waiting in enumerate(self._events):
            if isinstance(waiting, UpdateReceived) and waiting.id == request_id and waiting.token is None:
                del self._events[index]
                return
