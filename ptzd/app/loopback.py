"""A TCP port of the loopback interface for a server that is told its port beforehand, as Zenoh is."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def reserved_port() -> Iterator[int]:
    """Keep a port for one server, which may bind it as often as it likes while this lasts.

    The port stays bound to a socket that never listens: whoever asks the kernel for any port, or connects from one,
    is given another, while a server that reuses addresses (Zenoh, asyncio and aiohttp do) binds it all the same. Until
    one listens, connections are refused.

    Yields
    ------
    int
        The port's number.
    """
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        holder.bind(("127.0.0.1", 0))
        yield int(holder.getsockname()[1])
