"""What one match may cost, counted in work, not by the clock: a job is refused or done everywhere, also in replay."""

from __future__ import annotations

from ptzd.errors import MatchError

SAMPLES_PER_S = 10e6
"""Looked up and compared in a second by a slow core; ``python -m tests.bench.budget`` measures it."""
PLACING_SAMPLES = 16
"""Laying a hypothesis costs as much as so many samples of it."""


def refuse_beyond_budget(hypotheses: int, samples: int, budget_s: float) -> None:
    """Refuse a search before it begins.

    Parameters
    ----------
    hypotheses : int
        Along and across the arc.
    samples : int
        Of the view that each of them looks up.
    budget_s : float
        Most time for it, at :data:`SAMPLES_PER_S`.

    Raises
    ------
    MatchError
        With the work and what to change.
    """
    needed_s = hypotheses * (samples + PLACING_SAMPLES) / SAMPLES_PER_S
    if needed_s > budget_s:
        raise MatchError(
            f"the search has {hypotheses} places of {samples} samples each, about {needed_s:.1f} s of work, and "
            f"search.match_budget_s is {budget_s:g} s; narrow range_m, draw a larger box or raise the budget"
        )
