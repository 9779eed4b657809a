"""A connection to one rig, and what an operator asks of it: stop, home, the lease, moves by hand."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from types import TracebackType
from typing import Literal, Self

from ptzd.bus.asking import ask, ask_one, rigs_alive, rigs_answering
from ptzd.bus.by_hand import MoveReply, MoveRequest
from ptzd.bus.encode import encode
from ptzd.bus.keys import ANY_RIG, Keys, check_id
from ptzd.bus.known_ranges import RangesReply, RangesRequest
from ptzd.bus.leasing import KeptLease, keep
from ptzd.bus.messages import ControlReply, Empty, LeaseReply, LeaseRequest
from ptzd.bus.places import GotoReply, GotoRequest, HomeAfterReply, HomeAfterRequest, PatrolReply, PatrolRequest
from ptzd.bus.session import client_config, close_session, open_session
from ptzd.errors import BusError, RequestRefused
from ptzd.model import PatrolShown

GOTO_WAIT_S = 32.0
"""The rig answers within 30 s: the slowest head needs 15."""
PatrolWish = Literal["start", "pause", "resume", "stop"]
Verb = Literal["home", "stop", "hold", "release"]


def check_time(name: str, time_s: float) -> None:
    """Refuse a wait that has no end or is none: timers would take it and never, or at once, go off.

    Raises
    ------
    RequestRefused
        With the time.
    """
    if not (time_s > 0 and math.isfinite(time_s)):
        raise RequestRefused("invalid", f"{name} {time_s:g}: must be a finite number of seconds above 0", name)


class Connection:
    """A connection to one rig.

    Parameters
    ----------
    connect : sequence of str
        Zenoh endpoints of the daemon or a router.
    rig : str or None
        Name of the rig; None takes the only one alive.
    prefix : str
        As in the daemon's settings.
    config_file : str or None
        Zenoh JSON5 file with certificates and the like.
    timeout_s : float
        How long to wait for the answer to a question, s.

    Raises
    ------
    RequestRefused
        When the time is none.
    """

    def __init__(
        self, connect: Sequence[str], rig: str | None, prefix: str, config_file: str | None, timeout_s: float
    ) -> None:
        self._connect = tuple(connect)
        self._rig = rig
        self._prefix = prefix
        self._config_file = config_file
        check_time("timeout_s", timeout_s)
        self._timeout_s = timeout_s

    @classmethod
    def open(
        cls,
        connect: str | Sequence[str] = "tcp/127.0.0.1:7447",
        *,
        rig: str | None = None,
        prefix: str = "ptzd",
        config_file: str | None = None,
        timeout_s: float = 3.0,
    ) -> Self:
        """Prepare a client; ``async with`` connects.

        Parameters
        ----------
        connect, rig, prefix, config_file, timeout_s
            See the class.
        """
        return cls((connect,) if isinstance(connect, str) else connect, rig, prefix, config_file, timeout_s)

    async def __aenter__(self) -> Self:
        """Connect.

        Raises
        ------
        BusError
            When nobody listens at the address.
        """
        config = client_config(self._connect, self._config_file)
        self._session = await open_session(config, f"bus: cannot connect to {', '.join(self._connect)}")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect; requests under way go on without us."""
        await close_session(self._session)

    async def rigs(self) -> list[str]:
        """Names of the rigs alive, sorted."""
        return await rigs_alive(self._session, self._prefix, self._timeout_s)

    async def _keys(self) -> Keys:
        if self._rig == ANY_RIG:
            raise RequestRefused("invalid", "rig '*': name one rig; `ptzd ls` lists those alive", "rig")
        if self._rig is None:
            alive = await self.rigs()
            if len(alive) > 1:
                alive = await rigs_answering(self._session, self._prefix, self._timeout_s) or alive
            if len(alive) != 1:
                found = f"there are {', '.join(alive)}; name one" if alive else "no rig is alive there"
                raise BusError(f"bus: {self._prefix}/* on {', '.join(self._connect)}: {found}")
            self._rig = alive[0]
        return Keys(self._prefix, self._rig)


