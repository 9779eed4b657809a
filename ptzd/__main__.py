"""``python -m ptzd``."""

from __future__ import annotations

import sys

from ptzd.cli import entry

if __name__ == "__main__":
    sys.exit(entry())
