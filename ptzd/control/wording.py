"""What a step of a request tells, in words."""

from __future__ import annotations

from collections.abc import Mapping

UNITS = {"_deg": "°", "_m": " m", "_baselines": " baselines", "_px": " px", "_s": " s", "_ms": " ms"}


def in_words(detail: Mapping[str, object]) -> str:
    """Return the detail of a feedback for a person, e.g. ``pan -27.95°, zoom 356``; what is empty is left out."""
    return ", ".join(_named(name, value) for name, value in detail.items() if value != "")


def _named(name: str, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{name} {value}"
    number = f"{value:.4g}" if isinstance(value, float) else str(value)
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), "")
    return f"{name.removesuffix(suffix)} {number}{UNITS.get(suffix, '')}"


def scaled(document: Mapping[str, object], *, metric: bool) -> dict[str, object]:
    """Return the document with ranges by their unit's name: of a rig without scale none ends in ``_m``.

    Candidates and results hold ranges in the unit of T, which is the baseline when the rig is not metric.
    """
    if metric:
        return dict(document)
    return {f"{name.removesuffix('_m')}_baselines" if _is_range(name) else name: v for name, v in document.items()}


def _is_range(name: str) -> bool:
    return name.startswith("range_") and name.endswith("_m")


def range_in_words(range_: float, *, metric: bool) -> str:
    """Return a range with the unit of the rig's T."""
    return f"{range_:.2f} {'m' if metric else 'baselines'}"
