"""Stopping: nothing moves until the camera has said that it stands, or nobody can tell any more."""

from __future__ import annotations

from msgspec import field

from ptzd.control.activities.activity import Activity, Over, Step
from ptzd.control.work import Work

STOP_GUARD_NS = 3_000_000_000
"""A stop that is not confirmed within this is reported as such."""


class Stop(Activity, kw_only=True, tag="stop"):
    """The order is out; whoever asked for it waits for the camera's word."""

    tokens: list[int] = field(default_factory=list)
    """Queries to answer."""
    until_ns: int = 0

    def begin(self, work: Work) -> Step:
        """Send the order, also when an earlier one is not confirmed yet."""
        work.stop()
        self.until_ns = work.t_ns + STOP_GUARD_NS
        return None

    def take_tokens(self) -> list[int]:
        """The queries that wait; each is answered once."""
        tokens, self.tokens = self.tokens, []
        return tokens

    def on_time(self, work: Work) -> Step:
        """The camera did not say that it stands."""
        if work.t_ns >= self.until_ns:
            return Over(reason="the camera did not confirm it in time")
        return None

    def wakes_ns(self, work: Work) -> int | None:
        """See `Activity`."""
        del work
        return self.until_ns
