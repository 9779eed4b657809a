"""What others ask the core for, turned into events: requests, updates, cancels, operator verbs.

A selector with wildcards may name several rigs (``ptzd/*/control/stop`` stops a fleet), but what it asks for must be
spelt out: ``ptzd/**`` is somebody looking around and must move nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from ptzd.bus.arrivals import Arrival, Handler
from ptzd.bus.decode import (
    decode,
    goto_event,
    home_after_event,
    lease_event,
    move_event,
    patrol_event,
    ranges_event,
    refused,
    request_event,
    too_large,
    update_event,
)
from ptzd.bus.event_queue import EventQueue
from ptzd.bus.keys import Keys, request_id_of
from ptzd.bus.messages import Empty
from ptzd.bus.pending_queries import BUSY, PendingQueries
from ptzd.bus.replies import Replies
from ptzd.control.events import (
    CancelReceived,
    ControlReceived,
    Event,
    GotoAsked,
    PatrolAsked,
    PayloadRefused,
    RequestReceived,
    Verb,
)
from ptzd.errors import RequestRefused

OVERTAKEN = RequestRefused("stopped", "an operator's stop or home came before this request was taken up; ask again")

GOTO_WITHIN_S = 30.0
"""A goto is answered when the head is there: a slow one needs 15 s, and a stop before it three."""


class CoreHandlers:
    """Handlers for what the core decides on.

    Parameters
    ----------
    keys : Keys
        Of this rig.
    pending : PendingQueries
        Keeps the queries until the core answers.
    events : EventQueue
        Where the events go.
    replies : Replies
        Sends the answers.
    """

    def __init__(self, keys: Keys, pending: PendingQueries, events: EventQueue, replies: Replies) -> None:
        self._keys = keys
        self._pending = pending
        self._events = events
        self._replies = replies
        self._halted_ns = 0
        self.dropped = 0
        """Puts for which the core had no room."""

    def on_request(self, arrival: Arrival) -> None:
        """``roi``: a query or a put."""
        if not arrival.key.endswith("/roi"):
            self._ignore(arrival)
            return
        token = self._token(arrival, self._keys.full("roi"))
        if arrival.query is None or token is not None:
            event = _too_large(arrival) or request_event(arrival.payload, token)
            if isinstance(event, RequestReceived) and arrival.t_ns <= self._halted_ns:
                # the operator's word overtakes what waits: a request from before it must not move the head after it
                event = refused(OVERTAKEN, token, event.id)
            self._offer(event, token)

    def on_update(self, arrival: Arrival) -> None:
        """``roi/<id>/update``: a put or a query."""
        request_id = self._named(arrival, "update")
        if request_id is None:
            return
        token = self._token(arrival, self._keys.of_request(request_id, "update"))
        if arrival.query is None or token is not None:
            too_large = _too_large(arrival, about=request_id)
            self._offer(too_large or update_event(arrival.payload, request_id, token), token)

    def on_cancel(self, arrival: Arrival) -> None:
        """``roi/<id>/cancel``: a query or a put."""
        request_id = self._named(arrival, "cancel")
        if request_id is None:
            return
        token = self._token(arrival, self._keys.of_request(request_id, "cancel"))
        if arrival.query is None or token is not None:
            cancel = CancelReceived(token=token, id=request_id)
            self._offer(_refused_unless_empty(arrival, token, about=request_id) or cancel, token)

    def on_control(self, verb: Verb) -> Handler:
        """Handler of ``control/<verb>``: a query or a put."""

        def handle(arrival: Arrival) -> None:
            if not arrival.key.endswith(f"/control/{verb}"):
                self._ignore(arrival)
                return
            token = self._token(arrival, self._keys.full(f"control/{verb}"))
            if arrival.query is None or token is not None:
                event = _refused_unless_empty(arrival, token) or ControlReceived(token=token, verb=verb)
                taken = self._offer(event, token)
                # only a verb that the core is told takes anything away: who is refused must find all as it was
                if taken and isinstance(event, ControlReceived) and verb in {Verb.STOP, Verb.HOME}:
                    self._halted_ns = max(self._halted_ns, arrival.t_ns)
                    self._overtake()

        return handle

    def on_lease(self, arrival: Arrival) -> None:
        """``control/lease``: a query or a put."""
        self._on_person(arrival, "control/lease", lease_event)

    def on_move(self, arrival: Arrival) -> None:
        """``control/move``: a query or a put."""
        self._on_person(arrival, "control/move", move_event)

    def on_ranges(self, arrival: Arrival) -> None:
        """``control/ranges``: a query or a put."""
        self._on_person(arrival, "control/ranges", ranges_event)

    def on_goto(self, arrival: Arrival) -> None:
        """``control/goto``: a query or a put."""
        self._on_person(arrival, "control/goto", goto_event, within_s=GOTO_WITHIN_S)

    def on_patrol(self, arrival: Arrival) -> None:
        """``control/patrol``: a query or a put."""
        self._on_person(arrival, "control/patrol", patrol_event)

    def on_home_after(self, arrival: Arrival) -> None:
        """``control/home_after``: a query or a put."""
        self._on_person(arrival, "control/home_after", home_after_event)

    def tell(self, refusal: PayloadRefused) -> None:
        """Have a put refused that is on no key of these."""
        self._offer(refusal, None)

    def _on_person(
        self, arrival: Arrival, key: str, read: Callable[[bytes, int | None], Event], within_s: float | None = None
    ) -> None:
        if not arrival.key.endswith(f"/{key}"):
            self._ignore(arrival)
            return
        token = self._token(arrival, self._keys.full(key), within_s)
        if arrival.query is None or token is not None:
            event = _too_large(arrival) or read(arrival.payload, token)
            if isinstance(event, GotoAsked | PatrolAsked) and arrival.t_ns <= self._halted_ns:
                event = refused(OVERTAKEN, token, None)
            self._offer(event, token)

    def _overtake(self) -> None:
        for waiting in self._events.withdraw_requests():
            name = waiting.id if isinstance(waiting, RequestReceived) else None
            self._offer(refused(OVERTAKEN, waiting.token, name), waiting.token)

    def _named(self, arrival: Arrival, leaf: str) -> str | None:
        """The request that a key names; a put on a key that names none is told, a query that looks around let go."""
        request_id = request_id_of(arrival.key, leaf)
        if request_id is None:
            self._ignore(arrival)
            if arrival.query is None:
                message = f"{arrival.key} names no request; ids are 1 to 64 of A-Za-z0-9._-"
                error = RequestRefused("invalid", message, "$")
                self._offer(refused(error, None, None), None)
        return request_id

    def _token(self, arrival: Arrival, key: str, within_s: float | None = None) -> int | None:
        if arrival.query is None:
            return None
        token = self._pending.add(arrival.query, key, within_s)
        if token is None:
            self._replies.refuse(arrival.query, BUSY, key)
        return token

    def _ignore(self, arrival: Arrival) -> None:
        """Let somebody who looks around go without an answer."""
        if arrival.query is not None:
            self._replies.drop(arrival.query)

    def _offer(self, event: Event, token: int | None) -> bool:
        """Hand on; False when there was no room and whoever asked was told so."""
        if self._events.offer(event):
            return True
        if token is None:
            self.dropped += 1
        else:
            self._pending.refuse(token, BUSY)
        return False


def _too_large(arrival: Arrival, about: str | None = None) -> PayloadRefused | None:
    if arrival.size == len(arrival.payload):
        return None
    return refused(too_large(arrival.size), None, None, about=about)


def _refused_unless_empty(arrival: Arrival, token: int | None, about: str | None = None) -> PayloadRefused | None:
    """The refusal of a verb with something in it that asks for more than the verb does."""
    try:
        if arrival.size > len(arrival.payload):
            raise too_large(arrival.size)
        if arrival.payload:
            decode(arrival.payload, Empty)
    except RequestRefused as error:
        where = RequestRefused(error.code, f"{arrival.key.rpartition('/')[2]}: {error.message}", error.field)
        return refused(where, token, None, about=about)
    return None
