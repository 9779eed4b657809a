"""What a step of a request tells, in words."""

from __future__ import annotations

from collections.abc import Mapping

UNITS = {"_deg": "°", "_m": " m", "_px": " px", "_s": " s", "_ms": " ms"}


def in_words(detail: Mapping[str, object]) -> str:
    """Return the detail of a feedback for a person, e.g. ``pan -27.95°, zoom 356``; what is empty is left out."""
    return ", ".join(_named(name, value) for name, value in detail.items() if value != "")


def _named(name: str, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return f"{name} {value}"
    number = f"{value:.4g}" if isinstance(value, float) else str(value)
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix)), "")
    return f"{name.removesuffix(suffix)} {number}{UNITS.get(suffix, '')}"
