"""Who goes before whom."""

from __future__ import annotations

import itertools
from enum import IntEnum

PRIORITIES = 9
"""Highest priority of a request."""
PEOPLE = 8
"""Highest rank among people."""


class Rank(IntEnum):
    """Whose wish counts more.

    Requests stand at ``REQUEST`` plus their priority, 0 to 9; people at ``LEASE`` plus theirs, 0 to 8, and what they
    ask for while they have the head one above them.
    """

    HOME = 0
    PATROL = 10
    REQUEST = 20
    GOTO = 30
    LEASE = 40
    STOP = 50


def rank_mermaid() -> str:
    """The diagram of ranks of README: each goes before what its arrow leads to."""
    rows = (
        ("stop", Rank.STOP, "an operator's stop, a lost fisheye, the end of the daemon"),
        (
            "own",
            Rank.LEASE + PEOPLE + 1,
            f"what whoever has the lease asks for himself (one above his rank, {Rank.LEASE + 1}…)",
        ),
        ("lease", Rank.LEASE + PEOPLE, f"a person with a lease, by rank ({Rank.LEASE}…)"),
        ("goto", Rank.GOTO, "a named place that an operator sent the head to"),
        ("request", Rank.REQUEST + PRIORITIES, f"requests, by priority ({Rank.REQUEST}…)"),
        ("patrol", Rank.PATROL, "a patrol"),
        ("home", Rank.HOME, "the way home"),
    )
    lines = ["flowchart TD"]
    lines += [f'    {name}["{int(rank)}: {text}"]' for name, rank, text in rows]
    lines += [f"    {higher[0]} --> {lower[0]}" for higher, lower in itertools.pairwise(rows)]
    return "\n".join(lines)
