"""Having the head for oneself: taken, kept by a heartbeat, given back."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Awaitable, Callable

from ptzd.bus.messages import LeaseReply, LeaseRequest
from ptzd.errors import BusError, RequestRefused
from ptzd.model import LeaseHeld

RENEW_S = 1.0
"""Between two heartbeats; a rig that hears nothing for ``lease.silence_s`` (5 s) gives the head to who waits."""

Ask = Callable[[LeaseRequest], Awaitable[LeaseReply]]


class KeptLease:
    """A lease that lasts while its context does; see :meth:`ptzd.bus.client.Client.lease`."""

    def __init__(self, ask: Ask, owner: str, held: LeaseHeld) -> None:
        self._ask = ask
        self._owner = owner
        self._over: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self.held = held
        """As the rig told it last."""

    async def over(self) -> str:
        """Wait until it is over before it was given back; returns why."""
        return await asyncio.shield(self._over)

    async def beat(self) -> None:
        """Say that its owner is still there until somebody else says that it is over."""
        while not self._over.done():
            await asyncio.sleep(RENEW_S)
            try:
                reply = await self._ask(LeaseRequest(owner=self._owner, wish="renew"))
            except RequestRefused as error:
                if error.code in {"lost", "leased", "stopping"}:
                    self._over.set_result(error.message)
            except BusError as error:
                self._over.set_result(str(error))
            else:
                self.held = reply.lease or self.held


@contextlib.asynccontextmanager
async def keep(ask: Ask, request: LeaseRequest) -> AsyncIterator[KeptLease]:
    """Take the lease, renew it while the context lasts, give it back at its end.

    Raises
    ------
    RequestRefused
        ``leased`` with who has it.
    """
    reply = await ask(request)
    if reply.lease is None:
        raise BusError("bus: the rig took the question for a lease and told of none")
    kept = KeptLease(ask, request.owner, reply.lease)
    beating = asyncio.ensure_future(kept.beat())
    try:
        yield kept
    finally:
        beating.cancel()
        await asyncio.gather(beating, return_exceptions=True)
        with contextlib.suppress(RequestRefused, BusError):  # over already, or the rig is gone: nothing is left to give
            await ask(LeaseRequest(owner=request.owner, wish="give"))
