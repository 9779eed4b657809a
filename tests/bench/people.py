"""People beside the apps of a random life: they take the head, move it by hand, give it back or vanish with it."""

from __future__ import annotations

import asyncio
import random
from collections import Counter
from collections.abc import Callable

from ptzd.bus.by_hand import MoveRequest, Speed, ViewPose
from ptzd.bus.client import Client
from ptzd.bus.leasing import KeptLease
from ptzd.bus.messages import LeaseRequest
from ptzd.errors import PtzdError

PEOPLE = ("desk", "gate")
WORDS = 12
"""At ten a second, of a hand that steers."""


class People:
    """Whoever takes the head for himself.

    Parameters
    ----------
    client : Client
        Of the rig.
    chance : random.Random
        What they do.
    done, refused : Counter
        Where it is counted.
    accepted : callable
        Told of every request that was taken on.
    """

    def __init__(
        self,
        client: Client,
        chance: random.Random,
        done: Counter[str],
        refused: Counter[str],
        accepted: Callable[[str], None],
    ) -> None:
        self._client = client
        self._chance = chance
        self._done = done
        self._refused = refused
        self._accepted = accepted

    async def come(self) -> None:
        """Somebody takes the head, or wants it, or vanishes with it."""
        owner, chance = self._chance.choice(PEOPLE), self._chance.random()
        try:
            if chance < 0.15:
                await self._vanish(owner)
                return
            async with self._client.lease(owner, for_s=20.0, rank=self._chance.choice((0, 0, 1))) as hand:
                self._done["lease"] += 1
                for _ in range(self._chance.randint(1, 6)):
                    await self._one(hand, owner)
                    await asyncio.sleep(self._chance.uniform(0.1, 1.0))
        except PtzdError as error:
            self._refused[f"by hand: {getattr(error, 'code', type(error).__name__)}"] += 1

    async def _one(self, hand: KeptLease, owner: str) -> None:
        what = self._chance.choice(("to", "by", "centre", "steer", "steer", "lens", "aim"))
        self._done[f"hand {what}"] += 1
        pan, tilt = self._chance.uniform(-60, 60), self._chance.uniform(-30, 20)
        match what:
            case "to":
                await hand.go_to(pan, tilt, hfov_deg=self._chance.choice((None, 10.0, 40.0)))
            case "by":
                await hand.go_by(pan / 10, tilt / 10)
            case "centre":
                pose = (await self._client.status()).pose
                if pose is not None:
                    seen = ViewPose(pan_deg=pose.pan_deg, tilt_deg=pose.tilt_deg, zoom=pose.zoom)
                    await hand.centre(self._chance.uniform(0, 639), self._chance.uniform(0, 479), picture=seen)
            case "steer":
                await self._steer(hand)
            case "lens":
                await hand.lens(focus=self._chance.choice((1000, 5000)))
            case _:
                accepted = await self._client.request(
                    box=(310.0, 220.0, 40.0, 32.0), hold_s=0.5, timeout_s=5.0, by=owner, label="by hand"
                )
                self._accepted(accepted.id)

    async def _vanish(self, owner: str) -> None:
        """Nobody gives the head back, and it may be turning."""
        await self._client.ask_lease(LeaseRequest(owner=owner, for_s=20.0))
        for _ in range(WORDS):
            await self._client.move(MoveRequest(owner=owner, speed=Speed(pan_deg_s=self._chance.uniform(-80, 80))))
            await asyncio.sleep(0.1)
        self._done["hand vanished"] += 1

    async def _steer(self, hand: KeptLease) -> None:
        pan, tilt = self._chance.uniform(-80, 80), self._chance.uniform(-40, 40)
        for _ in range(WORDS):
            await hand.steer(pan, tilt, self._chance.choice((0.0, 0.3, -1.0)))
            await asyncio.sleep(0.1)
