"""A matcher that fails where it once answered: the replay tells that difference and goes on to the log's end."""

from __future__ import annotations

from pathlib import Path

from ptzd.app.replaying import replay
from ptzd.errors import MatchError
from ptzd.runtime.perception import ThreadPerception

LOCK = Path(__file__).parent.parent / "golden" / "lock.mcap"


def test_a_match_that_fails_anew_is_a_difference_and_not_the_end(monkeypatch) -> None:
    whole = replay(LOCK, recompute=True)

    def fails(*_: object) -> None:
        raise MatchError("the search has 9 places too many")

    monkeypatch.setattr(ThreadPerception, "match_now", fails)
    found = replay(LOCK, recompute=True)
    assert found.events == whole.events
    first = found.differences[0]
    assert (first.path, first.replayed) == ("MatchFinished.result", "the search has 9 places too many")
