"""Results kept for those who ask late."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator

MOST = 4096
"""Results kept at most, whatever their age: of 0.5 kB each this is 2 MB."""


class KeptResults:
    """Encoded results by request id, forgotten after a time.

    Parameters
    ----------
    kept_s : float
        How long, in s.
    """

    def __init__(self, kept_s: float) -> None:
        self._kept_ns = round(kept_s * 1e9)
        self._results: OrderedDict[str, tuple[int, bytes]] = OrderedDict()

    def put(self, request_id: str, payload: bytes, now_ns: int) -> None:
        """Keep a result; a later one of the same id takes its place."""
        self._results[request_id] = (now_ns, payload)
        self._results.move_to_end(request_id)
        self._forget(now_ns)

    def get(self, request_id: str, now_ns: int) -> bytes | None:
        """The encoded result; None when there is none or it is too old."""
        self._forget(now_ns)
        return self._results.get(request_id, (0, None))[1]

    def all(self, now_ns: int) -> Iterator[tuple[str, bytes]]:
        """Id and encoded result of everything kept, oldest first."""
        self._forget(now_ns)
        return ((request_id, payload) for request_id, (_, payload) in tuple(self._results.items()))

    def _forget(self, now_ns: int) -> None:
        while self._results:
            request_id, (t_ns, _) = next(iter(self._results.items()))
            if len(self._results) <= MOST and now_ns - t_ns <= self._kept_ns:
                return
            del self._results[request_id]
