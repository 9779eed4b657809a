"""A quarter of a minute of what `make life` does for an hour."""

from __future__ import annotations

from tests.bench import life


def test_a_short_and_eventful_life_ends_well(capsys) -> None:
    """Every accepted request has one result, the logs replay, the daemon ends with 0."""
    assert life.main(minutes=0.15, seed=1) == 0, capsys.readouterr().out
