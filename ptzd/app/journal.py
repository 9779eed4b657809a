"""The daemon's own messages: one line each on stderr, with the priority that a service manager understands."""

from __future__ import annotations

import logging
import os
import sys

_PRIORITIES = ((logging.ERROR, "<3>"), (logging.WARNING, "<4>"), (logging.INFO, "<6>"))
"""Syslog levels, see sd-daemon(3)."""


class JournalFormatter(logging.Formatter):
    """Prefix every line with its priority when stderr goes to the journal."""

    def format(self, record: logging.LogRecord) -> str:
        """One line of text."""
        line = " ".join(super().format(record).splitlines())
        return next((prefix for level, prefix in _PRIORITIES if record.levelno >= level), "<7>") + line


def set_up() -> None:
    """Send messages from INFO up to stderr; under a service manager with priorities, else with times."""
    handler = logging.StreamHandler(sys.stderr)
    under_systemd = "JOURNAL_STREAM" in os.environ
    plain = logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s")
    handler.setFormatter(JournalFormatter("%(name)s: %(message)s") if under_systemd else plain)
    logging.basicConfig(level=logging.INFO, handlers=[handler])
