"""One HTTP session to one camera: authorization, time stamps, and every failure as one of three errors.

* :class:`DeviceLost`: no answer, the connection is cut, 5xx.
* :class:`DeviceRefused`: 401, 403, another certificate, a redirect elsewhere, ``Error:`` in a 200.
* :class:`DeviceGarbled`: an answer that cannot be understood.

A refused password or right is remembered: for a minute nothing is sent, unless other credentials are given.
Messages never hold a header, since headers hold the authorization.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from types import TracebackType
from typing import Generic, Self, TypeVar

import aiohttp
from yarl import URL

from ptzd.devices.vapix.address import Address, is_usable
from ptzd.devices.vapix.answers import Reply
from ptzd.devices.vapix.auth import Attempt, Authenticator
from ptzd.devices.vapix.credentials import Credentials
from ptzd.devices.vapix.failures import (
    ConnectionCut,
    FailuresNamed,
    Forbidden,
    NotOffered,
    Overloaded,
    PageFails,
    RefusedAccess,
)
from ptzd.devices.vapix.requests import Request
from ptzd.errors import DeviceGarbled, DeviceLost, DeviceRefused
from ptzd.ports import Clock

T = TypeVar("T")

CONNECT_TIMEOUT_S = 3.0
REFUSAL_PAUSE_S = 60.0
"""After a refused password or right: a camera blocks or slows down clients that try again at once."""
MAX_ANSWER_BYTES = 1_000_000
MAX_ROUNDS = 4
"""Requests for one answer: a challenge, an expired nonce, a redirect within the camera."""
_REDIRECTS = frozenset({301, 302, 303, 307, 308})


@dataclass(frozen=True, slots=True, kw_only=True)
class Exchange(Generic[T]):
    """An answer with the times of the round trip that brought it, ns on the daemon's clock."""

    value: T
    sent_ns: int
    received_ns: int


