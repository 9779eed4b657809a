"""What comes in on the declared keys, carried from Zenoh's threads to handlers on the loop.

A callback of Zenoh only copies and enqueues; it may run on the network's own thread. A query that finds its box full is
told ``busy`` at once, a put is counted and dropped.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

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


class Catching(Protocol):
    """What becomes of what is meant for nobody."""

    def asked_in_vain(self, key: str) -> bool:
        """Whether nobody answers a query on this key."""
        ...

    def put_in_vain(self, key: str) -> bool:
        """Whether nobody listens to a put on this key."""
        ...

    def on_query(self, arrival: Arrival) -> None:
        """Answer such a query."""
        ...

    def on_put(self, arrival: Arrival) -> None:
        """Tell of such a put."""
        ...

    def on_delete(self, arrival: Arrival) -> None:
        """Tell of a delete."""
        ...


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
        self.answered: set[str] = set()
        """Key expressions of the queryables."""
        self.heard: set[str] = set()
        """Key expressions of the subscribers."""
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
        self.answered.add(key)

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
        self.heard.add(key)

    def catch(self, answer: str, listen: Sequence[str], strays: Catching) -> None:
        """Declare a queryable and subscribers with others' keys in theirs, for what those others do not take."""

        def ask(query: zenoh.Query) -> None:
            asked = str(query.key_expr)
            if not strays.asked_in_vain(asked):
                query.drop()  # type: ignore[no-untyped-call]  # untyped in the stub
                return
            arrival = Arrival(key=asked, payload=b"", size=0, query=query, t_ns=self._clock.now_ns())
            if self._crowded() or not self._box.push((strays.on_query, arrival)):
                send_refusal(query, BUSY)

        def put(sample: zenoh.Sample) -> None:
            arrival = Arrival(key=str(sample.key_expr), payload=b"", size=0, t_ns=self._clock.now_ns())
            if sample.kind != zenoh.SampleKind.PUT:
                self._box.push((strays.on_delete, arrival))
            elif strays.put_in_vain(arrival.key):
                self._box.push((strays.on_put, arrival))

        # what the daemon itself publishes under these keys is none of it
        remote = zenoh.Locality.REMOTE
        self._declared.append(self._session.declare_queryable(answer, Callback(ask, indirect=False), complete=False))
        for key in listen:
            subscriber = self._session.declare_subscriber(key, Callback(put, indirect=False), allowed_origin=remote)
            self._declared.append(subscriber)

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
