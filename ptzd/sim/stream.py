"""Pictures in time: one producer per stream configuration, shared by its viewers; each exposed at its own moment."""

from __future__ import annotations

import asyncio
import hashlib
from collections import deque
from collections.abc import Awaitable, Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

from ptzd.sim.clock import SimClock
from ptzd.sim.head import Pose

SHOTS_KEPT = 600


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One compressed picture and when it was exposed."""

    number: int
    t_s: float
    """Middle of the exposure."""
    jpeg: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class ShotRecord:
    """What the side channel knows about a picture."""

    sha256: str
    t_s: float
    pose: Pose | None
    """True pose at the middle of the exposure; None for the fisheye."""


class ShotLog:
    """The latest pictures by the hash of their bytes."""

    def __init__(self) -> None:
        self._records: deque[ShotRecord] = deque(maxlen=SHOTS_KEPT)

    def add(self, jpeg: bytes, t_s: float, pose: Pose | None) -> None:
        """Remember one picture."""
        self._records.append(ShotRecord(sha256=hashlib.sha256(jpeg).hexdigest(), t_s=t_s, pose=pose))

    def find(self, sha256: str) -> ShotRecord | None:
        """The picture with these bytes, while it is remembered."""
        return next((record for record in reversed(self._records) if record.sha256 == sha256), None)

    def latest(self, count: int) -> list[ShotRecord]:
        """The newest pictures, oldest first."""
        return list(self._records)[-count:]


Develop = Callable[[float], Awaitable[bytes]]
"""Gives the JPEG of an exposure around a time that has just passed."""


class Stream:
    """Pictures at a fixed rate while somebody looks.

    Parameters
    ----------
    develop : Develop
    clock : SimClock
    fps : float
    exposure_s : float
        Length of an exposure.
    latency_s : float
        Middle of the exposure to the moment a viewer gets the picture.
    """

    def __init__(self, develop: Develop, clock: SimClock, *, fps: float, exposure_s: float, latency_s: float) -> None:
        self._develop = develop
        self._clock = clock
        self._period_s = 1.0 / fps
        self._exposure_s = exposure_s
        self._latency_s = latency_s
        self._viewers: set[asyncio.Queue[Shot]] = set()
        self._task: asyncio.Task[None] | None = None
        self._next_tick_s = clock.now_s()
        self._number = 0

    @property
    def viewers(self) -> int:
        """How many look."""
        return len(self._viewers)

    def join(self) -> asyncio.Queue[Shot]:
        """A queue of one that always holds the newest picture not yet taken; give it back with :meth:`leave`."""
        queue: asyncio.Queue[Shot] = asyncio.Queue(maxsize=1)
        self._viewers.add(queue)
        if self._task is None:
            self._task = asyncio.create_task(self._run(), name="sim stream")
        return queue

    async def leave(self, queue: asyncio.Queue[Shot]) -> None:
        """Stop looking; the last one turns off the light."""
        self._viewers.discard(queue)
        if not self._viewers and self._task is not None:
            task, self._task = self._task, None
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _run(self) -> None:
        pipeline: asyncio.Queue[Shot] = asyncio.Queue()
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self._expose(pipeline), name="sim exposure")
            tasks.create_task(self._deliver(pipeline), name="sim delivery")

    async def _expose(self, pipeline: asyncio.Queue[Shot]) -> None:
        while True:
            missed = max(int((self._clock.now_s() - self._next_tick_s) / self._period_s), 0)
            self._next_tick_s += (missed + 1) * self._period_s
            tick_s = self._next_tick_s
            await self._clock.sleep_until(tick_s + self._exposure_s / 2)
            pipeline.put_nowait(Shot(number=self._number, t_s=tick_s, jpeg=await self._develop(tick_s)))
            self._number += 1

    async def _deliver(self, pipeline: asyncio.Queue[Shot]) -> None:
        while True:
            shot = await pipeline.get()
            await self._clock.sleep_until(shot.t_s + self._latency_s)
            for queue in self._viewers:
                if queue.full():
                    queue.get_nowait()
                queue.put_nowait(shot)


class Darkroom:
    """A worker thread for rendering and compressing."""

    def __init__(self) -> None:
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix="sim-darkroom")

    async def run(self, work: Callable[[], bytes]) -> bytes:
        """Run work off the loop."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work)

    def close(self) -> None:
        """End the thread when its work is done."""
        self._pool.shutdown(wait=True, cancel_futures=True)
