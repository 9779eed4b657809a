"""From what the matcher says of every view to one honest answer: where the region is, or why nobody can tell."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from ptzd.model import Candidate, Matcher, MatchResult

LEAST_TEXTURE = 1.0
"""Below it the region is noise."""


CHANCE_SCORE = 0.3
"""Score that the best of many wrong places usually reaches; a rival counts at least that much, so that a search too
narrow to have rivals is not the more certain for it."""


CHANCE_LEAD = 0.02
"""Lead in score that one of two equal places gains by chance: with less, the better one is as likely the wrong one."""
SHARED_ERROR = math.sqrt(5.0)
"""Factor on the residuals' sigma: neighbouring samples of a few fisheye pixels err together."""
LEAST_SHARE_OF_PIXEL = 0.1
"""Of a fisheye pixel: no match is better than that, whatever its residuals say."""
UNEXPLAINED_SHARE_OF_PIXEL = 0.5
"""Of a fisheye pixel at score 0, less in proportion towards 1: what a plane cannot explain moves its centre."""


class Verdict(StrEnum):
    """What can be said of a region after all views so far."""

    FOUND = "found"
    AMBIGUOUS = "ambiguous"
    NOT_FOUND = "not_found"
    NO_TEXTURE = "no_texture"


@dataclass(frozen=True, slots=True, kw_only=True)
class Thresholds:
    """When an answer is believed."""

    accept_probability: float = 0.8
    """At or above it the best candidate counts as found."""
    rival_share: float = 0.85
    """A second place with this share of the best score makes an unbelieved answer ambiguous instead of not found."""
    same_place_rad: float = math.radians(0.6)
    """Candidates of different views closer than this, and closer than 4 sigma, are one place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rival:
    """A candidate and the view that shows it."""

    view: int
    candidate: Candidate


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """One answer over all views."""

    outcome: Verdict
    probability: float
    """That the best candidate is within 1° of the region; 0 without a candidate."""
    best: Candidate | None
    view: int | None
    """Index of the view that shows the best candidate."""
    rivals: tuple[Rival, ...]
    """The other separate places, best first."""
    reason: str
    """One sentence for a person."""
    against_the_map: bool = False
    """The pictures alone would have it found; what is known of the scene's ranges speaks for another place."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """What a map of the scene's ranges has to say; it can only make an answer less sure, never one `found`."""

    density: Callable[[float], float]
    """How much likelier an inverse range is by the map than if nothing were known."""
    of_place: bool
    """Whether a place is doubted for want of a surface there; if not, only against a rival that stands on one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A candidate's chance to be right: that it is such a place at all, times that it is this one and not its rival.

    ``P = λ(bias + margin (S - max(S₂, C)) + blur log10(σ / 0.05°) + hidden (1 - in_view)) λ((S - S₂) / L)`` with λ the
    logistic function, S the score, S₂ that of the best separate rival, σ from the residuals, C `CHANCE_SCORE`, L
    `CHANCE_LEAD`.
    """

    bias: float
    margin: float
    blur: float
    hidden: float

    def probability(self, best: Candidate, rival_score: float, doubt: float = 0.0, rival_doubt: float = 0.0) -> float:
        """Chance in (0, 1) that the candidate is within 1° of the region.

        What the map of ranges says enters as log odds, at most 0: against such a place at all, and for its rival.
        """
        sigma_deg = max(math.degrees(best.sigma_rad), 0.01)
        odds = (
            self.bias
            + self.margin * (best.score - max(rival_score, CHANCE_SCORE))
            + self.blur * math.log10(sigma_deg / 0.05)
            + self.hidden * (1.0 - best.in_view)
            + doubt
        )
        return _logistic(odds) * _logistic((best.score - rival_score) / CHANCE_LEAD + rival_doubt)


MODELS = {
    Matcher.SWEEP: Model(bias=-0.15, margin=11.6, blur=-2.1, hidden=-0.93),
    Matcher.HARRIS: Model(bias=0.0, margin=4.5, blur=-2.7, hidden=0.0),
}
"""Fitted by ``python -m tests.bench.fit`` to records of the scenes room and yard; on the warehouse, which the fit never
saw, 99 % of the sweep's answers told with p >= 0.9 are within 1°. A fit together with the lead's factor tells as many
right ones but believes scores near chance, which the scenes hardly hold; so the steeper margin stays. The bias of
``harris`` is 1.3 lower than fitted: its fit was too confident on the warehouse."""


def decide(results: Sequence[tuple[int, MatchResult]], thresholds: Thresholds, prior: Prior | None = None) -> Decision:
    """Decide where a region is.

    Parameters
    ----------
    results : sequence of (int, MatchResult)
        Index of the view and what the matcher says of it; all of one region and one matcher.
    thresholds : Thresholds
        When to believe.
    prior : Prior, optional
        What is known of the scene's ranges.

    Returns
    -------
    Decision
        ``no_texture`` when no view saw texture in the region; ``found`` at or above the accepted probability; otherwise
        ``ambiguous`` when several places or one uncertain place look alike, and ``not_found``. The best candidate comes
        along in every case that has one.
    """
    if results and max(result.texture for _, result in results) < LEAST_TEXTURE:
        return _without_candidate(Verdict.NO_TEXTURE, "the region has no texture above the picture's noise")
    places = _places(results, thresholds)
    if not places:
        return _without_candidate(Verdict.NOT_FOUND, f"no place in {len(results)} view(s) looks like the region")
    best, rivals = places[0], tuple(places[1:])
    rival_score = rivals[0].candidate.score if rivals else 0.0
    probability = MODELS[results[0][1].matcher].probability(best.candidate, rival_score)
    outcome, reason = _verdict(probability, best.candidate, rival_score, thresholds)
    decision = Decision(
        outcome=outcome,
        probability=probability,
        best=best.candidate,
        view=best.view,
        rivals=rivals,
        reason=reason,
    )
    if prior is None or outcome is not Verdict.FOUND:
        return decision
    return _with_map(decision, MODELS[results[0][1].matcher], thresholds, prior)


def _with_map(found: Decision, model: Model, thresholds: Thresholds, prior: Prior) -> Decision:
    """What was found, less sure where the map expects the target elsewhere."""
    if found.best is None:
        return found
    here = prior.density(found.best.inverse_range)
    doubt = min(math.log(here), 0.0) if prior.of_place else 0.0
    chances = [model.probability(found.best, found.rivals[0].candidate.score if found.rivals else 0.0, doubt)]
    for rival in found.rivals:
        for_rival = min(math.log(here / prior.density(rival.candidate.inverse_range)), 0.0)
        chances.append(model.probability(found.best, rival.candidate.score, doubt, for_rival))
    probability = min(chances)
    if probability >= thresholds.accept_probability:
        return replace(found, probability=probability)
    reason = f"{found.reason}, but {probability:.2f} with what locks have taught of the ranges there"
    return replace(found, outcome=Verdict.AMBIGUOUS, probability=probability, reason=reason, against_the_map=True)


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-min(max(odds, -30.0), 30.0)))


def direction_sigma_rad(place: Candidate, pixel_rad: float) -> float:
    """Return one sigma of a found place's direction, rad, with what its residuals cannot tell.

    The residuals know of noise alone. ``python -m tests.bench.fit`` prints how many errors lie within three sigma of
    either kind.

    Parameters
    ----------
    place : Candidate
        Whose `sigma_rad` comes from the residuals.
    pixel_rad : float
        Angular size of a fisheye pixel at the box, rad.
    """
    pixels = LEAST_SHARE_OF_PIXEL + UNEXPLAINED_SHARE_OF_PIXEL * (1.0 - place.score)
    return math.hypot(SHARED_ERROR * place.sigma_rad, pixels * pixel_rad)


def _verdict(probability: float, best: Candidate, rival_score: float, thresholds: Thresholds) -> tuple[Verdict, str]:
    told = f"probability {probability:.2f}, accepted from {thresholds.accept_probability:.2f}"
    if probability >= thresholds.accept_probability:
        return Verdict.FOUND, told
    if best.score > 0.3 and rival_score >= thresholds.rival_share * best.score:
        return Verdict.AMBIGUOUS, f"two places look alike (scores {best.score:.2f} and {rival_score:.2f}): {told}"
    if probability >= 0.5 * thresholds.accept_probability:
        return Verdict.AMBIGUOUS, f"one place looks somewhat like the region (score {best.score:.2f}): {told}"
    return Verdict.NOT_FOUND, f"the best place does not look like the region (score {best.score:.2f}): {told}"


def _without_candidate(outcome: Verdict, reason: str) -> Decision:
    return Decision(outcome=outcome, probability=0.0, best=None, view=None, rivals=(), reason=reason)


def _places(results: Sequence[tuple[int, MatchResult]], thresholds: Thresholds) -> list[Rival]:
    """Return the separate places, best first; of what overlapping views show of one place, the best stays."""
    everything = [Rival(view=view, candidate=item) for view, result in results for item in result.candidates]
    everything.sort(key=lambda rival: (-rival.candidate.score, rival.view))
    places: list[Rival] = []
    for rival in everything:
        if not any(_same_place(rival, other, thresholds) for other in places):
            places.append(rival)
    return places


def _same_place(one: Rival, other: Rival, thresholds: Thresholds) -> bool:
    if one.view == other.view:
        return False
    sigma = math.hypot(one.candidate.sigma_rad, other.candidate.sigma_rad)
    apart = _angle(one.candidate, other.candidate)
    return apart < max(thresholds.same_place_rad, min(4.0 * sigma, 2.0 * thresholds.same_place_rad))


def _angle(one: Candidate, other: Candidate) -> float:
    """Angle between two directions, rad (haversine, accurate for small angles)."""
    half = math.sin((one.tilt_rad - other.tilt_rad) / 2.0) ** 2
    half += math.cos(one.tilt_rad) * math.cos(other.tilt_rad) * math.sin((one.pan_rad - other.pan_rad) / 2.0) ** 2
    return 2.0 * math.asin(math.sqrt(min(half, 1.0)))
