"""One writer, any number of readers: values in order, and the failure that ended them."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import Generic, Self, TypeVar

from ptzd.errors import DeviceError, DeviceGarbled, DeviceLost

T = TypeVar("T")


class Feed(Generic[T]):
    """The latest values, each with a running number; readers keep their own place.

    Parameters
    ----------
    depth : int
        How many values a slow reader may be behind before the oldest pass it by.
    """

    def __init__(self, depth: int) -> None:
        self._values: deque[T] = deque(maxlen=depth)
        self._count = 0
        self._failure: DeviceError | None = DeviceLost("not connected; describe() comes first")
        self._changed = asyncio.Event()
        self._openings = 0

    @property
    def openings(self) -> int:
        """How often it was opened: a higher number is another connection."""
        return self._openings

    @property
    def count(self) -> int:
        """Values so far, over all failures."""
        return self._count

    @property
    def kept(self) -> tuple[T, ...]:
        """The latest values, oldest first."""
        return tuple(self._values)

    def open(self) -> None:
        """Start anew after a failure; earlier values are gone."""
        self._values.clear()
        self._failure = None
        self._openings += 1

    def publish(self, value: T) -> None:
        """Hand out the next value."""
        self._values.append(value)
        self._count += 1
        self._wake()

    def fail(self, error: DeviceError) -> None:
        """End all readers, those who come later included, until :meth:`open`."""
        self._failure = error
        self._wake()

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()

    def check(self) -> None:
        """Raise the failure, if there is one."""
        if self._failure is not None:
            raise type(self._failure)(str(self._failure))

    async def after(self, count: int) -> tuple[int, T]:
        """The first kept value whose number is above ``count``, with its number.

        Raises
        ------
        DeviceError
            The failure.
        """
        self.check()
        while self._count <= count or not self._values:
            await self._changed.wait()
            self.check()
        number = max(count + 1, self._count - len(self._values) + 1)
        return number, self._values[number - 1 - self._count]

    def listen(self) -> Reader[T]:
        """Values from now on, until the failure is raised."""
        return Reader(self)


def supervise(task: asyncio.Task[None], *, feed: Feed[T], name: str) -> None:
    """Pass on why a task ended, to be called when it did: whoever reads its feed hears it as a loss.

    A programming error is a loss too, so that nobody waits for ever, and is reported to the loop with its traceback.
    """
    error = None if task.cancelled() else task.exception()
    if error is None:
        return
    failure = error
    if not isinstance(failure, DeviceError):
        words = " ".join(str(error).split())
        failure = DeviceGarbled(f"internal error in {name}: {type(error).__name__}: {words}")
        task.get_loop().call_exception_handler({"message": str(failure), "exception": error})
    feed.fail(failure)


class Reader(Generic[T]):
    """An endless iterator over a feed.

    Attributes
    ----------
    passed_by : int
        Values that came before the latest returned one and were not returned, because the reader was too slow.
    """

    def __init__(self, feed: Feed[T]) -> None:
        self._feed = feed
        self._number = feed.count
        self.passed_by = 0

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> T:
        number, value = await self._feed.after(self._number)
        self.passed_by = number - self._number - 1
        self._number = number
        return value
