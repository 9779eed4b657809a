"""Queries of a client: answers, refusals and silence told apart."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

import msgspec
import zenoh
from msgspec import Struct
from zenoh.handlers import Callback

from ptzd.bus.keys import Keys
from ptzd.bus.messages import ErrorReply, encoding
from ptzd.errors import BusError, RequestRefused

_M = TypeVar("_M", bound=Struct)
_Ask = Callable[["Callback[zenoh.Reply]"], object]


async def ask(session: zenoh.Session, key: str, timeout_s: float, message: Struct | None = None) -> list[zenoh.Sample]:
    """Everybody's answers to a query, at least one.

    Raises
    ------
    RequestRefused
        The first error reply of a ptzd, when nobody had an answer.
    BusError
        When nobody is there, or not in time.
    """
    loop = asyncio.get_running_loop()
    started_s = loop.time()
    replies = await _collect(
        lambda callback: session.get(
            key,
            callback,
            payload=None if message is None else msgspec.json.encode(message),
            encoding=None if message is None else encoding(type(message).__name__),
            timeout=timeout_s,
        )
    )
    answers = [reply.ok for reply in replies if reply.ok is not None]
    if answers:
        return answers
    for reply in replies:
        if reply.err is not None and str(reply.err.encoding) == encoding("ErrorReply"):
            error = decoded(reply.err.payload.to_bytes(), ErrorReply)
            raise RequestRefused(error.code, error.message, error.field)
    # The time may end on the other side first; then there is not even Zenoh's own error reply.
    if replies or loop.time() - started_s >= 0.9 * timeout_s:
        raise BusError(f"ptzd did not answer on {key} within {timeout_s:g} s")
    raise BusError(f"no ptzd answers on {key}: is the daemon running, is the address right?")


async def ask_one(
    session: zenoh.Session, key: str, answer: type[_M], timeout_s: float, message: Struct | None = None
) -> _M:
    """The first answer to a query, decoded; raises as :func:`ask`."""
    answers = await ask(session, key, timeout_s, message)
    return decoded(answers[0].payload.to_bytes(), answer)


async def rigs_alive(session: zenoh.Session, prefix: str, timeout_s: float) -> list[str]:
    """Names of the rigs that hold a liveliness token, sorted."""
    keys = Keys(prefix, "*")
    replies = await _collect(lambda callback: session.liveliness().get(keys.full("alive"), callback, timeout=timeout_s))
    return sorted({keys.rig_of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None})


_T = TypeVar("_T")


def decoded(payload: bytes, message: type[_T]) -> _T:
    """A message of the daemon; BusError when it is not one."""
    try:
        return msgspec.json.decode(payload, type=message)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise BusError(f"bus: what came is no message of a ptzd of this version: {error}") from None


async def _collect(get: _Ask) -> list[zenoh.Reply]:
    """Run a query; Zenoh calls the second function when the last reply is in or the time is over."""
    loop = asyncio.get_running_loop()
    replies: list[zenoh.Reply] = []
    ended = asyncio.Event()

    def end() -> None:
        if not loop.is_closed():
            loop.call_soon_threadsafe(ended.set)

    get(Callback(replies.append, end, indirect=False))
    await ended.wait()
    return replies
