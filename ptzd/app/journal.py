"""Where the daemon's own messages go: the journal with fields under a service manager, stderr otherwise."""

from __future__ import annotations

import logging
import os
import sys

from ptzd.plain import plain
from ptzd.runtime.journal import JournalHandler, goes_to_journal


class OneLine(logging.Formatter):
    """A record in one line, whatever it holds."""

    def format(self, record: logging.LogRecord) -> str:
        """Text without line breaks and control characters."""
        return plain(" ".join(super().format(record).split("\n")))


def set_up() -> None:
    """Send messages from INFO up to the journal or to stderr."""
    plain = logging.StreamHandler(sys.stderr)
    plain.setFormatter(OneLine("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    handler: logging.Handler = plain
    if goes_to_journal(os.environ):
        handler = JournalHandler(plain)
        handler.setFormatter(OneLine("%(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler], force=True)
