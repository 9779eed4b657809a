"""What comes in on the declared keys, carried from Zenoh's threads to handlers on the loop.

A callback of Zenoh only copies and enqueues; it may run on the network's own thread. A query that finds its box full is
told ``busy`` at once, a put is counted and dropped.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

import zenoh
from zenoh.handlers import Callback

from ptzd.bus.decode import MAX_PAYLOAD_BYTES, too_large
from ptzd.bus.mailbox import Mailbox
from ptzd.bus.messages import ErrorReply
from ptzd.bus.pending_queries import BUSY
from ptzd.bus.replies import send_refusal
from ptzd.ports import Clock


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrival:
    """One message that came in."""

    key: str
    """Full key; of a query its selector's, which may hold wildcards."""
    payload: bytes
    size: int
    """Bytes sent; of a message that is too large the payload is left behind."""
    query: zenoh.Query | None = None
    t_ns: int = 0
    """When it came in, on the daemon's clock."""


Handler = Callable[[Arrival], None]


class Arrivals:
    """One bounded box of arrivals with the task that hands them on.

    Parameters
    ----------
    session : zenoh.Session
        Open session.
    capacity : int
        Most arrivals waiting.
    clock : Clock
        Stamps what comes in.
    evict : bool
        Whether a full box drops its oldest arrival; only for boxes without queries.
    crowded : callable
        Asked for every query; when true, it is turned away.
    """

    def __init__(
        self,
        session: zenoh.Session,
        capacity: int,
        clock: Clock,
        *,
        evict: bool = False,
        crowded: Callable[[], bool] = lambda: False,
    ) -> None:
        self._session = session
        self._clock = clock
        self._crowded = crowded
        self._box: Mailbox[tuple[Handler, Arrival]] = Mailbox(asyncio.get_running_loop(), capacity, evict=evict)
        self._declared: list[zenoh.Queryable[None] | zenoh.Subscriber[None]] = []

    @property
    def dropped(self) -> int:
        """Messages that found no room."""
        return self._box.dropped

    def answer(self, key: str, handler: Handler) -> None:
        """Declare a queryable."""

        def receive(query: zenoh.Query) -> None:
            key = str(query.key_expr)
            size = len(query.payload) if query.payload is not None else 0
            if size > MAX_PAYLOAD_BYTES:
                error = too_large(size)
                send_refusal(query, ErrorReply(code=error.code, message=error.message))
                self._box.push((handler, Arrival(key=key, payload=b"", size=size, t_ns=self._clock.now_ns())))
                return
            payload = query.payload.to_bytes() if query.payload is not None else b""
            arrival = Arrival(key=key, payload=payload, size=size, query=query, t_ns=self._clock.now_ns())
            if self._crowded() or not self._box.push((handler, arrival)):
                send_refusal(query, BUSY)

        self._declared.append(self._session.declare_queryable(key, Callback(receive, indirect=False), complete=True))

    def listen(self, key: str, handler: Handler) -> None:
        """Declare a subscriber."""

        def receive(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.PUT:
                return
            size = len(sample.payload)
            payload = sample.payload.to_bytes() if size <= MAX_PAYLOAD_BYTES else b""
            arrival = Arrival(key=str(sample.key_expr), payload=payload, size=size, t_ns=self._clock.now_ns())
            self._box.push((handler, arrival))

        self._declared.append(self._session.declare_subscriber(key, Callback(receive, indirect=False)))

    async def run(self) -> None:
        """Hand arrivals to their handlers until the box is closed and empty."""
        while batch := await self._box.take():
            for handler, arrival in batch:
                handler(arrival)
            # A flood keeps the box filled: let the rest of the loop live.
            await asyncio.sleep(0)

    def undeclare(self) -> None:
        """Withdraw the keys (blocking, well under a ms) and let :meth:`run` end."""
        for declared in self._declared:
            declared.undeclare()  # type: ignore[no-untyped-call]  # untyped in the stub
        self._box.close()
