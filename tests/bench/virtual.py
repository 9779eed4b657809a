"""An event loop whose time is its own: sockets are real, waiting takes no time. Client and simulator share its clock.

When nothing can be read and no thread works, time jumps to the next timer. So a thousand moves of two seconds take a
minute or two, and lateness is that of the code under test, not that of the machine.
"""

from __future__ import annotations

import asyncio
import selectors
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from typing import Any

START_S = 1_000_000.0
LOOKS = 3
"""How often sockets are looked at before time jumps: what one end wrote on the loopback is there for the other, unless
the kernel is too busy to pass it on at once."""


class _JumpingSelector(selectors.BaseSelector):
    """Never sleeps while a timer is due next: it tells the loop to jump there."""

    def __init__(self, jump: Callable[[float], None], at_work: Callable[[], bool]) -> None:
        self._real = selectors.DefaultSelector()
        self._jump = jump
        self._at_work = at_work

    def register(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.register(fileobj, events, data)

    def unregister(self, fileobj: Any) -> selectors.SelectorKey:
        return self._real.unregister(fileobj)

    def modify(self, fileobj: Any, events: int, data: Any = None) -> selectors.SelectorKey:
        return self._real.modify(fileobj, events, data)

    def get_map(self) -> Mapping[Any, selectors.SelectorKey]:
        return self._real.get_map()

    def close(self) -> None:
        self._real.close()

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is not None and timeout <= 0:
            return self._real.select(0)
        for _ in range(LOOKS):
            if ready := self._real.select(0):
                return ready
        if timeout is None or self._at_work():
            return self._real.select(None)
        self._jump(timeout)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """Timers run on a time that jumps over every pause; threads stop it while they work."""

    def __init__(self) -> None:
        self._now_s = START_S
        self._working = 0
        super().__init__(_JumpingSelector(self._pass, lambda: self._working > 0))

    def time(self) -> float:
        """The present, s."""
        return self._now_s

    def _pass(self, duration_s: float) -> None:
        self._now_s += duration_s

    def run_in_executor(self, executor: Executor | None, func: Any, *args: Any) -> asyncio.Future[Any]:
        """As usual; time stands still until the work is done."""
        self._working += 1
        future = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._worked)
        return future

    def _worked(self, _future: asyncio.Future[Any]) -> None:
        self._working -= 1


class LoopClock:
    """The loop's time, for the client (ns) and for the simulator (s)."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop

    def now_ns(self) -> int:
        """The present."""
        return round(self._loop.time() * 1e9)

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        """The same scale."""
        return monotonic_ns

    def now_s(self) -> float:
        """The present."""
        return self._loop.time()

    async def sleep_until(self, t_s: float) -> None:
        """Return when the time has come."""
        woken = self._loop.create_future()
        timer = self._loop.call_at(t_s, lambda: woken.done() or woken.set_result(None))
        try:
            await woken
        finally:
            timer.cancel()
