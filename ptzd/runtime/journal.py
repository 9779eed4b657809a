"""Messages to the journal in its own protocol, so that they can be found by field: ``journalctl PTZD_REQUEST=gate-3``.

Source: systemd's "Native Journal Protocol": one datagram per message, ``KEY=value`` lines, values with line breaks as
key, length (64 bit little endian) and bytes.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Mapping
from pathlib import Path

from ptzd.plain import plain_lines

JOURNAL_SOCKET = Path("/run/systemd/journal/socket")

FIELDS = {"request": "PTZD_REQUEST", "rig": "PTZD_RIG", "device": "PTZD_DEVICE"}
"""Attributes of a record (given as ``extra=``) and the journal's fields for them."""

PRIORITIES = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (logging.NOTSET, 7))
"""Levels of logging and of syslog."""


def goes_to_journal(environ: Mapping[str, str], descriptor: int = 2) -> bool:
    """Whether a descriptor (stderr) is connected to the journal, as ``JOURNAL_STREAM`` (systemd.exec(5)) tells."""
    device, _, inode = environ.get("JOURNAL_STREAM", "").partition(":")
    try:
        is_now = os.fstat(descriptor)
    except OSError:
        return False
    return (device, inode) == (str(is_now.st_dev), str(is_now.st_ino))


def encode(fields: Mapping[str, str]) -> bytes:
    """One message of the protocol."""
    return b"".join(_encode_field(key, value.encode("utf-8", "replace")) for key, value in fields.items())


def _encode_field(key: str, value: bytes) -> bytes:
    if b"\n" not in value:
        return key.encode() + b"=" + value + b"\n"
    return key.encode() + b"\n" + len(value).to_bytes(8, "little") + value + b"\n"


class JournalHandler(logging.Handler):
    """Sends records to the journal without ever waiting; what it does not take goes to another handler.

    Parameters
    ----------
    fallback : logging.Handler
        Takes what the journal does not: it is full, gone, or the message is too large for a datagram.
    path : Path
        The journal's socket.
    """

    def __init__(self, fallback: logging.Handler, path: Path = JOURNAL_SOCKET) -> None:
        super().__init__()
        self._fallback = fallback
        self._path = str(path)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)

    def emit(self, record: logging.LogRecord) -> None:
        """Send one record."""
        fields = {
            "MESSAGE": self.format(record),
            "PRIORITY": str(next(priority for level, priority in PRIORITIES if record.levelno >= level)),
            "SYSLOG_IDENTIFIER": "ptzd",
            "LOGGER": record.name,
            "CODE_FILE": record.pathname,
            "CODE_LINE": str(record.lineno),
            "CODE_FUNC": record.funcName or "",
        }
        fields |= {field: str(getattr(record, name)) for name, field in FIELDS.items() if hasattr(record, name)}
        try:
            self._socket.sendto(encode({key: plain_lines(value) for key, value in fields.items()}), self._path)
        except OSError:
            self._fallback.handle(record)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
        super().close()
