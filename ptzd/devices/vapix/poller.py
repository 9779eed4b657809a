"""Asks the camera where it is, again and again, and keeps what it says."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Iterator
from contextlib import contextmanager

from ptzd.config import Ptz
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.feed import Feed
from ptzd.devices.vapix.poses import PoseRing
from ptzd.errors import DeviceGarbled, DeviceLost
from ptzd.ports import Clock, HeadPoll

FAILURES_ALLOWED = 2
"""In a row; one more and the camera counts as lost."""
KEPT_POLLS = 64
EAGER = 2.5
MAX_POLL_HZ = 25.0
"""Cameras renew their reports at 10 to 20 Hz."""


class Poller:
    """Position reports of one camera.

    Parameters
    ----------
    settings : Ptz
    client : CameraClient
    poses : PoseRing
        Gets every report.
    clock : Clock
    """

    def __init__(self, settings: Ptz, client: CameraClient, poses: PoseRing, clock: Clock) -> None:
        self.feed: Feed[HeadPoll] = Feed(KEPT_POLLS)
        self._request = requests.position(settings.camera)
        self._client = client
        self._poses = poses
        self._clock = clock
        self._period_s = 1 / settings.poll_hz
        self._eager_period_s = 1 / min(EAGER * settings.poll_hz, MAX_POLL_HZ)
        self._waiting = 0
        self._lag_ns = round(settings.report_lag_s * 1e9)
        self._stall_s = settings.stall_s

    async def run(self) -> None:
        """Poll until the camera is lost; returns never.

        Raises
        ------
        DeviceLost, DeviceGarbled
            The third failure in a row, or no answer for ``stall_s``.
        DeviceRefused
            At once.
        """
        loop = asyncio.get_running_loop()
        failures, answered_s, next_s = 0, loop.time(), loop.time()
        while True:
            try:
                await self._poll()
                failures, answered_s = 0, loop.time()
            except (DeviceLost, DeviceGarbled):
                failures += 1
                if failures > FAILURES_ALLOWED or loop.time() - answered_s >= self._stall_s:
                    raise
            next_s = max(next_s + (self._eager_period_s if self._waiting else self._period_s), loop.time())
            await asyncio.sleep(min(next_s - loop.time(), self._pause_to_proof_s()))

    def _pause_to_proof_s(self) -> float:
        """Until a report can confirm the camera's own word of rest; inf when that is past or not awaited."""
        due_ns = self._poses.confirmed_at_ns
        pause_s = -1.0 if due_ns is None else (due_ns + self._lag_ns - self._clock.now_ns()) / 1e9
        return pause_s if pause_s > 0 else math.inf

    @contextmanager
    def eagerly(self) -> Iterator[None]:
        """Ask more often while somebody waits for rest."""
        self._waiting += 1
        try:
            yield
        finally:
            self._waiting -= 1

    async def _poll(self) -> None:
        exchange = await self._client.exchange(self._request)
        half_ns = (exchange.received_ns - exchange.sent_ns) // 2
        pose = self._poses.add(exchange.sent_ns + half_ns - self._lag_ns, half_ns, exchange.value)
        self.feed.publish(HeadPoll(reading=pose.reading, t_ns=pose.t_ns, motion=pose.motion, foreign=pose.foreign))
