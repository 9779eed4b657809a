"""Ask a rig to look at something: the library for other apps.

::

    async with Client.open("tcp/127.0.0.1:7447", rig="hall") as client:
        accepted = await client.request(box=(310, 220, 40, 32), hold_s=10)
        async for step in client.feedback(accepted.id):
            print(step.step, step.detail)
        result = await client.result(accepted.id)

Whoever cannot use Python needs no more than a Zenoh client and JSON: ``ptzd schema`` prints the schemas.
"""

from __future__ import annotations

import asyncio
import math
import secrets
from collections.abc import AsyncIterator, Sequence
from types import TracebackType
from typing import Literal

from ptzd.bus.asking import ask_one
from ptzd.bus.connection import OperatedConnection, check_time
from ptzd.bus.encode import encode
from ptzd.bus.fields import BoxPx
from ptzd.bus.following import Following
from ptzd.bus.keys import Keys, check_id
from ptzd.bus.listening import BusImage, Notice, images, notices
from ptzd.bus.messages import (
    Accepted,
    CancelReply,
    Empty,
    Feedback,
    FrameName,
    LogReply,
    LogRequest,
    RangeM,
    RoiRequest,
    RoiResult,
    RoiUpdate,
    Status,
    ZoomTo,
)
from ptzd.errors import BusError, RequestRefused

BoxLike = BoxPx | tuple[float, float, float, float]
"""A box, or its x, y, w, h in px of the fisheye picture."""
ImageKey = Literal["fisheye", "ptz", "overlay"]

RESYNC_S = 2.0
"""A published result can get lost on the way: while waiting for one, the kept one is asked for this often."""
ENDED_KEPT = 256
"""Requests that have ended and whose result is remembered here."""