class OperatedConnection(Connection):
    """What whoever operates the rig asks of it."""

    async def control(self, verb: Verb) -> str:
        """Operator's verb: ``home``, ``stop``, ``hold`` or ``release``; returns what it did.

        A stop by a client that names no rig goes to every rig there, so that nothing need be found out before it.
        """
        if verb == "stop" and self._rig is None:
            with contextlib.suppress(BusError):  # nobody may ask all rigs at once; then the one that is there
                everywhere = Keys(self._prefix, ANY_RIG).full("control/stop")
                stopped = await ask(self._session, everywhere, ControlReply, self._timeout_s, encode(Empty()))
                return ", ".join(sorted({reply.outcome for _, reply in stopped}))
        key = (await self._keys()).full(f"control/{verb}")
        return (await ask_one(self._session, key, ControlReply, self._timeout_s, encode(Empty()))).outcome

    def lease(
        self, owner: str, *, for_s: float | None = None, rank: int = 0
    ) -> contextlib.AbstractAsyncContextManager[KeptLease]:
        """Have the head for oneself while the context lasts; what is asked ``by`` the owner is done meanwhile.

        Parameters
        ----------
        owner : str
            Who, 1 to 64 of ``A-Za-z0-9._-``.
        for_s : float
            At most so long, s; default: as long as the rig allows.
        rank : int
            0 to 8; a higher one takes the head from a lower one.

        Raises
        ------
        RequestRefused
            On entry: ``leased`` with who has it and how long.
        """
        return keep(self.ask_lease, self.move, LeaseRequest(owner=owner, for_s=for_s, rank=rank))

    async def ask_lease(self, request: LeaseRequest) -> LeaseReply:
        """One wish on the lease: take, renew, give, or ask whoever has it; returns the lease as it is then."""
        check_id(request.owner)
        message = encode(request)
        key = (await self._keys()).full("control/lease")
        return await ask_one(self._session, key, LeaseReply, self._timeout_s, message)

    async def goto(self, place: str, *, by: str = "", hold_s: float | None = None) -> GotoReply:
        """Send the head to a named place; returns when it is there.

        Parameters
        ----------
        place : str
            As in ``presets.yaml``.
        by : str
            Who asks; where somebody has the head for himself, he alone may.
        hold_s : float
            How long it stays there before what waits goes on, s; default: as the rig's settings say.

        Raises
        ------
        RequestRefused
            ``unknown_place`` with the nearest names, ``unreachable``, ``leased``, ``device_lost``; ``preempted`` or
            ``cancelled`` when something else has the head before it is there.
        """
        request = encode(GotoRequest(place=place, by=by, hold_s=hold_s))
        key = (await self._keys()).full("control/goto")
        return await ask_one(self._session, key, GotoReply, max(self._timeout_s, GOTO_WAIT_S), request)

    async def ranges(self, request: RangesRequest | None = None) -> RangesReply:
        """What locks have taught of the scene's ranges, after forgetting what the request says."""
        asked = encode(request or RangesRequest())
        key = (await self._keys()).full("control/ranges")
        return await ask_one(self._session, key, RangesReply, self._timeout_s, asked)

    async def patrol(self, wish: PatrolWish, patrol: str = "") -> PatrolShown | None:
        """Begin a patrol, let it rest, go on or end; returns how it stands then, None when none is under way.

        Parameters
        ----------
        wish : str
            ``start``, ``pause``, ``resume`` or ``stop``.
        patrol : str
            Which one begins, as in ``presets.yaml``; the other wishes may name the one that is meant.

        Raises
        ------
        RequestRefused
            ``unknown_patrol`` with the nearest names, ``unreachable`` with the place, ``no_patrol``.
        """
        request = encode(PatrolRequest(wish=wish, patrol=patrol))
        key = (await self._keys()).full("control/patrol")
        return (await ask_one(self._session, key, PatrolReply, self._timeout_s, request)).patrol

    async def home_after(self, after_s: float | Literal["never", "settings"]) -> float | None:
        """Say how long the head is left where it is before it goes home; returns what holds then, None for never.

        It holds until the daemon ends, or until its settings are read again with another ``home.idle_s``.
        """
        request = encode(HomeAfterRequest(after_s=after_s))
        key = (await self._keys()).full("control/home_after")
        return (await ask_one(self._session, key, HomeAfterReply, self._timeout_s, request)).after_s

    async def move(self, request: MoveRequest) -> MoveReply:
        """One move of whoever has the lease; `KeptLease` has a method for each kind."""
        check_id(request.owner)
        message = encode(request)
        key = (await self._keys()).full("control/move")
        return await ask_one(self._session, key, MoveReply, self._timeout_s, message)
