"""Queries of a client: answers, refusals and silence told apart; what strangers answer is passed over."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TypeVar

import msgspec
import zenoh
from zenoh.handlers import Callback

from ptzd.bus.encode import Encoded
from ptzd.bus.keys import ANY_RIG, Keys, is_id
from ptzd.bus.messages import ErrorReply, Status, encoding
from ptzd.errors import BusError, RequestRefused

_M = TypeVar("_M")
_Ask = Callable[["Callback[zenoh.Reply]"], object]


async def ask(
    session: zenoh.Session, key: str, answer: type[_M], timeout_s: float, message: Encoded | None = None
) -> list[tuple[str, _M]]:
    """Everybody's answers to a query with the keys they came on, at least one.

    Raises
    ------
    RequestRefused
        The first error reply of a ptzd, when nobody had an answer.
    BusError
        When nobody is there, or not in time, or what came is no answer of a ptzd.
    """
    loop = asyncio.get_running_loop()
    started_s = loop.time()
    replies = await _collect(
        lambda callback: session.get(
            key,
            callback,
            payload=None if message is None else message.payload,
            encoding=None if message is None else message.encoding,
            timeout=timeout_s,
            # Everybody: Zenoh would ask the nearest alone of those who say that they know all there is.
            target=zenoh.QueryTarget.ALL,
        )
    )
    answers, strange = _understood(replies, answer)
    if answers:
        return answers
    refusals, _ = _understood(replies, ErrorReply, errors=True)
    for _, error in refusals:
        raise RequestRefused(error.code, error.message, error.field)
    if strange is not None:
        raise strange
    # The time may end on the other side first; then there is not even Zenoh's own error reply.
    if replies or loop.time() - started_s >= 0.9 * timeout_s:
        raise BusError(f"ptzd did not answer on {key} within {timeout_s:g} s")
    raise BusError(f"no ptzd answers on {key}: is the daemon running, is the address right?")


async def ask_one(
    session: zenoh.Session, key: str, answer: type[_M], timeout_s: float, message: Encoded | None = None
) -> _M:
    """The first answer to a query; raises as :func:`ask`."""
    return (await ask(session, key, answer, timeout_s, message))[0][1]


async def rigs_alive(session: zenoh.Session, prefix: str, timeout_s: float) -> list[str]:
    """Names of the rigs that hold a liveliness token, sorted; a name that no rig can have is passed over."""
    keys = Keys(prefix, ANY_RIG)
    replies = await _collect(lambda callback: session.liveliness().get(keys.full("alive"), callback, timeout=timeout_s))
    names = {keys.rig_of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None}
    return sorted(name for name in names if is_id(name))


async def rigs_answering(session: zenoh.Session, prefix: str, timeout_s: float) -> list[str]:
    """Names of the rigs that tell their status, sorted: anybody can hold a token."""
    keys = Keys(prefix, ANY_RIG)
    try:
        answers = await ask(session, keys.full("status"), Status, timeout_s)
    except (BusError, RequestRefused):
        return []
    return sorted({name for name in (keys.rig_of(key) for key, _ in answers) if is_id(name)})


def decoded(payload: bytes, message: type[_M]) -> _M:
    """A message of the daemon; BusError when it is not one."""
    try:
        return msgspec.json.decode(payload, type=message)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BusError(f"bus: what came is no message of a ptzd of this version: {error}") from None


def _understood(
    replies: list[zenoh.Reply], message: type[_M], *, errors: bool = False
) -> tuple[list[tuple[str, _M]], BusError | None]:
    """Replies that are such messages, and what is wrong with one that is not."""
    found: list[tuple[str, _M]] = []
    strange: BusError | None = None
    for reply in replies:
        told = reply.err if errors else reply.ok
        if told is None or (errors and str(told.encoding) != encoding("ErrorReply")):
            continue
        key = "" if reply.ok is None else str(reply.ok.key_expr)
        try:
            found.append((key, decoded(told.payload.to_bytes(), message)))
        except BusError as error:
            strange = error
    return found, strange


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
