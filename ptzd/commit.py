"""Which code this is: the commit it was built from, or the checkout it runs in."""

from __future__ import annotations

import subprocess
from functools import cache
from importlib import resources
from pathlib import Path

FILE = "commit.txt"
"""Written into built packages by setup.py."""
_PATIENCE_S = 2.0


@cache
def commit() -> str:
    """Return git's short hash, with ``-dirty`` where files differ from it; empty when nobody knows."""
    checkout = Path(__file__).parents[1]
    if (checkout / ".git").exists():
        return _described(checkout)
    written = resources.files("ptzd") / FILE
    return written.read_text().strip() if written.is_file() else ""


def _described(checkout: Path) -> str:
    command = ["git", "-C", str(checkout), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S, check=True)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
