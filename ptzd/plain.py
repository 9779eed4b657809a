"""Text of strangers on its way to a terminal or a journal: what would steer these is written out instead.

Escape sequences can clear a screen, retitle a window or hide what stands there; line separators make one line look like
two; direction marks make it read backwards; a lone surrogate cannot be written at all.
"""

from __future__ import annotations

import re

_STEERING = r"\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_IN_LINES = re.compile(f"[{_STEERING}]")
_IN_A_LINE = re.compile(rf"[{_STEERING}\n]")


def plain(text: str) -> str:
    r"""One line with every control character written out as ``\u001b``, which is also what JSON has for it."""
    return _IN_A_LINE.sub(_written_out, text)


def plain_lines(text: str) -> str:
    """Lines, each as by :func:`plain`."""
    return _IN_LINES.sub(_written_out, text)


def _written_out(found: re.Match[str]) -> str:
    return f"\\u{ord(found[0]):04x}"
