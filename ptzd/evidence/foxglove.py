"""Messages that Foxglove and its kin understand, from plain values.

Pixels of ptzd are centred on integers; these viewers put integers on the corners of pixels, so every annotation is
moved by half a pixel here and nowhere else.
"""

from collections.abc import Iterable, Sequence
from enum import IntEnum

from ptzd.log.notes import Json, stamp

Point = tuple[float, float]
Rgba = tuple[float, float, float, float]

YELLOW: Rgba = (1.0, 0.85, 0.0, 1.0)
CYAN: Rgba = (0.0, 0.9, 1.0, 0.9)
GREEN: Rgba = (0.2, 1.0, 0.3, 1.0)
RED: Rgba = (1.0, 0.25, 0.2, 1.0)
_NOTHING: Rgba = (0.0, 0.0, 0.0, 0.0)


class Line(IntEnum):
    """How a ``foxglove.PointsAnnotation`` joins its points."""

    LOOP = 2
    STRIP = 3


def colour(rgba: Rgba) -> Json:
    """``foxglove.Color``."""
    return dict(zip("rgba", rgba, strict=True))


def _at(point: Point) -> Json:
    return {"x": point[0] + 0.5, "y": point[1] + 0.5}


def lines(t_ns: int, points: Sequence[Point], kind: Line, rgba: Rgba, thickness_px: float = 2.0) -> Json:
    """``foxglove.PointsAnnotation``: points of the original picture, px."""
    return {
        "timestamp": stamp(t_ns),
        "type": int(kind),
        "points": [_at(point) for point in points],
        "outline_color": colour(rgba),
        "outline_colors": [],
        "fill_color": colour(_NOTHING),
        "thickness": thickness_px,
        "metadata": [],
    }


def circle(t_ns: int, centre: Point, diameter_px: float, rgba: Rgba) -> Json:
    """``foxglove.CircleAnnotation``."""
    return {
        "timestamp": stamp(t_ns),
        "position": _at(centre),
        "diameter": diameter_px,
        "thickness": 2.0,
        "fill_color": colour(_NOTHING),
        "outline_color": colour(rgba),
        "metadata": [],
    }


def label(t_ns: int, position: Point, text: str, rgba: Rgba, size_px: float = 14.0) -> Json:
    """``foxglove.TextAnnotation``; its bottom left corner is at the position."""
    return {
        "timestamp": stamp(t_ns),
        "position": _at(position),
        "text": text,
        "font_size": size_px,
        "text_color": colour(rgba),
        "background_color": colour((0.0, 0.0, 0.0, 0.5)),
        "metadata": [],
    }


def annotations(
    t_ns: int, lines: Iterable[Json] = (), circles: Iterable[Json] = (), texts: Iterable[Json] = ()
) -> Json:
    """``foxglove.ImageAnnotations``; without parts it clears what was drawn before."""
    return {
        "timestamp": stamp(t_ns),
        "circles": list(circles),
        "points": list(lines),
        "texts": list(texts),
        "metadata": [],
    }