class CameraClient:
    """Sends requests to one camera.

    Parameters
    ----------
    address : Address
    clock : Clock
        Stamps the exchanges.
    refusal_pause_s : float
        How long nothing is sent after a refusal.
    only_asks : bool
        Send nothing that moves or changes the camera.
    """

    def __init__(
        self,
        address: Address,
        clock: Clock,
        *,
        refusal_pause_s: float = REFUSAL_PAUSE_S,
        only_asks: bool = False,
    ) -> None:
        self._only_asks = only_asks
        self._base = address.base()
        self._fingerprint = address.fingerprint()
        self._address = address
        self._clock = clock
        self._refusal_pause_s = refusal_pause_s
        self._credentials: Credentials | None = None
        self._auth = self._authenticator(None)
        self._refusals: dict[str, tuple[RefusedAccess, float]] = {}
        self._session: aiohttp.ClientSession | None = None

    @property
    def origin(self) -> str:
        """Scheme, host and port, for messages."""
        return str(self._base.origin())

    async def __aenter__(self) -> Self:
        self._session = aiohttp.ClientSession(
            cookie_jar=aiohttp.CookieJar(unsafe=True),  # also for addresses: the control queue wants its cookie back
            connector=aiohttp.TCPConnector(limit_per_host=6, ssl=self._fingerprint or True),
            headers={"User-Agent": "ptzd", "Accept-Encoding": "identity"},
        )
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._session is not None:
            await self._session.close()
            self._session = None

    def use(self, credentials: Credentials | None) -> None:
        """Ask as this user from now on; other credentials than before end the pause after a refusal."""
        if credentials != self._credentials:
            self._credentials = credentials
            self._auth = self._authenticator(credentials)
            self._refusals.clear()

    def _authenticator(self, credentials: Credentials | None) -> Authenticator:
        basic_allowed = self._base.scheme == "https" or self._address.allow_basic_over_http
        return Authenticator(credentials, basic_allowed=basic_allowed, setting=self._address.setting)

    async def send(self, request: Request[T]) -> T:
        """Send a request and return what its answer says.

        Raises
        ------
        DeviceLost, DeviceRefused, DeviceGarbled
            As in the module's docstring; the message names camera and page.
        """
        return (await self.exchange(request)).value

    async def exchange(self, request: Request[T]) -> Exchange[T]:
        """Like :meth:`send`, with the times of the round trip."""
        if self._only_asks and request.orders:
            raise DeviceRefused(f"{self.origin}{request.name}: not sent, this daemon is a shadow and moves nothing")
        for remaining in reversed(range(request.attempts)):
            try:
                return await self._exchange(request)
            except ConnectionCut:
                if not remaining:
                    raise
        raise AssertionError("a request has at least one attempt")

    async def _exchange(self, request: Request[T]) -> Exchange[T]:
        patience = aiohttp.ClientTimeout(total=request.timeout_s, sock_connect=CONNECT_TIMEOUT_S)
        with self._failures_named(request):
            async with self._answered(request, patience) as (response, sent_ns):
                body = await _limited_body(response)
                received_ns = self._clock.now_ns()
            reply = Reply(status=response.status, content_type=response.content_type, text=_text(body))
            return Exchange(value=request.parse(reply), sent_ns=sent_ns, received_ns=received_ns)

    @asynccontextmanager
    async def stream(self, request: Request[None], stall_s: float) -> AsyncIterator[aiohttp.ClientResponse]:
        """Open an endless answer; reading from it raises :class:`DeviceLost` after ``stall_s`` without a byte."""
        patience = aiohttp.ClientTimeout(total=None, sock_connect=CONNECT_TIMEOUT_S, sock_read=stall_s)
        with self._failures_named(request):
            async with self._answered(request, patience) as (response, _):
                yield response

    @asynccontextmanager
    async def websocket(self, path: str, params: dict[str, str]) -> AsyncIterator[aiohttp.ClientWebSocketResponse]:
        """Open a WebSocket; a token in the parameters stands for the authorization."""
        session = self._open_session()
        request = Request(path=path, parse=lambda _: None)
        with self._failures_named(request):
            async with session.ws_connect(self._base.with_path(path).with_query(params), heartbeat=10.0) as socket:
                yield socket

    @asynccontextmanager
    async def _answered(
        self, request: Request[T], patience: aiohttp.ClientTimeout
    ) -> AsyncIterator[tuple[aiohttp.ClientResponse, int]]:
        """The response after challenges and redirects, and when its request was sent."""
        session, url = self._open_session(), self._url(request)
        data = None if request.document is None else json.dumps(request.document)
        for _ in range(MAX_ROUNDS):
            self._respect_refusals(request.path)
            attempt = self._auth.attempt(request.method, url.raw_path_qs)
            headers = {} if attempt is None else {"Authorization": attempt.value}
            if data is not None:
                headers["Content-Type"] = "application/json"
            sent_ns = self._clock.now_ns()
            async with session.request(
                request.method, url, data=data, headers=headers, timeout=patience, allow_redirects=False
            ) as response:
                if response.status == 401:
                    self._challenged(attempt, response, request)
                    continue
                self._auth.accepted(attempt)
                if response.status in _REDIRECTS:
                    url = self._redirected(url, response, request)
                    continue
                self._check_status(response, request)
                yield response, sent_ns
                return
        raise DeviceRefused(f"asks {MAX_ROUNDS} times for another authorization or page")

    def _open_session(self) -> aiohttp.ClientSession:
        if self._session is None:
            raise DeviceLost("the connection is not open")
        return self._session

    def _url(self, request: Request[T]) -> URL:
        url = self._base.join(URL(request.path, encoded=True)) if request.path else self._base
        return url.with_query(request.params) if request.params else url

    def _respect_refusals(self, path: str) -> None:
        """Raise what was refused less than a minute ago: the account everywhere, a missing right on its page."""
        now_s = asyncio.get_running_loop().time()
        for place in ("", path):
            error, until_s = self._refusals.get(place, (None, 0.0))
            if error is not None and now_s < until_s:
                raise type(error)(str(error))

    def _remember(self, place: str, error: RefusedAccess) -> RefusedAccess:
        self._refusals[place] = (error, asyncio.get_running_loop().time() + self._refusal_pause_s)
        return type(error)(str(error))

    def _refusal(self, request: Request[T], reason: str) -> str:
        pause = f"asked again after {self._refusal_pause_s:g} s or with another password"
        return f"{self.origin}{request.name}: {reason}; {pause}"

    def _challenged(self, attempt: Attempt | None, response: aiohttp.ClientResponse, request: Request[T]) -> None:
        try:
            self._auth.challenged(attempt, response.headers.getall("WWW-Authenticate", []))
        except DeviceRefused as error:
            place = request.path if self._auth.trusted else ""
            raise self._remember(place, RefusedAccess(self._refusal(request, str(error)))) from None

    def _redirected(self, url: URL, response: aiohttp.ClientResponse, request: Request[T]) -> URL:
        """Where to ask next; elsewhere is refused with what the setting would be: the page too if it names one."""
        location = response.headers.get("Location", "").strip()
        if not location:
            raise DeviceGarbled(f"redirects ({response.status}) and does not say where to; correct it in the camera")
        try:
            target = url.join(URL(location))
            elsewhere = target.origin() != self._base.origin()
        except ValueError:
            raise _no_address(location) from None
        if elsewhere:
            if not is_usable(target):
                raise _no_address(location)
            page_is_set = request.path == self._base.raw_path_qs
            advised = self._shown_page(target) if page_is_set else str(target.origin())
            raise DeviceRefused(f"redirects to {advised}; if that is right, set it as {self._address.setting}.url")
        return target

    def _shown_page(self, target: URL) -> str:
        """A page for messages: its query may be secret and is told by where it is to be had."""
        shown = _without_secrets(str(target.with_user(None)))
        if not target.raw_query_string:
            return shown
        if target.raw_query_string == self._base.raw_query_string:
            return f"{shown} with the query that {self._address.setting}.url has"
        return f"{shown} with another query, which may be secret and is not shown (curl -I tells it)"

    def _check_status(self, response: aiohttp.ClientResponse, request: Request[T]) -> None:
        status = response.status
        if status in {200, 204}:
            return
        if status == 403:
            user = "" if self._credentials is None else self._credentials.user
            reason = f"user {user!r} has no right to this page (403); give the account the operator role"
            raise self._remember(request.path, Forbidden(self._refusal(request, reason)))
        if status in {404, 405}:
            raise NotOffered(f"does not offer this ({status})")
        if status == 503:
            raise Overloaded("overloaded or starting (503)", _seconds(response.headers.get("Retry-After")))
        if status >= 500:
            raise PageFails(f"fails ({status})")
        raise DeviceRefused(f"answers {status}")

    def _failures_named(self, request: Request[T]) -> FailuresNamed:
        return FailuresNamed(f"{self.origin}{request.name}", self._address.setting)


async def _limited_body(response: aiohttp.ClientResponse) -> bytes:
    body = bytearray()
    async for chunk in response.content.iter_any():
        body += chunk
        if len(body) > MAX_ANSWER_BYTES:
            raise DeviceGarbled(f"answer is longer than {MAX_ANSWER_BYTES} bytes")
    return bytes(body)


def _no_address(location: str) -> DeviceGarbled:
    shown = _without_secrets(location).encode("ascii", "backslashreplace").decode()
    return DeviceGarbled(f"redirects to {shown!r}, which is no address; correct it in the camera")


def _without_secrets(location: str) -> str:
    """An address, valid or not, without query, fragment, user and password."""
    place = location.partition("?")[0].partition("#")[0]
    scheme, slashes, rest = place.partition("//") if "//" in place else ("", "", place)
    return scheme + slashes + rest.rpartition("@")[2]


def _text(body: bytes) -> str:
    try:
        return body.decode("utf-8")
    except UnicodeDecodeError:
        return body.decode("latin-1")  # PTZ.ResponseEncoding of older firmware


def _seconds(text: str | None) -> float | None:
    return float(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 6 else None
