"""HTTP pieces that the simulated devices share: raw streams, plain bodies, listeners that can go away and come back."""

from __future__ import annotations

import asyncio
import socket
import ssl
from collections.abc import Iterable

from aiohttp import web

from ptzd.errors import SimulationError
from ptzd.sim.clock import SimClock

SERVER_NAME = "Apache/2.4.46 (Unix) OpenSSL/1.1.1k"
BOUNDARY = "myboundary"


class RawStream(web.StreamResponse):
    """A response without length and without chunks that lasts until the connection closes."""

    _length_check = False


def plain(body: str, *, status: int = 200, content_type: str = "text/plain") -> web.Response:
    """Text without a charset in its content type, as the camera sends it."""
    headers = {"Content-Type": content_type, "Cache-Control": "no-cache"}
    return web.Response(status=status, body=body.encode(), headers=headers)


def html(status: int, reason: str, *, headers: Iterable[tuple[str, str]] = ()) -> web.Response:
    """The small HTML page of an error."""
    body = (
        '<!DOCTYPE HTML PUBLIC "-//IETF//DTD HTML 2.0//EN">\n<html><head>\n'
        f"<title>{status} {reason}</title>\n</head><body>\n<h1>{reason}</h1>\n</body></html>\n"
    )
    response = web.Response(status=status, body=body.encode(), headers={"Content-Type": "text/html"})
    for name, value in headers:
        response.headers.add(name, value)
    return response


def abort(request: web.Request) -> web.Response:
    """Cut the connection of a request at once; the response returned is never sent."""
    if request.transport is not None:
        request.transport.abort()
    return web.Response(status=500)


async def name_server(_request: web.Request, response: web.StreamResponse) -> None:
    """Signal handler: the server's name is the camera's."""
    response.headers["Server"] = SERVER_NAME


class Listener:
    """A port that stays reserved while nobody listens on it: then connections are refused.

    Parameters
    ----------
    runner : web.AppRunner
        Set up already.
    host : str
    port : int
        0: any free one.
    tls : ssl.SSLContext, optional
    """

    def __init__(self, runner: web.AppRunner, host: str, port: int, tls: ssl.SSLContext | None = None) -> None:
        self._runner = runner
        self._host = host
        self._tls = tls
        self._site: web.SockSite | None = None
        self._reserved: socket.socket | None = None
        self.port = port

    async def open(self) -> None:
        """Start to listen unless it does; the first time, reserve the port.

        Raises
        ------
        SimulationError
            When the port is taken, with host and port.
        """
        if self._reserved is None:
            if self.port:
                _bound(self._host, self.port, shared=False).close()
            self._reserved = _bound(self._host, self.port, shared=True)
            self.port = self._reserved.getsockname()[1]
        if self._site is not None:
            return
        self._site = web.SockSite(self._runner, _bound(self._host, self.port, shared=True), ssl_context=self._tls)
        await self._site.start()

    async def shut(self) -> None:
        """Refuse new connections; the present ones stay."""
        if self._site is not None:
            await self._site.stop()
            self._site = None

    def close(self) -> None:
        """Give the port back."""
        if self._reserved is not None:
            self._reserved.close()


def _bound(host: str, port: int, *, shared: bool) -> socket.socket:
    """A bound socket; only sockets that are `shared` (SO_REUSEPORT) may have the same port."""
    bound = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, int(shared))
        bound.bind((host, port))
    except OSError as error:
        bound.close()
        raise SimulationError(f"cannot listen on {host}:{port}: {error.strerror}; give another port") from error
    return bound


async def drop_connections(runner: web.AppRunner) -> None:
    """Cut every open connection, as a loss of power does."""
    if runner.server is not None:
        for connection in runner.server.connections:
            if connection.transport is not None:
                connection.transport.abort()
    await asyncio.sleep(0)


class Network:
    """The web server of one device with its ports; it can be lost and come back on the same ports.

    Parameters
    ----------
    app : web.Application
    host : str
    clock : SimClock
    """

    def __init__(self, app: web.Application, host: str, clock: SimClock) -> None:
        self._runner = web.AppRunner(app, handler_cancellation=True, shutdown_timeout=0.1, access_log=None)
        self._host = host
        self._clock = clock
        self._listeners: list[Listener] = []

    async def open(self, *ports: tuple[int, ssl.SSLContext | None]) -> list[int]:
        """Listen on ports (0: any free one), with TLS where a context is given; returns their numbers."""
        await self._runner.setup()
        try:
            for port, tls in ports:
                self._listeners.append(Listener(self._runner, self._host, port, tls))
                await self._listeners[-1].open()
        except BaseException:
            await self.close()
            raise
        return [listener.port for listener in self._listeners]

    async def lose(self) -> None:
        """Cut every connection and refuse new ones."""
        for listener in self._listeners:
            await listener.shut()
        await drop_connections(self._runner)

    async def restore(self) -> None:
        """Listen again."""
        for listener in self._listeners:
            await listener.open()

    async def be_away(self, for_s: float | None) -> None:
        """Be lost for a while; None: until :meth:`restore`."""
        await self.lose()
        if for_s is not None:
            await self._clock.sleep_until(self._clock.now_s() + for_s)
            await self.restore()

    async def close(self) -> None:
        """End everything and give the ports back."""
        await self.lose()
        await self._runner.cleanup()
        for listener in self._listeners:
            listener.close()


class ViewerLimit:
    """Counts viewers and different configurations; the camera answers 503 above its limits."""

    def __init__(self, max_viewers: int, max_configurations: int) -> None:
        self._max_viewers = max_viewers
        self._max_configurations = max_configurations
        self._viewers: dict[object, int] = {}

    @property
    def viewers(self) -> int:
        """How many look."""
        return sum(self._viewers.values())

    def enter(self, configuration: object) -> bool:
        """Take a place; False when there is none."""
        new = configuration not in self._viewers
        if self.viewers >= self._max_viewers or (new and len(self._viewers) >= self._max_configurations):
            return False
        self._viewers[configuration] = self._viewers.get(configuration, 0) + 1
        return True

    def leave(self, configuration: object) -> None:
        """Give the place back."""
        self._viewers[configuration] -= 1
        if not self._viewers[configuration]:
            del self._viewers[configuration]
