"""What a client hears. Anybody can put on a key: what is no message is passed over, with a line for the first."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import zenoh
from zenoh.handlers import Callback

from ptzd.bus.asking import decoded
from ptzd.bus.keys import Keys
from ptzd.bus.mailbox import Mailbox
from ptzd.bus.messages import Feedback, RoiResult, Status
from ptzd.errors import BusError
from ptzd.outgoing import ImageAttachment, Pose

Notice = Status | Pose | Feedback | RoiResult
NOTICES_WAITING = 1024
"""Notices that may wait to be read; older ones are dropped."""
_NOTICES: dict[str, type[Notice]] = {"status": Status, "pose": Pose, "feedback": Feedback, "result": RoiResult}
_M = TypeVar("_M")
_log = logging.getLogger("ptzd.bus")


@dataclass(frozen=True, slots=True, kw_only=True)
class BusImage:
    """A picture from the bus."""

    jpeg: bytes
    attachment: ImageAttachment


async def notices(session: zenoh.Session, keys: Keys) -> AsyncIterator[Notice]:
    """Status, pose, feedback and results of all requests of one rig."""
    strange: set[str] = set()
    told = [keys.full("status"), keys.full("pose"), keys.of_all_requests("feedback"), keys.of_all_requests("result")]
    async for sample in _samples(session, told, NOTICES_WAITING):
        leaf = str(sample.key_expr).rpartition("/")[2]
        notice = _readable(sample, sample.payload, _NOTICES[leaf], strange)
        if notice is not None:
            yield notice


async def images(session: zenoh.Session, key: str) -> AsyncIterator[BusImage]:
    """Pictures of one key, the newest always."""
    strange: set[str] = set()
    async for sample in _samples(session, [key], 1):
        attachment = _readable(sample, sample.attachment, ImageAttachment, strange)
        if attachment is not None:
            yield BusImage(jpeg=sample.payload.to_bytes(), attachment=attachment)


async def _samples(session: zenoh.Session, keys: Sequence[str], capacity: int) -> AsyncIterator[zenoh.Sample]:
    mailbox: Mailbox[zenoh.Sample] = Mailbox(asyncio.get_running_loop(), capacity, evict=True)
    subscribers = [session.declare_subscriber(key, Callback(mailbox.push, indirect=False)) for key in keys]
    try:
        while True:
            for sample in await mailbox.take():
                yield sample
    finally:
        for subscriber in subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]  # untyped in the stub


def _readable(sample: zenoh.Sample, payload: zenoh.ZBytes | None, message: type[_M], strange: set[str]) -> _M | None:
    try:
        return decoded(b"" if payload is None else payload.to_bytes(), message)
    except BusError as error:
        kind = message.__name__
        if kind not in strange:
            strange.add(kind)
            _log.warning("on %r: %s; passed over, and further ones without a line", str(sample.key_expr), error)
        return None
