"""The daemon's end of the bus: fulfils :class:`ptzd.ports.Bus` with a Zenoh session."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import AsyncExitStack
from types import TracebackType
from typing import Self, cast

import msgspec
import zenoh

from ptzd.bus.answers import Answers, ImageHandler, LogHandler, operators_reply
from ptzd.bus.arrivals import Arrivals
from ptzd.bus.core_handlers import CoreHandlers
from ptzd.bus.event_queue import EventQueue, Moving
from ptzd.bus.fields import Plain
from ptzd.bus.images import ImagePublisher
from ptzd.bus.keys import IMAGE_KEYS, Keys
from ptzd.bus.known_ranges import RangesReply
from ptzd.bus.messages import (
    Accepted,
    CancelReply,
    ControlReply,
    ErrorReply,
    Feedback,
    LogReference,
    RoiResult,
    UpdateReply,
    encoding,
)
from ptzd.bus.pending_queries import PendingQueries
from ptzd.bus.replies import Replies
from ptzd.bus.results import KeptResults
from ptzd.bus.session import close_session, daemon_config, open_session, provide_threads, refuse_a_second
from ptzd.bus.strays import Strays
from ptzd.config import BusSettings
from ptzd.control.commands import (
    Command,
    PublishFeedback,
    PublishResult,
    PublishStatus,
    ReplyAccepted,
    ReplyGoto,
    ReplyHomeAfter,
    ReplyLease,
    ReplyMove,
    ReplyOutcome,
    ReplyPatrol,
    ReplyRanges,
    ReplyRefused,
)
from ptzd.control.events import (
    CancelReceived,
    Event,
    PayloadRefused,
    RangesAsked,
    UpdateReceived,
    Verb,
)
from ptzd.control.wording import scaled
from ptzd.model import REFUSED
from ptzd.outgoing import ImageAttachment, Pose
from ptzd.ports import Clock

LOGGER = logging.getLogger(__name__)

ANSWER_WITHIN_S = 2.0
"""Latest answer to a query, as interface.md promises."""
STATUS_EVERY_S = 1.0
DROPPED_TOLD_NS = 10_000_000_000
"""Between two lines about messages that found no room."""
PENDING_LIMIT = 256
"""Queries that may wait for their answer at once."""


class ZenohBus:
    """The rig on the bus.

    Parameters
    ----------
    settings : BusSettings
        Prefix, mode, endpoints.
    rig_name : str
        Name of the rig, one key chunk.
    clock : Clock
        Stamps what comes in and goes out.
    results_kept_s : float
        How long results are kept for those who ask late, s.
    log_reference : Callable[[], LogReference | None]
        Where the log stands; goes into results.
    status_extra : Callable[[], Mapping[str, object]]
        Fields of ``Status`` that the core does not know (devices, pose, log, versions); called at least every second.
    """

    def __init__(
        self,
        settings: BusSettings,
        rig_name: str,
        clock: Clock,
        *,
        results_kept_s: float = 600.0,
        log_reference: Callable[[], LogReference | None] = lambda: None,
        status_extra: Callable[[], Mapping[str, object]] = dict,
    ) -> None:
        self._settings = settings
        self._keys = Keys(settings.prefix, rig_name)
        self._clock = clock
        self._results = KeptResults(results_kept_s)
        self._log_reference = log_reference
        self._status_extra = status_extra
        self._metric = True
        self._dropped_told = 0
        self._tell_dropped_ns = 0

    async def __aenter__(self) -> Self:
        """Open the session, declare the keys, show the rig as alive.

        Raises
        ------
        BusError
            When the address is taken, Zenoh cannot open, or a rig of this name is alive there already.
        ConfigError
            When Zenoh refuses a setting.
        """
        config = daemon_config(self._settings)
        provide_threads()
        self._session = await open_session(config, f"bus: cannot open {', '.join(self._settings.listen)}")
        self._replies = Replies()
        self._pending = PendingQueries(asyncio.get_running_loop(), PENDING_LIMIT, ANSWER_WITHIN_S, self._replies)
        self._events = EventQueue(self._still_wanted)
        self._core_handlers = CoreHandlers(self._keys, self._pending, self._events, self._replies)
        self._answers = Answers(
            self._keys, self._clock, self._pending, self._results, self._status_extra, self._replies
        )
        async with AsyncExitStack() as opened:
            opened.push_async_callback(close_session, self._session)
            opened.push_async_callback(asyncio.to_thread, self._replies.close)
            if self._settings.connect:
                await refuse_a_second(self._session, self._keys.full("alive"))
            self._images = ImagePublisher(self._session, self._keys)
            self._images.start()
            opened.push_async_callback(asyncio.to_thread, self._images.stop)
            self._arrivals = self._declare()
            self._alive = self._session.liveliness().declare_token(self._keys.full("alive"))
            self._opened = opened.pop_all()
        self._reading = [self._run(arrivals.run()) for arrivals in self._arrivals]
        self._beating = self._run(self._repeat_status())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Withdraw, answer everybody who waits, close."""
        self._alive.undeclare()  # type: ignore[no-untyped-call]  # untyped in the stub
        for arrivals in self._arrivals:
            arrivals.undeclare()
        self._events.close()
        self._beating.cancel()
        await asyncio.gather(self._beating, *self._reading, return_exceptions=True)
        await self._answers.close()
        self._pending.close()
        self._put("status", {**self._answers.status_document(), "state": "STOPPING"}, "Status")
        await self._opened.aclose()

    def events(self) -> AsyncIterator[Event]:
        """What came in, in order of arrival; ends when the bus is closed."""
        return aiter(self._events)

    def perform(self, command: Command) -> None:
        """Reply or publish; returns at once.

        Raises
        ------
        TypeError
            For a command that is not the bus's.
        """
        match command:
            case ReplyAccepted():
                accepted = Accepted(id=command.id, frame=command.frame, position=command.position)
                self._pending.reply(command.token, accepted)
            case ReplyRefused():
                error = ErrorReply(code=command.code, message=command.message, field=command.field)
                if command.token is not None:
                    self._pending.refuse(command.token, error)
            case ReplyOutcome():
                leaf = (self._pending.key_of(command.token) or "").rpartition("/")[2]
                outcome = {"cancel": CancelReply, "update": UpdateReply}.get(leaf, ControlReply)
                said = self._answers.holding if (leaf, command.outcome) == ("hold", Verb.HOLD) else command.outcome
                self._pending.reply(command.token, outcome(outcome=said))
            case ReplyLease() | ReplyMove() | ReplyGoto() | ReplyPatrol() | ReplyHomeAfter():
                self._pending.reply(command.token, operators_reply(command))
            case ReplyRanges():
                reply = RangesReply.of(command, self._clock.now_ns(), metric=self._metric)
                self._pending.reply(command.token, reply)
            case PublishFeedback():
                self._publish_feedback(command)
            case PublishResult():
                self._publish_result(command)
            case PublishStatus():
                self._answers.status = command
                self._publish_status()
            case _:
                message = f"the bus does not perform {type(command).__name__}"
                raise TypeError(message)

    def publish_pose(self, pose: Pose) -> None:
        """Tell where the head looks, now and to whoever asks."""
        self._answers.pose = pose
        self._put("pose", pose, "Pose")

    def publish_image(self, key: str, jpeg: bytes, attachment: ImageAttachment) -> None:
        """Offer a picture on ``image/fisheye``, ``image/ptz`` or ``image/overlay``; latest wins, never waits."""
        self._images.offer(key, jpeg, attachment)

    def image_wanted(self, key: str) -> bool:
        """Whether somebody listens to ``image/fisheye``, ``image/ptz`` or ``image/overlay``."""
        return self._images.wanted(key)

    def set_calibration(self, document: Mapping[str, object]) -> None:
        """What a query on ``calibration`` is answered with, and the unit of ranges: the parsed ``rig.yaml``."""
        self._answers.calibration = document
        rig = document.get("rig")
        self._metric = not isinstance(rig, Mapping) or bool(rig.get("metric", True))

    def on_image_query(self, handler: ImageHandler) -> None:
        """Register who has the newest picture of ``image/…`` for those who ask instead of listening."""
        self._answers.image_handler = handler

    def on_log_query(self, handler: LogHandler) -> None:
        """Register who lists (``list``) or cuts (``rotate``) the log; it returns the closed files, oldest first."""
        self._answers.log_handler = handler

    def counters(self) -> dict[str, int]:
        """Messages dropped, queries expired, pictures sent and replaced, since the start."""
        return {
            "dropped": self._core_handlers.dropped + sum(arrivals.dropped for arrivals in self._arrivals),
            "expired": self._pending.expired,
            "images_sent": self._images.sent,
            "images_replaced": self._images.replaced,
        }

    def _declare(self) -> tuple[Arrivals, ...]:
        keys, session = self._keys, self._session
        clock, replies = self._clock, self._replies
        urgent, places = Arrivals(session, 64, clock), Arrivals(session, 64, clock)
        requests = Arrivals(session, 64, clock, crowded=lambda: replies.crowded)
        reads = Arrivals(session, 256, clock, crowded=lambda: replies.crowded)
        updates = Arrivals(session, 64, clock, evict=True)
        for declare in (urgent.answer, urgent.listen):
            declare(keys.of_all_requests("cancel"), self._core_handlers.on_cancel)
            declare(keys.full("control/lease"), self._core_handlers.on_lease)
            declare(keys.full("control/move"), self._core_handlers.on_move)
            for verb in Verb:
                declare(keys.full(f"control/{verb}"), self._core_handlers.on_control(verb))
        for declare in (places.answer, places.listen):
            declare(keys.full("control/goto"), self._core_handlers.on_goto)
            declare(keys.full("control/home_after"), self._core_handlers.on_home_after)
            declare(keys.full("control/patrol"), self._core_handlers.on_patrol)
        for declare in (requests.answer, requests.listen):
            declare(keys.full("control/ranges"), self._core_handlers.on_ranges)
        requests.answer(keys.full("roi"), self._core_handlers.on_request)
        requests.listen(keys.full("roi"), self._core_handlers.on_request)
        requests.answer(keys.of_all_requests("update"), self._core_handlers.on_update)
        updates.listen(keys.of_all_requests("update"), self._core_handlers.on_update)
        reads.answer(keys.full("status"), self._answers.on_status)
        reads.answer(keys.full("pose"), self._answers.on_pose)
        for key in IMAGE_KEYS:
            reads.answer(keys.full(key), self._answers.on_image(key))
        reads.answer(keys.of_all_requests("result"), self._answers.on_result)
        reads.answer(keys.full("calibration"), self._answers.on_calibration)
        reads.answer(keys.full("log"), self._answers.on_log)
        served = (urgent, places, requests, updates, reads)
        answered = frozenset[str]().union(*(arrivals.answered for arrivals in served))
        heard = frozenset[str]().union(*(arrivals.heard for arrivals in served))
        strays = Arrivals(session, 64, clock, crowded=lambda: replies.crowded)
        # not image/…: a listener of these would have the pictures made
        listen = [keys.full(key) for key in ("*", "control/*/**", "roi/*/**")]
        strays.catch(keys.full("**"), listen, Strays(keys, answered, heard, self._core_handlers.tell, replies))
        return *served, strays

    def _still_wanted(self, event: Event) -> bool:
        """An event whose query was told ``internal`` must not take effect any more; an operator's verb always does."""
        if isinstance(event, Moving | PayloadRefused | UpdateReceived | CancelReceived | RangesAsked):
            return event.token is None or self._pending.waits(event.token)
        return True

    def _publish_feedback(self, command: PublishFeedback) -> None:
        detail = cast("dict[str, Plain]", scaled(command.detail, metric=self._metric))
        feedback = Feedback(id=command.id, t_ns=self._clock.now_ns(), step=command.step, detail=detail)
        self._put(f"roi/{command.id}/feedback", feedback, "Feedback")

    def _publish_result(self, command: PublishResult) -> None:
        result = RoiResult.of(command, self._log_reference(), metric=self._metric)
        refused = command.outcome in REFUSED
        self._results.put(command.id, msgspec.json.encode(result), self._clock.now_ns(), refused=refused)
        self._put(f"roi/{command.id}/result", result, "RoiResult")

    def _publish_status(self) -> None:
        self._put("status", self._answers.status_document(), "Status")

    def _run(self, work: Coroutine[None, None, None]) -> asyncio.Task[None]:
        task = asyncio.get_running_loop().create_task(work)
        task.add_done_callback(self._ended)
        return task

    def _ended(self, task: asyncio.Task[None]) -> None:
        """Whoever reads the events hears of a fault in here."""
        if not task.cancelled() and task.exception() is not None:
            self._events.close(task.exception())

    async def _repeat_status(self) -> None:
        while True:
            self._publish_status()
            self._tell_dropped()
            await asyncio.sleep(STATUS_EVERY_S)

    def _tell_dropped(self) -> None:
        """A flood leaves a line now and then, for a put that found no room has no answer."""
        dropped, now_ns = self.counters()["dropped"] - self._dropped_told, self._clock.now_ns()
        if dropped and now_ns >= self._tell_dropped_ns:
            LOGGER.warning("bus: %d messages found no room; queries were told busy, puts are lost: a flood?", dropped)
            self._dropped_told += dropped
            self._tell_dropped_ns = now_ns + DROPPED_TOLD_NS

    def _put(self, key: str, document: object, message: str) -> None:
        # Per-request keys are put on the session: declaring a publisher per id would never be given back by Zenoh.
        self._session.put(
            self._keys.full(key),
            msgspec.json.encode(document),
            encoding=encoding(message),
            # Not express: that spends a batch per message, and a burst of feedback would overflow a busy link's two.
            congestion_control=zenoh.CongestionControl.DROP,
        )
