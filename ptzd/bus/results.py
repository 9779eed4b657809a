"""Results kept for those who ask late."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

MOST = 4096
"""Results kept at most, whatever their age: of 0.5 kB each this is 2 MB; and as many refusals."""


class KeptResults:
    """Encoded results by request id, forgotten after a time.

    Refusals have a shelf of their own: anybody can cause thousands in a second, and they must push out no result of a
    request that was served.

    Parameters
    ----------
    kept_s : float
        How long, in s.
    """

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9)
        self._served: OrderedDict[str, tuple[int, bytes]] = OrderedDict()
        self._refused: OrderedDict[str, tuple[int, bytes]] = OrderedDict()

    def put(self, request_id: str, payload: bytes, now_ns: int, *, refused: bool = False) -> None:
        """Keep a result; a later one of the same id takes its place."""
        for shelf in (self._served, self._refused):
            shelf.pop(request_id, None)
        (self._refused if refused else self._served)[request_id] = (now_ns, payload)
        self._forget(now_ns)

    def get(self, request_id: str, now_ns: int) -> bytes | None:
        """The encoded result; None when there is none or it is too old."""
        self._forget(now_ns)
        kept = self._served.get(request_id) or self._refused.get(request_id)
        return None if kept is None else kept[1]

    def all(self, now_ns: int) -> Iterator[tuple[str, bytes]]:
        """Id and encoded result of everything kept: the refusals first, then the served, the oldest of each first."""
        self._forget(now_ns)
        kept = (*self._refused.items(), *self._served.items())
        return ((request_id, payload) for request_id, (_, payload) in kept)

    def _forget(self, now_ns: int) -> None:
        for shelf in (self._served, self._refused):
            while shelf:
                request_id, (t_ns, _) = next(iter(shelf.items()))
                if len(shelf) <= MOST and now_ns - t_ns <= self._kept_ns:
                    break
                del shelf[request_id]
