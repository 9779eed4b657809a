"""What the bus knows by itself and tells whoever asks: status, results, calibration, the log's files."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from typing import Literal

import msgspec
import zenoh

from ptzd.bus.arrivals import Arrival, Handler
from ptzd.bus.by_hand import MoveReply
from ptzd.bus.decode import decode
from ptzd.bus.keys import Keys, request_id_of
from ptzd.bus.messages import ErrorReply, LeaseReply, LogReply, LogRequest, encoding
from ptzd.bus.pending_queries import BUSY, PendingQueries
from ptzd.bus.places import GotoReply, HomeAfterReply, PatrolReply
from ptzd.bus.replies import Replies
from ptzd.bus.results import KeptResults
from ptzd.control.commands import PublishStatus, ReplyGoto, ReplyHomeAfter, ReplyLease, ReplyMove, ReplyPatrol
from ptzd.errors import PtzdError, RequestRefused
from ptzd.model import AUTOMATIC
from ptzd.outgoing import ImageAttachment, Outgoing, Pose
from ptzd.ports import Clock

LogHandler = Callable[[Literal["list", "rotate"]], Awaitable[Sequence[str]]]
"""Does what a query on ``log`` asks; returns the closed files, oldest first."""
ImageHandler = Callable[[str], Awaitable[tuple[bytes, ImageAttachment] | None]]
"""Newest JPEG of ``image/fisheye``, ``image/ptz`` or ``image/overlay`` with its attachment; None when there is none."""

MOST_RESULTS = 256
"""Newest results that one question with a wildcard is answered with."""
LOOKERS = 4
"""Such questions that may wait at once; the next is told ``busy``."""


class Answers:
    """Handlers for questions that need no decision, and the documents they are answered from.

    Parameters
    ----------
    keys : Keys
        Of this rig.
    clock : Clock
        Ages the kept results, stamps the status.
    pending : PendingQueries
        Keeps queries on the log while its handler works.
    results : KeptResults
        Of requests that have ended.
    status_extra : Callable[[], Mapping[str, object]]
        What the core does not know of the status: devices, pose, log, versions.
    replies : Replies
        Sends the answers.
    """

    def __init__(
        self,
        keys: Keys,
        clock: Clock,
        pending: PendingQueries,
        results: KeptResults,
        status_extra: Callable[[], Mapping[str, object]],
        replies: Replies,
    ) -> None:
        self._replies = replies
        self._looking = 0
        self._keys = keys
        self._clock = clock
        self._pending = pending
        self._results = results
        self._status_extra = status_extra
        self._tasks: set[asyncio.Task[None]] = set()
        self.status: PublishStatus | None = None
        """The core's latest word."""
        self.calibration: Mapping[str, object] | None = None
        self.pose: Pose | None = None
        """As last published."""
        self.log_handler: LogHandler | None = None
        self.image_handler: ImageHandler | None = None

    def status_document(self) -> dict[str, object]:
        """The status as of now; the core's fields win over others of the same name."""
        core: dict[str, object] = {"state": "STARTING"} if self.status is None else _fields(self.status)
        return {**self._status_extra(), **core, "t_ns": self._clock.now_ns()}

    @property
    def holding(self) -> str:
        """What a hold does now, in words where there is nothing to be held."""
        now = self.status
        busy = now is not None and (now.active is not None or now.goto is not None)
        return "hold" if busy else "hold: nothing is locked; no request, patrol or way home begins until `release`"

    def on_status(self, arrival: Arrival) -> None:
        """``status``: the newest."""
        if arrival.query is not None:
            self._replies.reply(
                arrival.query, self._keys.full("status"), msgspec.json.encode(self.status_document()), "Status"
            )

    def on_pose(self, arrival: Arrival) -> None:
        """``pose``: the newest."""
        if arrival.query is None:
            return
        if self.pose is None:
            self._replies.refuse(
                arrival.query, ErrorReply(code="unavailable", message="the head has not said yet where it looks")
            )
            return
        self._replies.reply(arrival.query, self._keys.full("pose"), msgspec.json.encode(self.pose), "Pose")

    def on_image(self, key: str) -> Handler:
        """Handler of ``image/…``: the newest picture, for those who ask instead of listening."""

        def handle(arrival: Arrival) -> None:
            query = arrival.query
            if query is None:
                return
            if not arrival.key.endswith(f"/{key}"):
                self._replies.drop(query)
                return
            token = self._pending.add(query, self._keys.full(key))
            if token is None:
                self._replies.refuse(query, BUSY)
            else:
                self._start(self._show(token, key))

        return handle

    def on_result(self, arrival: Arrival) -> None:
        """``roi/<id>/result``: the kept one; with a wildcard all that fit."""
        if arrival.query is None:
            return
        request_id = request_id_of(arrival.key, "result")
        now_ns = self._clock.now_ns()
        if request_id is None:
            self._reply_fitting(arrival.query, now_ns)
            return
        kept = self._results.get(request_id, now_ns)
        if kept is not None:
            self._replies.reply(arrival.query, self._keys.of_request(request_id, "result"), kept, "RoiResult")
            return
        message = f"no result of {request_id} is kept: it has not ended, ended long ago, or was never asked for"
        self._replies.refuse(arrival.query, ErrorReply(code="unknown_id", message=message))

    def on_calibration(self, arrival: Arrival) -> None:
        """``calibration``: the loaded one."""
        if arrival.query is None:
            return
        if self.calibration is None:
            self._replies.refuse(arrival.query, ErrorReply(code="unavailable", message="no calibration is loaded"))
            return
        self._replies.reply(
            arrival.query, self._keys.full("calibration"), msgspec.json.encode(self.calibration), "Calibration"
        )

    def on_log(self, arrival: Arrival) -> None:
        """``log``: list the closed files, or cut the current one."""
        query = arrival.query
        if query is None:
            return
        try:
            action = self._log_action(arrival)
        except RequestRefused as error:
            self._replies.refuse(query, ErrorReply(code=error.code, message=error.message, field=error.field))
            return
        token = self._pending.add(query, self._keys.full("log"))
        if token is None:
            self._replies.refuse(query, BUSY)
            return
        self._start(self._ask_log(token, action))

    def _start(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _show(self, token: int, key: str) -> None:
        shown = None if self.image_handler is None else await self.image_handler(key)
        if shown is None:
            self._pending.refuse(token, ErrorReply(code="unavailable", message=f"there is no picture for {key} yet"))
        else:
            self._pending.reply_image(token, *shown)

    async def close(self) -> None:
        """Give up questions to the log that are under way."""
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def _log_action(self, arrival: Arrival) -> Literal["list", "rotate"]:
        request = decode(arrival.payload, LogRequest) if arrival.payload else LogRequest()
        if request.action == "rotate" and not arrival.key.endswith("/log"):
            message = "name the log by its whole key to cut its file"
            raise RequestRefused("invalid", message, "$.action")
        if self.log_handler is None:
            raise RequestRefused("unavailable", "this daemon writes no log")
        return request.action

    async def _ask_log(self, token: int, action: Literal["list", "rotate"]) -> None:
        assert self.log_handler is not None
        try:
            files = await self.log_handler(action)
        except PtzdError as error:
            self._pending.refuse(token, ErrorReply(code="failed", message=str(error)))
            return
        self._pending.reply(token, LogReply(files=tuple(files)))

    def _reply_fitting(self, query: zenoh.Query, now_ns: int) -> None:
        """The newest results that a wildcard names; somebody who asks for all of them waits for his turn."""
        if self._looking >= LOOKERS:
            self._replies.refuse(query, BUSY)
            return
        self._looking += 1
        kept = tuple(self._results.all(now_ns))
        self._replies.send(query, lambda query: self._send_fitting(query, kept))

    def _send_fitting(self, query: zenoh.Query, kept: Sequence[tuple[str, bytes]]) -> None:
        """In the thread of the replies."""
        try:
            with query:
                wanted, sent = query.key_expr, 0
                for request_id, payload in reversed(kept):
                    key = self._keys.of_request(request_id, "result")
                    if wanted.intersects(zenoh.KeyExpr(key)):
                        query.reply(key, payload, encoding=encoding("RoiResult"))
                        sent += 1
                    if sent == MOST_RESULTS:
                        break
        finally:
            self._looking -= 1


def _fields(status: PublishStatus) -> dict[str, object]:
    return {
        "state": status.state,
        "phase": status.phase,
        "active": status.active,
        "queue": status.queue,
        "fisheye": status.fisheye,
        "ptz": status.ptz,
        "held": status.held,
        "shadow": status.shadow,
        "doubt": status.doubt,
        "lease": status.lease,
        "goto": status.goto,
        "patrol": status.patrol,
        **({} if status.home_after is None else {"home_after": status.home_after}),
    }


def operators_reply(reply: ReplyLease | ReplyMove | ReplyGoto | ReplyPatrol | ReplyHomeAfter) -> Outgoing:
    """What whoever operates the rig is answered."""
    match reply:
        case ReplyLease():
            return LeaseReply(lease=reply.lease)
        case ReplyGoto():
            return _goto_reply(reply)
        case ReplyPatrol():
            return PatrolReply(patrol=reply.patrol)
        case ReplyHomeAfter():
            return HomeAfterReply(after_s=reply.after_s)
        case _:
            return _move_reply(reply)


def _goto_reply(reply: ReplyGoto) -> GotoReply:
    """The head is there, as the bus tells it."""
    pose = reply.pose
    return GotoReply(
        place=reply.place, pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom, hfov_deg=reply.hfov_deg
    )


def _move_reply(move: ReplyMove) -> MoveReply:
    """What a hand does, as the bus tells it."""
    if (lens := move.lens) is not None:
        return MoveReply(focus=_said(lens.focus), iris=_said(lens.iris))
    if move.pose is None:
        return MoveReply(
            pan_deg_s=move.pan_deg_s, tilt_deg_s=move.tilt_deg_s, zoom_rate=move.zoom_rate, slowed_by=move.slowed_by
        )
    pose = move.pose
    return MoveReply(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom, hfov_deg=move.hfov_deg)


def _said(value: int | None) -> int | Literal["auto"] | None:
    return "auto" if value == AUTOMATIC else value
