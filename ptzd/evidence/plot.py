"""The score along the arc as a drawing that a page can hold."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ptzd.control.events import MatchFinished
from ptzd.evidence.score_curve import Curve

_WIDTH, _HEIGHT = 760, 260
_LEFT, _RIGHT, _TOP, _BOTTOM = 60, 20, 20, 50
_TICKS = (0.0, 0.25, 0.5, 0.75, 1.0)


def score_plot(curve: Curve, answer: MatchFinished, unit: str) -> str:
    """SVG: score over the angle along the arc, the candidates at their inverse range.

    Parameters
    ----------
    curve : Curve
        From :func:`ptzd.evidence.score_curve.score_along`.
    answer : MatchFinished
        Its candidates are the dots, the chosen one larger.
    unit : str
        Of the range.
    """
    parts = [*_axes(curve, unit), *_line(curve), *_dots(curve, answer)]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        f'height="{_HEIGHT}" role="img" aria-label="score over range">{"".join(parts)}</svg>'
    )


def _x(curve: Curve, angle_deg: float) -> float:
    first, last = float(curve.angle_deg[0]), float(curve.angle_deg[-1])
    return _LEFT + (angle_deg - first) / max(last - first, 1e-9) * (_WIDTH - _LEFT - _RIGHT)


def _y(score: float) -> float:
    return _TOP + (1.0 - score) / 2.0 * (_HEIGHT - _TOP - _BOTTOM)


def _polyline(points: str, stroke: str, width: float) -> str:
    return f'<polyline points="{points}" stroke="{stroke}" fill="none" stroke-width="{width:g}"/>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="12" fill="#444" text-anchor="{anchor}">{text}</text>'


def _axes(curve: Curve, unit: str) -> Iterator[str]:
    for score in (-1.0, 0.0, 1.0):
        yield _polyline(f"{_LEFT},{_y(score):.1f} {_WIDTH - _RIGHT},{_y(score):.1f}", "#ddd", 1)
        yield _text(_LEFT - 8, _y(score) + 4, f"{score:g}", "end")
    yield _text(_LEFT - 50, _TOP - 6, "score", "start")
    for share in _TICKS:
        k = round(share * (len(curve.angle_deg) - 1))
        x, s = _x(curve, float(curve.angle_deg[k])), float(curve.inverse_range[k])
        yield _polyline(f"{x:.1f},{_HEIGHT - _BOTTOM} {x:.1f},{_HEIGHT - _BOTTOM + 5}", "#888", 1)
        yield _text(x, _HEIGHT - _BOTTOM + 19, f"{1.0 / s:.3g} {unit}" if s > 0.0 else "infinitely far", "middle")
    swept = float(curve.angle_deg[-1] - curve.angle_deg[0])
    yield _text(_WIDTH / 2, _HEIGHT - 8, f"supposed distance of the target; the arc spans {abs(swept):.1f}°", "middle")


def _line(curve: Curve) -> Iterator[str]:
    """Pieces between places where too little of the region fell into the view."""
    for run in np.split(np.arange(len(curve.score)), np.flatnonzero(np.isnan(curve.score))):
        known = [k for k in run if not np.isnan(curve.score[k])]
        if known:
            points = " ".join(
                f"{_x(curve, float(curve.angle_deg[k])):.1f},{_y(float(curve.score[k])):.1f}" for k in known
            )
            yield _polyline(points, "#06c", 1.5)


def _dots(curve: Curve, answer: MatchFinished) -> Iterator[str]:
    for rank, candidate in enumerate(answer.result.candidates):
        angle = float(np.interp(candidate.inverse_range, curve.inverse_range, curve.angle_deg))
        fill, radius = ("#2a2", 6) if rank == 0 else ("#c33", 4)
        x, y = _x(curve, angle), _y(candidate.score)
        yield f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius}" fill="{fill}"/>'
        if rank == 0:
            yield _text(x + 10, y + 12, f"{candidate.score:.2f}", "start")
