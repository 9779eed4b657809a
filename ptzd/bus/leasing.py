"""Having the head for oneself: taken, kept by a heartbeat, given back."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable

from ptzd.bus.by_hand import Auto, LensWanted, MoveReply, MoveRequest, PanTilt, PixelPtz, Speed, Step, ViewPose
from ptzd.bus.fields import BoxPx
from ptzd.bus.messages import LeaseReply, LeaseRequest
from ptzd.errors import BusError, RequestRefused
from ptzd.model import LeaseHeld

RENEW_S = 1.0
"""Between two heartbeats; a rig that hears nothing for ``lease.silence_s`` (5 s) gives the head to who waits."""


Ask = Callable[[LeaseRequest], Awaitable[LeaseReply]]
Move = Callable[[MoveRequest], Awaitable[MoveReply]]


class KeptLease:
    """A lease that lasts while its context does; see :meth:`ptzd.bus.client.Client.lease`."""

    def __init__(self, ask: Ask, move: Move, owner: str, held: LeaseHeld, for_s: float | None) -> None:
        self._ask = ask
        self._move = move
        self._owner = owner
        loop = asyncio.get_running_loop()
        self._over: asyncio.Future[str] = loop.create_future()
        # by this clock, which is not the rig's: no sooner than there, and as long as the rig allows at most
        self._ends_s = loop.time() + ((held.until_ns - held.since_ns) / 1e9 if for_s is None else for_s)
        self.held = held
        """As the rig told it last."""

    async def over(self) -> str:
        """Wait until it is over before it was given back; returns why."""
        return await asyncio.shield(self._over)

    async def go_to(self, pan_deg: float, tilt_deg: float, *, hfov_deg: float | None = None) -> MoveReply:
        """Point the head at angles of the calibrated head frame; returns at once with where it goes.

        Raises
        ------
        RequestRefused
            ``unreachable`` with the limits; ``lost`` or ``leased`` when the lease is over. The same for all below.
        """
        to = PanTilt(pan_deg=pan_deg, tilt_deg=tilt_deg)
        return await self._move(MoveRequest(owner=self._owner, to=to, hfov_deg=hfov_deg))

    async def go_by(self, pan_deg: float, tilt_deg: float, *, hfov_deg: float | None = None) -> MoveReply:
        """Turn the head by so much from where it is, or is going."""
        by = Step(pan_deg=pan_deg, tilt_deg=tilt_deg)
        return await self._move(MoveRequest(owner=self._owner, by=by, hfov_deg=hfov_deg))

    async def centre(
        self, x: float, y: float, *, picture: ViewPose | None = None, hfov_deg: float | None = None
    ) -> MoveReply:
        """Bring a pixel of the PTZ's picture to the centre; ``picture``: its pose, from the picture's attachment."""
        point = PixelPtz(x=x, y=y)
        return await self._move(MoveRequest(owner=self._owner, point=point, picture=picture, hfov_deg=hfov_deg))

    async def frame(
        self, box: tuple[float, float, float, float], *, picture: ViewPose | None = None, fill: float | None = None
    ) -> MoveReply:
        """Centre a rectangle (x, y, w, h, px) of the PTZ's picture and zoom until it fills it."""
        x, y, w, h = box
        request = MoveRequest(owner=self._owner, box=BoxPx(x=x, y=y, w=w, h=h), picture=picture, fill=fill)
        return await self._move(request)

    async def steer(self, pan_deg_s: float = 0.0, tilt_deg_s: float = 0.0, zoom_rate: float = 0.0) -> MoveReply:
        """Turn and zoom at this speed for 0.3 s: say it again, ten times a second, for as long as it is to last."""
        speed = Speed(pan_deg_s=pan_deg_s, tilt_deg_s=tilt_deg_s, zoom_rate=zoom_rate)
        return await self._move(MoveRequest(owner=self._owner, speed=speed))

    async def lens(self, *, focus: int | Auto | None = None, iris: int | Auto | None = None) -> MoveReply:
        """Set focus and iris by hand, or ``"auto"``; until the end of the lease. Returns when the camera took it."""
        return await self._move(MoveRequest(owner=self._owner, lens=LensWanted(focus=focus, iris=iris)))

    @property
    def is_over(self) -> bool:
        """Whether it was over before it was given back."""
        return self._over.done()

    async def beat(self) -> None:
        """Say that its owner is still there until its time, or somebody else, says that it is over."""
        loop = asyncio.get_running_loop()
        while not self._over.done():
            left_s = self._ends_s - loop.time()
            await asyncio.sleep(max(min(RENEW_S, left_s), 0.0))
            if left_s <= RENEW_S:
                # the rig's own end came when this lease's answer was on its way, or before: it is no more to be renewed
                self._over.set_result(f"the time of {self._owner} is over")
                return
            try:
                reply = await self._ask(LeaseRequest(owner=self._owner, wish="renew"))
            except RequestRefused as error:
                if error.code in {"lost", "leased", "stopping"}:
                    self._over.set_result(error.message)
            except BusError as error:
                self._over.set_result(str(error))
            else:
                self._hear(reply.lease or self.held)

    def _hear(self, held: LeaseHeld) -> None:
        """Its end may have moved: whoever has it can take it once more."""
        self._ends_s += (held.until_ns - self.held.until_ns) / 1e9
        self.held = held


@contextlib.asynccontextmanager
async def keep(ask: Ask, move: Move, request: LeaseRequest) -> AsyncIterator[KeptLease]:
    """Take the lease, renew it while the context lasts, give it back at its end.

    Raises
    ------
    RequestRefused
        ``leased`` with who has it.
    """
    reply = await ask(request)
    if reply.lease is None:
        raise BusError("bus: the rig took the question for a lease and told of none")
    kept = KeptLease(ask, move, request.owner, reply.lease, request.for_s)
    beating = asyncio.ensure_future(kept.beat())
    try:
        yield kept
    finally:
        beating.cancel()
        await asyncio.gather(beating, return_exceptions=True)
        if not kept.is_over:
            with contextlib.suppress(RequestRefused, BusError):  # over just now, or the rig is gone: nothing to give
                await ask(LeaseRequest(owner=request.owner, wish="give"))