class Client(OperatedConnection):
    """A connection to one rig, as :class:`~ptzd.bus.connection.Connection`."""

    def __init__(
        self, connect: Sequence[str], rig: str | None, prefix: str, config_file: str | None, timeout_s: float
    ) -> None:
        super().__init__(connect, rig, prefix, config_file, timeout_s)
        self._following: dict[str, Following] = {}

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; requests under way go on without us."""
        for following in self._following.values():
            following.end()
        await super().__aexit__(kind, error, trace)

    async def request(
        self,
        *,
        box: BoxLike,
        id: str | None = None,
        frame_seq: int | None = None,
        frame_t_capture_ns: int | None = None,
        range_m: tuple[float, float | None] | None = None,
        zoom: Literal["fit", "keep"] | float = "fit",
        fill: float | None = None,
        hold_s: float | None = None,
        timeout_s: float | None = None,
        priority: int = 0,
        label: str = "",
        by: str = "",
    ) -> Accepted:
        """Ask the rig to look at a box.

        Parameters
        ----------
        box : BoxPx or (x, y, w, h)
            Region of the fisheye picture, px.
        id : str
            Chosen by the caller, 1 to 64 of ``A-Za-z0-9._-``; the same again is the same request. Default: random.
        frame_seq, frame_t_capture_ns : int
            The frame the box was drawn on, by one of the two; default: the newest.
        range_m : (float, float or None)
            Nearest and farthest distance, m (baselines on a rig without scale); None or inf as the farthest: no end.
        zoom : str or float
            ``fit``, ``keep``, or a horizontal field of view in degrees.
        fill : float
            Share of the PTZ frame to fill, 0.05 to 0.95.
        hold_s, timeout_s : float
            How long to hold the lock, and how long to try, s.
        priority : int
            0 to 9, higher goes first.
        label : str
            Free text, at most 64 characters.
        by : str
            Who asks; whoever has the lease is served under it.

        Raises
        ------
        RequestRefused
            With code and field; nothing moves.
        BusError
            When nobody answers.
        """
        request = RoiRequest(
            id=secrets.token_hex(8) if id is None else id,
            box=_box(box),
            frame=_frame(frame_seq, frame_t_capture_ns),
            range_m=_range(range_m) if range_m else None,
            zoom=zoom if isinstance(zoom, str) else ZoomTo(hfov_deg=zoom),
            fill=fill,
            hold_s=hold_s,
            timeout_s=timeout_s,
            priority=priority,
            label=label,
            by=by,
        )
        check_id(request.id)
        message = encode(request)
        known = request.id in self._following
        keys = await self._keys()
        self._follow(keys, request.id)
        try:
            return await ask_one(self._session, keys.full("roi"), Accepted, self._timeout_s, message)
        except (BusError, RequestRefused):
            if not known:
                self._following.pop(request.id).end()
            raise

    async def feedback(self, request_id: str) -> AsyncIterator[Feedback]:
        """Steps of a request as they come, until it has its result.

        Steps before the first interest in an id that this client has not requested itself are not seen.
        """
        following = await self._follow_asking(request_id)
        while not following.result.done():
            steps = await following.steps(RESYNC_S)
            for step in steps:
                yield step
            if not steps:
                await self._resync(following)
        for step in await following.steps(0):
            yield step

    async def result(self, request_id: str, timeout_s: float | None = None) -> RoiResult:
        """The one result of a request, also of one that ended up to ten minutes ago.

        Parameters
        ----------
        request_id : str
            The id.
        timeout_s : float or None
            Longest wait, s; None waits as long as the daemon is there.

        Raises
        ------
        RequestRefused
            When the id or the time is none.
        BusError
            When there is no result in time, or the daemon has gone.
        """
        if timeout_s is not None:
            check_time("timeout_s", timeout_s)
        try:
            async with asyncio.timeout(timeout_s):
                following = await self._follow_asking(request_id)
                while not following.result.done():
                    await asyncio.wait([following.result], timeout=RESYNC_S)
                    await self._resync(following)
                return following.result.result()
        except TimeoutError:
            raise BusError(f"no result of {request_id} within {timeout_s:g} s; it may still come: ask again") from None

    async def cancel(self, request_id: str) -> str:
        """Take a request back; returns what became of it.

        Raises
        ------
        RequestRefused
            ``unknown_id`` when there is no such request.
        """
        key = (await self._keys()).of_request(request_id, "cancel")
        return (await ask_one(self._session, key, CancelReply, self._timeout_s, encode(Empty()))).outcome

    async def update(
        self,
        request_id: str,
        box: BoxLike,
        *,
        frame_seq: int | None = None,
        frame_t_capture_ns: int | None = None,
    ) -> None:
        """Tell where the target of a request is now; sent without an answer.

        Raises
        ------
        RequestRefused
            When the id or the box is none.
        """
        update = encode(RoiUpdate(box=_box(box), frame=_frame(frame_seq, frame_t_capture_ns)))
        key = (await self._keys()).of_request(request_id, "update")
        self._session.put(key, update.payload, encoding=update.encoding, express=True)

    async def status(self) -> Status:
        """The newest status."""
        return await ask_one(self._session, (await self._keys()).full("status"), Status, self._timeout_s)

    async def calibration(self) -> dict[str, object]:
        """The loaded calibration, as in ``rig.yaml``."""
        key = (await self._keys()).full("calibration")
        return await ask_one(self._session, key, dict[str, object], self._timeout_s)

    async def log_files(self, *, rotate: bool = False) -> tuple[str, ...]:
        """Closed log files, oldest first; with ``rotate`` the current one is closed before."""
        wish = encode(LogRequest(action="rotate" if rotate else "list"))
        key = (await self._keys()).full("log")
        return (await ask_one(self._session, key, LogReply, self._timeout_s, wish)).files

    async def watch(self) -> AsyncIterator[Notice]:
        """Everything the rig says from now on: status, pose, feedback and results of all requests."""
        async for notice in notices(self._session, await self._keys()):
            yield notice

    async def images(self, key: ImageKey) -> AsyncIterator[BusImage]:
        """Pictures as they come; one that is not fetched in time is replaced by the next."""
        async for image in images(self._session, (await self._keys()).full(f"image/{key}")):
            yield image

    def _follow(self, keys: Keys, request_id: str) -> Following:
        if request_id not in self._following:
            ended = [known for known, following in self._following.items() if following.result.done()]
            for known in ended[:-ENDED_KEPT]:
                del self._following[known]
            self._following[request_id] = Following(self._session, keys, request_id)
        return self._following[request_id]

    async def _follow_asking(self, request_id: str) -> Following:
        known = request_id in self._following
        following = self._follow(await self._keys(), request_id)
        if not known:
            await self._resync(following)
        return following

    async def _resync(self, following: Following) -> None:
        if following.result.done():
            return
        try:
            result = await ask_one(self._session, following.result_key, RoiResult, self._timeout_s)
        except RequestRefused:
            return
        following.settle(result)


def _box(box: BoxLike) -> BoxPx:
    return box if isinstance(box, BoxPx) else BoxPx(x=box[0], y=box[1], w=box[2], h=box[3])


def _frame(seq: int | None, t_capture_ns: int | None) -> FrameName | None:
    return None if seq is None and t_capture_ns is None else FrameName(seq=seq, t_capture_ns=t_capture_ns)


def _range(nearest_farthest: tuple[float, float | None]) -> RangeM:
    nearest, farthest = nearest_farthest
    return RangeM(min=nearest, max=None if farthest == math.inf else farthest)
