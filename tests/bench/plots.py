"""Line charts as SVG, written by hand: no plotting library is needed to run the bench or to read its pages."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape

WIDTH, HEIGHT = 640, 400
LEFT, RIGHT, TOP, BOTTOM = 64, 136, 40, 52
COLOURS = ("#0b6e4f", "#c8553d", "#3d5a98", "#8a5fa8", "#b88a00", "#4f9bb3")
REFERENCE = "#555555"
"""Of dashed lines."""
DASHED = "6 4"


@dataclass(frozen=True, kw_only=True)
class Series:
    """A line; points that are not finite are left out."""

    name: str
    points: Sequence[tuple[float, float]]
    dashed: bool = False


@dataclass(frozen=True, kw_only=True)
class Axis:
    """One axis and where its ticks are."""

    title: str
    ticks: Sequence[float]
    label: Callable[[float], str] = "{:g}".format
    logarithmic: bool = False

    def place(self, value: float, start: float, end: float) -> float:
        """Position of a value between two ends, kept inside them."""
        low, high, here = (self._scaled(v) for v in (self.ticks[0], self.ticks[-1], value))
        return start + (end - start) * min(max((here - low) / (high - low), 0.0), 1.0)

    def _scaled(self, value: float) -> float:
        return math.log10(max(value, 1e-12)) if self.logarithmic else value


def chart(title: str, across: Axis, up: Axis, series: Sequence[Series]) -> str:
    """An SVG document with axes, a grid, lines and their names at the right."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="sans-serif" font-size="12">',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>',
        _text(LEFT, TOP - 18, title, size=14),
        *_grid(across, up),
    ]
    for index, line in enumerate(series):
        colour = REFERENCE if line.dashed else COLOURS[index % len(COLOURS)]
        parts += _line(line, colour, across, up)
        y = TOP + 10 + 20 * index
        x = WIDTH - RIGHT + 14
        parts.append(_stroke([(x, y), (x + 22, y)], colour, 2.5, DASHED if line.dashed else ""))
        parts.append(_text(x + 28, y + 4, line.name))
    return "\n".join([*parts, "</svg>", ""])


def _grid(across: Axis, up: Axis) -> list[str]:
    right, bottom = WIDTH - RIGHT, HEIGHT - BOTTOM
    parts = []
    for value in across.ticks:
        x = across.place(value, LEFT, right)
        parts += [_stroke([(x, TOP), (x, bottom)], "#dddddd"), _text(x, bottom + 18, across.label(value), "middle")]
    for value in up.ticks:
        y = up.place(value, bottom, TOP)
        parts += [_stroke([(LEFT, y), (right, y)], "#dddddd"), _text(LEFT - 6, y + 4, up.label(value), "end")]
    parts.append(_text((LEFT + right) / 2, HEIGHT - 12, across.title, "middle"))
    middle = (TOP + bottom) / 2
    parts.append(f'<g transform="rotate(-90 16 {middle:.1f})">{_text(16, middle, up.title, "middle")}</g>')
    return parts


def _line(line: Series, colour: str, across: Axis, up: Axis) -> list[str]:
    places = [
        (across.place(x, LEFT, WIDTH - RIGHT), up.place(y, HEIGHT - BOTTOM, TOP))
        for x, y in line.points
        if math.isfinite(x) and not math.isnan(y)
    ]
    parts = [_stroke(places, colour, 2.0, DASHED if line.dashed else "")] if places else []
    if len(places) <= 12:
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in places]
    return parts


def _stroke(places: Sequence[tuple[float, float]], colour: str, width: float = 1.0, dashes: str = "") -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
    dash = f' stroke-dasharray="{dashes}"' if dashes else ""
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}"{dash}/>'


def _text(x: float, y: float, words: str, anchor: str = "start", size: int = 12) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" font-size="{size}" fill="#222222">{escape(words)}</text>'
    )
