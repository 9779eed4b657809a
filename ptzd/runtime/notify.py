"""What the service manager is told, over its datagram socket (``sd_notify(3)``): ready, status, alive, stopping.

Nothing here waits and nothing here fails: a manager that does not listen must not stop a rig. Its queue holds ten
messages by default, so the socket is non-blocking and what does not fit is dropped and counted.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from types import TracebackType
from typing import Self

PINGS_PER_PERIOD = 3
"""How often the watchdog is fed within the time after which it bites: two may be lost."""


class Notifier:
    """The line to the service manager; without one (a shell, a test) every call does nothing.

    Parameters
    ----------
    environ : Mapping
        The process environment: ``NOTIFY_SOCKET``, ``WATCHDOG_USEC``, ``WATCHDOG_PID``.

    Attributes
    ----------
    dropped : int
        Messages that the manager did not take.
    """

    def __init__(self, environ: Mapping[str, str]) -> None:
        self.dropped = 0
        name = environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + name[1:] if name.startswith("@") else name
        self._watchdog_s = _watchdog_s(environ)
        self._socket: socket.socket | None = None
        self._status = ""
        self._is_ready = False

    def __enter__(self) -> Self:
        if self._address:
            kind = socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK
            self._socket = socket.socket(socket.AF_UNIX, kind)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @property
    def ping_every_s(self) -> float | None:
        """How often :meth:`alive` is wanted, in s; None when no watchdog watches this process."""
        return None if self._watchdog_s is None else self._watchdog_s / PINGS_PER_PERIOD

    def ready(self, status: str) -> None:
        """Requests can be served."""
        self._status, self._is_ready = status, True
        self._send(READY="1", STATUS=status)

    def status(self, text: str) -> None:
        """One line for ``systemctl status``; the same text again is not sent again."""
        if text != self._status:
            self._status = text
            self._send(STATUS=text)

    def alive(self) -> None:
        """Feed the watchdog."""
        self._send(WATCHDOG="1")

    def reloading(self) -> None:
        """Settings are being read again; :meth:`reloaded` ends it. Before :meth:`ready` nobody waits for that."""
        if self._is_ready:
            self._send(RELOADING="1", MONOTONIC_USEC=str(time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000))

    def reloaded(self, status: str) -> None:
        """The settings were read again, with this outcome."""
        if self._is_ready:
            self.ready(status)

    def stopping(self, status: str) -> None:
        """The daemon is on its way out."""
        self._status = status
        self._send(STOPPING="1", STATUS=status)

    def _send(self, **fields: str) -> None:
        if self._socket is None:
            return
        message = "\n".join(f"{key}={' '.join(value.splitlines())}" for key, value in fields.items())
        try:
            self._socket.sendto(message.encode(), self._address)
        except OSError:
            self.dropped += 1


def _watchdog_s(environ: Mapping[str, str]) -> float | None:
    microseconds = environ.get("WATCHDOG_USEC", "")
    watched = environ.get("WATCHDOG_PID", str(os.getpid()))
    if not microseconds.isdecimal() or int(microseconds) == 0 or watched != str(os.getpid()):
        return None
    return int(microseconds) / 1e6
