"""The web server of a simulated AXIS camera: routes, authentication, roles, faults in front of the CGIs."""

from __future__ import annotations

from collections import deque
from collections.abc import Awaitable, Callable
from urllib.parse import parse_qsl

import msgspec
from aiohttp import web

from ptzd.sim import device_cgi, ptz_cgi
from ptzd.sim.auth import Gate, Policy, Role, User
from ptzd.sim.control_queue import COOKIE, ControlQueue
from ptzd.sim.events import EventStream, Tokens
from ptzd.sim.faults import Fault, FaultBox, FaultKind, garbled
from ptzd.sim.parameters import select
from ptzd.sim.picture_cgi import PictureCgi
from ptzd.sim.ptz_answers import error
from ptzd.sim.ptz_request import PtzSyntax, parse
from ptzd.sim.unit import Unit
from ptzd.sim.wire import abort, html, name_server, plain

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
USER = web.RequestKey("user", User)
OPEN_PATHS = frozenset({"/axis-cgi/systemready.cgi"})
"""No credentials are asked for here."""
ASKED_KEPT = 10_000
WRITABLE = ("GuardTour.", "Image.", "PTZ.", "Network.HTTP.AuthenticationPolicy")


class CameraServer:
    """One camera's HTTP side.

    Parameters
    ----------
    unit : Unit
    gate : Gate
    pictures : PictureCgi
    faults : FaultBox
    reboot : Callable
        Called by restart.cgi.
    """

    def __init__(
        self, unit: Unit, gate: Gate, pictures: PictureCgi, faults: FaultBox, reboot: Callable[[], None]
    ) -> None:
        self._unit = unit
        self._gate = gate
        self._pictures = pictures
        self._faults = faults
        self._reboot = reboot
        self._tokens = Tokens(unit.clock)
        self._queue = ControlQueue(int(unit.parameters["PTZ.Various.V1.CtlQueueLimit"]))
        self.events = EventStream(unit)
        self.asked: deque[str] = deque(maxlen=ASKED_KEPT)
        """Requests as they came, method, page and arguments: for the side channel."""
        self.ready = True
        self.boot_id = f"{unit.settings.seed:08x}-0001"
        self._started_s = unit.clock.now_s()

    def app(self) -> web.Application:
        """The application, ready to be run."""
        app = web.Application(middlewares=[self._boot, self._fault, self._authenticate], client_max_size=2**20)
        app.on_response_prepare.append(name_server)
        for path, handler in self._routes().items():
            app.router.add_route("GET", path, handler)
            app.router.add_route("POST", path, handler)
        return app

    def restarted(self) -> None:
        """Be ready again after a restart."""
        self.ready = True
        self._started_s = self._unit.clock.now_s()
        base, _, count = self.boot_id.rpartition("-")
        self.boot_id = f"{base}-{int(count) + 1:04d}"

    def _routes(self) -> dict[str, Handler]:
        parameters = dict.fromkeys(
            ("/axis-cgi/param.cgi", *(f"/axis-cgi/{group}/param.cgi" for group in ("admin", "operator", "view"))),
            self._param,
        )
        video = dict.fromkeys(
            ("/axis-cgi/mjpg/video.cgi", "/mjpg/video.mjpg", "/mjpg/1/video.mjpg"), self._pictures.video
        )
        image = dict.fromkeys(("/axis-cgi/jpg/image.cgi", "/jpg/image.jpg", "/jpg/1/image.jpg"), self._pictures.image)
        events = {"/axis-cgi/wssession.cgi": self._session, "/vapix/ws-data-stream": self.events.serve}
        if not self._unit.profile.has_events:
            events.clear()
        return {
            "/axis-cgi/com/ptz.cgi": self._ptz,
            "/axis-cgi/com/ptzconfig.cgi": self._ptz_config,
            "/axis-cgi/com/ptzqueue.cgi": self._ptz_queue,
            **parameters,
            **video,
            **image,
            "/axis-cgi/imagesize.cgi": self._pictures.size,
            "/axis-cgi/basicdeviceinfo.cgi": self._basic_device_info,
            "/axis-cgi/apidiscovery.cgi": self._api_discovery,
            "/axis-cgi/systemready.cgi": self._system_ready,
            "/axis-cgi/usergroup.cgi": self._user_group,
            "/axis-cgi/restart.cgi": self._restart,
            **events,
        }

    @web.middleware
    async def _boot(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if not self.ready and request.path not in OPEN_PATHS:
            return html(503, "Service Unavailable")
        try:
            return await handler(request)
        except web.HTTPException as refusal:
            return html(refusal.status, refusal.reason)

    @web.middleware
    async def _fault(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        self.asked.append(f"{request.method} {request.path_qs}")
        fault = self._faults.on_request(request.path_qs, self._unit.clock.now_s())
        return await handler(request) if fault is None else await self._faulty(fault, request, handler)

    async def _faulty(self, fault: Fault, request: web.Request, handler: Handler) -> web.StreamResponse:
        clock = self._unit.clock
        match fault.kind:
            case FaultKind.HANG | FaultKind.RESET:
                if fault.kind is FaultKind.HANG:
                    await clock.sleep_until(clock.now_s() + 3600)
                return abort(request)
            case FaultKind.SLOW:
                await clock.sleep_until(clock.now_s() + fault.delay_s)
                return await handler(request)
            case FaultKind.GARBAGE:
                return _garbled(await handler(request))
            case _:
                return self._instead(fault, request)

    def _instead(self, fault: Fault, request: web.Request) -> web.Response:
        """What is sent instead of the answer."""
        now_s = self._unit.clock.now_s()
        challenges = self._gate.refusal(now_s, secure=request.secure) if fault.status == 401 else ()
        refusal = html(fault.status, "Refused", headers=[("WWW-Authenticate", line) for line in challenges])
        others = {
            FaultKind.HTML: html(200, "Index page"),
            FaultKind.ERROR_TEXT: plain(error("PTZ driver is not responding")),
            FaultKind.EMPTY: plain(""),
        }
        return others.get(fault.kind, refusal)

    @web.middleware
    async def _authenticate(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        if request.path in OPEN_PATHS or self._has_session(request):
            return await handler(request)
        self._gate.policy = Policy(self._unit.parameters["Network.HTTP.AuthenticationPolicy"])
        verdict = self._gate.check(
            self._unit.clock.now_s(),
            method=request.method,
            target=request.raw_path,
            authorization=request.headers.get("Authorization"),
            secure=request.secure,
        )
        if verdict.blocked:
            return html(403, "Forbidden")
        if verdict.user is None:
            if verdict.wrong:
                await self._unit.clock.sleep_until(self._unit.clock.now_s() + self._unit.settings.wrong_password_s)
            return html(401, "Unauthorized", headers=[("WWW-Authenticate", line) for line in verdict.challenges])
        request[USER] = verdict.user
        return await handler(request)

    def _has_session(self, request: web.Request) -> bool:
        token = request.query.get("wssession")
        return request.path == "/vapix/ws-data-stream" and token is not None and self._tokens.redeem(token)

    async def _ptz(self, request: web.Request) -> web.StreamResponse:
        user = request[USER]
        if not user.ptz:
            return html(403, "Forbidden")
        cookie = request.cookies.get(COOKIE)
        queueing = self._unit.flag("PTZ.Various.V1.CtlQueueing")
        if queueing and cookie is None:
            return _with_cookie(request)
        try:
            checked = parse(await _arguments(request), zoom_max=int(self._unit.profile.zoom.high))
        except PtzSyntax as refusal:
            return plain(error(str(refusal)))
        if queueing and not checked.only_asks and not self._in_control(cookie or "", user):
            return plain(error("Camera is controlled by another user"))
        reply = ptz_cgi.answer(self._unit, checked, user)
        return plain(reply.text, status=reply.status, content_type=reply.content_type)

    async def _ptz_config(self, request: web.Request) -> web.StreamResponse:
        user = request[USER]
        if user.role < Role.ADMINISTRATOR:
            return html(403, "Forbidden")
        reply = ptz_cgi.configure(self._unit, dict(await _arguments(request)))
        return plain(reply.text, status=reply.status)

    async def _ptz_queue(self, request: web.Request) -> web.StreamResponse:
        if not self._unit.flag("PTZ.Various.V1.CtlQueueing"):
            return plain(error("Control queue is disabled"))
        cookie = request.cookies.get(COOKIE)
        if cookie is None:
            return _with_cookie(request)
        wish, now_s = dict(await _arguments(request)).get("control"), self._unit.clock.now_s()
        if wish == "drop":
            self._queue.drop(cookie, now_s)
        elif wish == "request" and not self._queue.request(cookie, request[USER].role, now_s):
            return plain(error("Control queue is full"))
        elif wish not in ("request", "query"):
            return plain(error("control: invalid value"))
        place, wait_s = self._queue.query(cookie, now_s)
        poll_s = self._unit.parameters["PTZ.Various.V1.CtlQueuePollTime"]
        text = f'<a name="{place}"></a><a name="{wait_s}"></a><a name="{poll_s}"></a>'
        return plain(text, content_type="text/html")

    def _in_control(self, cookie: str, user: User) -> bool:
        now_s = self._unit.clock.now_s()
        return self._queue.request(cookie, user.role, now_s) and self._queue.control(cookie, now_s)

    async def _param(self, request: web.Request) -> web.StreamResponse:
        arguments = dict(await _arguments(request))
        action = arguments.pop("action", "")
        role = request[USER].role
        if action == "list":
            found, unknown = select(self._unit.parameters, arguments.get("group", ""), role)
            missing = [f"# Error: Error -1 getting param in group '{group}'" for group in unknown]
            return plain("".join(f"{line}\n" for line in [*found, *missing]))
        if action != "update":
            return plain(f"# Error: Unknown action '{action}'\n")
        if role < Role.ADMINISTRATOR:
            return html(403, "Forbidden")
        return plain(self._update({name: value for name, value in arguments.items() if name != "usergroup"}))

    def _update(self, changes: dict[str, str]) -> str:
        for name, value in changes.items():
            bare = name.removeprefix("root.")
            if bare not in self._unit.parameters or not bare.startswith(WRITABLE):
                return f"# Error: Error setting 'root.{bare}' to '{value}'!\n"
            if bare == "Network.HTTP.AuthenticationPolicy" and value not in list(Policy):
                return f"# Error: Error setting 'root.{bare}' to '{value}'!\n"
            self._unit.parameters[bare] = value
        return "OK"

    async def _basic_device_info(self, request: web.Request) -> web.StreamResponse:
        message = await _message(request)
        return _json(device_cgi.basic_device_info(self._unit.profile, message, request.get(USER)))

    async def _api_discovery(self, request: web.Request) -> web.StreamResponse:
        return _json(device_cgi.api_discovery(await _message(request)))

    async def _system_ready(self, request: web.Request) -> web.StreamResponse:
        uptime_s = self._unit.clock.now_s() - self._started_s
        message = await _message(request)
        return _json(device_cgi.system_ready(message, ready=self.ready, uptime_s=uptime_s, boot_id=self.boot_id))

    async def _user_group(self, request: web.Request) -> web.StreamResponse:
        return plain(device_cgi.user_groups(request[USER]))

    async def _restart(self, request: web.Request) -> web.StreamResponse:
        if request[USER].role < Role.ADMINISTRATOR:
            return html(403, "Forbidden")
        self._reboot()
        return html(200, "Restarting")

    async def _session(self, _request: web.Request) -> web.StreamResponse:
        return plain(self._tokens.issue())


async def _arguments(request: web.Request) -> list[tuple[str, str]]:
    """Pairs of the query and, for a POST, of the form, whatever content type the client gives it."""
    pairs = list(request.query.items())
    if request.method == "POST":
        body = (await request.read()).decode("utf-8", "replace")
        pairs += parse_qsl(body, keep_blank_values=True)
    return pairs


def _with_cookie(request: web.Request) -> web.Response:
    """Send a client that has no name in the queue once round with one."""
    headers = [("Location", request.raw_path), ("Set-Cookie", f"{COOKIE}={ControlQueue.new_cookie()}; path=/")]
    return html(302, "Found", headers=headers)


async def _message(request: web.Request) -> dict[str, object]:
    try:
        return msgspec.json.decode(await request.read(), type=dict[str, object])
    except msgspec.DecodeError:
        return {}


def _json(document: dict[str, object]) -> web.Response:
    return plain(msgspec.json.encode(document).decode(), content_type="application/json")


def _garbled(response: web.StreamResponse) -> web.StreamResponse:
    body = response.body if isinstance(response, web.Response) else None
    return plain(garbled(body.decode())) if isinstance(body, bytes) and response.status == 200 else response
