"""The event stream over WebSocket: whether the head moves, as cameras from AXIS OS 10.11 on tell it."""

from __future__ import annotations

import asyncio
import re
import secrets

import msgspec
from aiohttp import WSMsgType, web

from ptzd.sim.clock import SimClock
from ptzd.sim.unit import Unit

TOKEN_LIFE_S = 15.0
MOVE_TOPIC = "tns1:PTZController/tnsaxis:Move/Channel_1"
LOOK_S = 0.02
"""How often the motors are looked at while somebody listens."""


class Tokens:
    """Session tokens of wssession.cgi: good once, for 15 s."""

    def __init__(self, clock: SimClock) -> None:
        self._clock = clock
        self._issued: dict[str, float] = {}

    def issue(self) -> str:
        """A new token."""
        token = secrets.token_urlsafe(24)
        self._issued[token] = self._clock.now_s()
        return token

    def redeem(self, token: str) -> bool:
        """Whether the token is good; it is used up."""
        issued_s = self._issued.pop(token, None)
        return issued_s is not None and self._clock.now_s() - issued_s <= TOKEN_LIFE_S


def _failure(code: int, message: str, context: object) -> dict[str, object]:
    base: dict[str, object] = {"apiVersion": "1.0", "method": "events:configure"}
    if context is not None:
        base["context"] = context
    return base | {"error": {"code": code, "message": message}}


def _filters(message: dict[str, object]) -> list[re.Pattern[str]] | None:
    """Topic filters of a configure message; None when it is not understood."""
    parameters = message.get("params")
    entries = parameters.get("eventFilterList") if isinstance(parameters, dict) else None
    if not isinstance(entries, list):
        return None
    patterns = []
    for entry in entries:
        topic = entry.get("topicFilter") if isinstance(entry, dict) else None
        if not isinstance(topic, str):
            return None
        base = re.escape(topic.removesuffix("//."))
        patterns.append(re.compile(base + ("(/.*)?" if topic.endswith("//.") else "")))
    return patterns


class EventStream:
    """ws-data-stream of one camera.

    Parameters
    ----------
    unit : Unit
    """

    def __init__(self, unit: Unit) -> None:
        self._unit = unit
        self._sockets: set[web.WebSocketResponse] = set()

    async def serve(self, request: web.Request) -> web.WebSocketResponse:
        """Talk to one client until it leaves."""
        socket = web.WebSocketResponse(heartbeat=None)
        await socket.prepare(request)
        self._sockets.add(socket)
        teller: asyncio.Task[None] | None = None
        try:
            async for incoming in socket:
                if incoming.type is not WSMsgType.TEXT:
                    continue
                reply, patterns = _configured(incoming.data)
                await socket.send_str(msgspec.json.encode(reply).decode())
                if patterns is None:
                    break
                await _end(teller)
                teller = asyncio.create_task(self._tell(socket, patterns), name="sim events")
        finally:
            await _end(teller)
            self._sockets.discard(socket)
            await socket.close()
        return socket

    async def close(self) -> None:
        """Send everybody away."""
        for socket in list(self._sockets):
            await socket.close()

    async def _tell(self, socket: web.WebSocketResponse, patterns: list[re.Pattern[str]]) -> None:
        """Report the state now and at every change, a little late."""
        if not any(pattern.fullmatch(MOVE_TOPIC) for pattern in patterns):
            return
        clock, lag_s = self._unit.clock, self._unit.profile.timing.event_lag_s
        told: bool | None = None
        while not socket.closed:
            moving = self._unit.head.moving(clock.now_s() - lag_s)
            if moving != told:
                told = moving
                await socket.send_str(msgspec.json.encode(self._notification(moving=moving)).decode())
            await clock.sleep_until(clock.now_s() + LOOK_S)

    def _notification(self, *, moving: bool) -> dict[str, object]:
        message = {"source": {"PTZConfigurationToken": "1"}, "key": {}, "data": {"is_moving": str(int(moving))}}
        notification = {"timestamp": int(self._unit.clock.now_s() * 1000), "topic": MOVE_TOPIC, "message": message}
        return {"apiVersion": "1.0", "method": "events:notify", "params": {"notification": notification}}


def _configured(text: str) -> tuple[dict[str, object], list[re.Pattern[str]] | None]:
    """Answer to a configure message, and its filters unless it was wrong."""
    try:
        message = msgspec.json.decode(text, type=dict[str, object])
    except msgspec.DecodeError:
        return _failure(2101, "Invalid JSON", None), None
    context = message.get("context")
    if message.get("method") != "events:configure":
        return _failure(2102, "Method not supported", context), None
    patterns = _filters(message)
    if patterns is None:
        return _failure(2103, "Required parameter missing or invalid", context), None
    reply: dict[str, object] = {"apiVersion": "1.0", "method": "events:configure", "data": {}}
    return reply | ({"context": context} if context is not None else {}), patterns


async def _end(task: asyncio.Task[None] | None) -> None:
    if task is not None:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
