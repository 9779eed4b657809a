"""Answers to queries, sent from threads of their own.

Zenoh sends a reply in the caller's thread, and when an asker has stopped reading, that call blocks until Zenoh gives
the asker up (5 s). On the event loop it would hold everything, a stop included. Two lanes: what operators wait for has
a thread to itself.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from queue import SimpleQueue

import msgspec
import zenoh

from ptzd.bus.messages import IMAGE_ENCODING, ErrorReply, encoding
from ptzd.outgoing import ImageAttachment

LOGGER = logging.getLogger(__name__)

CROWDED = 512
"""Answers waiting in a lane beyond which further questions are turned away at the door."""
PATIENCE_S = 1.0
"""For the last answers when the bus closes; an asker that reads nothing is not waited for."""

Sending = Callable[[zenoh.Query], None]


def send_reply(query: zenoh.Query, key: str, payload: bytes, message: str) -> None:
    """Answer a query on a key with an encoded message and end it, in this thread."""
    with query:
        query.reply(key, payload, encoding=encoding(message))


def send_refusal(query: zenoh.Query, error: ErrorReply) -> None:
    """Answer a query with an error and end it, in this thread."""
    with query:
        query.reply_err(msgspec.json.encode(error), encoding=encoding("ErrorReply"))


class _Lane:
    """One thread that sends in order."""

    def __init__(self, name: str) -> None:
        self._sendings: SimpleQueue[tuple[zenoh.Query, Sending] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=f"ptzd-{name}", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        return self._sendings.qsize()

    def put(self, query: zenoh.Query, send: Sending) -> None:
        self._sendings.put((query, send))

    def end(self) -> None:
        self._sendings.put(None)

    def join(self) -> None:
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        while (waiting := self._sendings.get()) is not None:
            query, send = waiting
            try:
                send(query)
            except zenoh.ZError as error:
                LOGGER.debug("an answer was not sent: %s", error)
            # a query that is held keeps its asker waiting, and this frame lives until the next one comes
            del waiting, query, send


class Replies:
    """Sends from two lanes; every method returns at once and may be called from any thread."""

    def __init__(self) -> None:
        self._urgent, self._ordinary = _Lane("urgent-replies"), _Lane("replies")

    def close(self) -> None:
        """Send what waits, for at most `PATIENCE_S` a lane (blocking)."""
        for lane in (self._urgent, self._ordinary):
            lane.end()
        for lane in (self._urgent, self._ordinary):
            lane.join()

    @property
    def crowded(self) -> bool:
        """Whether so many ordinary answers wait that no further question should be taken."""
        return self._ordinary.waiting >= CROWDED

    def reply(self, query: zenoh.Query, key: str, payload: bytes, message: str) -> None:
        """Answer on a key with an encoded message."""
        self._lane(key).put(query, lambda query: send_reply(query, key, payload, message))

    def reply_image(self, query: zenoh.Query, key: str, jpeg: bytes, attachment: ImageAttachment) -> None:
        """Answer with a picture, in the form in which it is published."""

        def send(query: zenoh.Query) -> None:
            with query:
                query.reply(key, jpeg, encoding=IMAGE_ENCODING, attachment=msgspec.json.encode(attachment))

        self._ordinary.put(query, send)

    def refuse(self, query: zenoh.Query, error: ErrorReply, key: str = "") -> None:
        """Answer with an error; ``key`` is what was asked, operator's verbs go first."""
        self._lane(key or str(query.key_expr)).put(query, lambda query: send_refusal(query, error))

    def drop(self, query: zenoh.Query) -> None:
        """Let somebody who looks around go without an answer."""
        self._ordinary.put(query, lambda query: query.drop())  # type: ignore[no-untyped-call]  # untyped in the stub

    def send(self, query: zenoh.Query, send: Sending) -> None:
        """Have several answers sent; ``send`` ends the query."""
        self._ordinary.put(query, send)

    def _lane(self, key: str) -> _Lane:
        return self._urgent if "/control/" in key or key.endswith("/cancel") else self._ordinary
