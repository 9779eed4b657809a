"""Queries that wait for the core's answer. Each is answered exactly once and let go, whatever happens.

A query object that is kept alive keeps the asking app waiting until its own timeout, so none is ever forgotten here.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass

import msgspec
import zenoh
from msgspec import Struct

from ptzd.bus.messages import ErrorReply
from ptzd.bus.replies import Replies
from ptzd.outgoing import ImageAttachment

BUSY = ErrorReply(code="busy", message="too many messages are waiting; ask again later")


@dataclass(frozen=True, slots=True)
class _Waiting:
    query: zenoh.Query
    key: str
    timer: asyncio.TimerHandle


class PendingQueries:
    """Tokens for queries that are answered later.

    Parameters
    ----------
    loop : asyncio.AbstractEventLoop
        Runs the safety timers.
    limit : int
        Most queries waiting at once.
    answer_within_s : float
        A query without an answer for this long gets the error ``internal``; an operator's verb ``unconfirmed``.
    replies : Replies
        Sends the answers.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop, limit: int, answer_within_s: float, replies: Replies) -> None:
        self._loop = loop
        self._replies = replies
        self._limit = limit
        self._answer_within_s = answer_within_s
        self._waiting: dict[int, _Waiting] = {}
        self._next = 1
        self.expired = 0
        """Queries that got no answer in time."""

    def add(self, query: zenoh.Query, key: str, within_s: float | None = None) -> int | None:
        """Keep a query that is to be answered on ``key``; None when full, the query is still the caller's then.

        With ``within_s`` the answer may take so long.
        """
        if len(self._waiting) >= self._limit:
            return None
        token = self._next
        self._next += 1
        within_s = self._answer_within_s if within_s is None else within_s
        timer = self._loop.call_later(within_s, self._expire, token, within_s)
        self._waiting[token] = _Waiting(query, key, timer)
        return token

    def waits(self, token: int) -> bool:
        """Whether the query still waits."""
        return token in self._waiting

    def key_of(self, token: int) -> str | None:
        """Key that the query is to be answered on; None when it no longer waits."""
        waiting = self._waiting.get(token)
        return None if waiting is None else waiting.key

    def reply(self, token: int, message: Struct) -> bool:
        """Answer; False when the query is no longer waiting."""
        waiting = self._take(token)
        if waiting is not None:
            self._replies.reply(waiting.query, waiting.key, msgspec.json.encode(message), type(message).__name__)
        return waiting is not None

    def reply_image(self, token: int, jpeg: bytes, attachment: ImageAttachment) -> bool:
        """Answer with a picture, in the form in which it is published; False when the query is no longer waiting."""
        waiting = self._take(token)
        if waiting is not None:
            self._replies.reply_image(waiting.query, waiting.key, jpeg, attachment)
        return waiting is not None

    def refuse(self, token: int, error: ErrorReply) -> bool:
        """Answer with an error; False when the query is no longer waiting."""
        waiting = self._take(token)
        if waiting is not None:
            self._replies.refuse(waiting.query, error, waiting.key)
        return waiting is not None

    def close(self) -> None:
        """Tell everybody who waits that the daemon is stopping."""
        for token in tuple(self._waiting):
            self.refuse(token, ErrorReply(code="stopping", message="the daemon is stopping"))

    def _take(self, token: int) -> _Waiting | None:
        waiting = self._waiting.pop(token, None)
        if waiting is not None:
            waiting.timer.cancel()
        return waiting

    def _expire(self, token: int, within_s: float) -> None:
        self.expired += 1
        waited = f"within {within_s:g} s"
        error = ErrorReply(code="internal", message=f"the daemon found no answer {waited}; see its log")
        _, control, verb = (self.key_of(token) or "").rpartition("/control/")
        if control:
            message = (
                f"{verb} sent, not confirmed yet {waited}: the camera is asked on; the status tells when it stands"
            )
            error = ErrorReply(code="unconfirmed", message=message)
        self.refuse(token, error)
