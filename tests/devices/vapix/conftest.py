"""A small AXIS camera on a socket: digest, ptz.cgi, param.cgi, MJPEG, and every fault by hand."""

from __future__ import annotations

import asyncio
import base64
import hashlib
import json
import re
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import pytest
from aiohttp import web

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix.head import VapixHead

PASSWORD = "orange-Bicycle_77"
USER = "ptzd"
DATA = Path(__file__).parents[2] / "data" / "axis_http"


class Clock:
    def now_ns(self) -> int:
        return time.monotonic_ns()

    def from_monotonic_ns(self, monotonic_ns: int) -> int:
        return monotonic_ns


def picture(number: int = 0, size_px: tuple[int, int] = (64, 48)) -> bytes:
    pixels = np.full((size_px[1], size_px[0], 3), number % 256, np.uint8)
    return cv2.imencode(".jpg", pixels)[1].tobytes()


Fault = Callable[[web.Request], Awaitable[web.StreamResponse | None]]


@dataclass
class FakeCamera:
    """Straight-line motion, position reports on request; ``faults`` by path come first."""

    challenge: Callable[[FakeCamera], list[str]] = lambda camera: [camera.digest_challenge()]
    latency_s: float = 0.05
    speed_deg_s: float = 400.0
    clamp: Callable[[float, float, float], tuple[float, float, float]] = lambda pan, tilt, zoom: (pan, tilt, zoom)
    pan_limits: tuple[float, float] = (-170.0, 170.0)
    parameters: str = (DATA / "ptz__PTZ_RESPONSE.txt").read_text()
    faults: dict[str, Fault] = field(default_factory=dict)
    nonce: str = "n0"
    fps: float = 25.0
    frame: Callable[[int], bytes] | None = None
    seen: list[str] = field(default_factory=list)
    commands: list[dict[str, str]] = field(default_factory=list)
    refused: int = 0
    challenged: int = 0
    sent_pictures: int = 0
    streams: int = 0
    _way: tuple[float, tuple[float, ...], tuple[float, ...]] = (0.0, (0.0, 0.0, 1.0), (0.0, 0.0, 1.0))
    url: str = ""
    boot_id: str = "first"
    ready: bool = True

    def digest_challenge(self, stale: bool = False) -> str:
        tail = ", stale=true" if stale else ""
        return f'Digest realm="AXIS_ACCC8E000000", nonce="{self.nonce}", algorithm=MD5, qop="auth"{tail}'

    def place(self) -> tuple[float, float, float]:
        """Where the head is now."""
        start_s, origin, target = self._way
        elapsed = max(0.0, time.monotonic() - start_s - self.latency_s)
        steps = (self.speed_deg_s, self.speed_deg_s, self.speed_deg_s * 50)
        return tuple(
            a + max(-v * elapsed, min(v * elapsed, b - a)) for a, b, v in zip(origin, target, steps, strict=True)
        )

    def go(self, pan: float, tilt: float, zoom: float) -> None:
        """Somebody moves the head."""
        self._way = (time.monotonic(), self.place(), self.clamp(pan, tilt, zoom))

    def halt(self) -> None:
        here = self.place()
        self._way = (time.monotonic(), here, here)

    async def handle(self, request: web.Request) -> web.StreamResponse:
        self.seen.append(request.path_qs)
        fault = self.faults.get(request.path)
        answer = None if fault is None else await fault(request)
        if answer is not None:
            return answer
        if request.path == "/axis-cgi/systemready.cgi":
            ready = {"systemready": "yes" if self.ready else "no", "bootid": self.boot_id}
            return web.json_response({"apiVersion": "1.0", "data": ready})
        if not self._authorized(request):
            headers = [("WWW-Authenticate", value) for value in self.challenge(self)]
            return web.Response(status=401, headers=headers, text="<html>401</html>", content_type="text/html")
        return await self._page(request)

    def _authorized(self, request: web.Request) -> bool:
        header = request.headers.get("Authorization")
        if header is None:
            self.challenged += 1
            return False
        if header.startswith("Basic "):
            good = base64.b64decode(header[6:]).decode() == f"{USER}:{PASSWORD}"
        else:
            good = self._digest_good(request, header)
        self.refused += not good
        return good

    def _digest_good(self, request: web.Request, header: str) -> bool:
        fields = {k: q or b for k, q, b in re.findall(r'(\w+)=(?:"([^"]*)"|([^\s,]+))', header)}

        def md5(text: str) -> str:
            return hashlib.md5(text.encode()).hexdigest()

        assert fields["uri"] == request.raw_path
        if fields["nonce"] != self.nonce:
            return False
        key = md5(f"{fields['username']}:{fields['realm']}:{PASSWORD}")
        parts = (key, fields["nonce"], fields["nc"], fields["cnonce"], "auth", md5(f"{request.method}:{fields['uri']}"))
        return fields["response"] == md5(":".join(parts))

    async def _page(self, request: web.Request) -> web.StreamResponse:
        match request.path:
            case "/axis-cgi/com/ptz.cgi":
                return self._ptz(dict(request.query))
            case "/axis-cgi/param.cgi":
                return web.Response(text=self.parameters)
            case "/axis-cgi/basicdeviceinfo.cgi":
                text = (DATA / "basic_device_info__GET_ALL_PROPERTIES_RESPONSE.json").read_text()
                return web.json_response(json.loads(text))
            case "/axis-cgi/mjpg/video.cgi" | "/fisheye.mjpg":
                return await self.stream(request)
        return web.Response(status=404)

    def _ptz(self, query: dict[str, str]) -> web.Response:
        if "query" in query:
            return self._query(query["query"])
        self.commands.append(query)
        if "pan" in query:
            self.go(float(query["pan"]), float(query["tilt"]), float(query["zoom"]))
        if query.get("continuouspantiltmove") == "0,0" or query.get("move") == "stop":
            self.halt()
        return web.Response(status=204)

    def _query(self, query: str) -> web.Response:
        pan, tilt, zoom = self.place()
        answers = {
            "position": f"pan={pan:.4f}\r\ntilt={tilt:.4f}\r\nzoom={zoom:.0f}\r\niris=6427\r\nautofocus=on\r\n",
            "limits": f"MinPan={self.pan_limits[0]}\r\nMaxPan={self.pan_limits[1]}\r\nMinTilt=-20\r\nMaxTilt=90\r\n"
            "MinZoom=1\r\nMaxZoom=9999\r\nMinFieldAngle=22\r\nMaxFieldAngle=623\r\n",
            "speed": "speed=100\r\n",
        }
        return web.Response(text=answers.get(query, f"Error:\r\nquery: unknown value: {query}\r\n"))

    async def stream(self, request: web.Request) -> web.StreamResponse:
        self.streams += 1
        response = web.StreamResponse(headers={"Content-Type": "multipart/x-mixed-replace; boundary=myboundary"})
        await response.prepare(request)
        try:
            while True:
                body = (self.frame or picture)(self.sent_pictures)
                self.sent_pictures += 1
                head = f"--myboundary\r\nContent-Type: image/jpeg\r\nContent-Length: {len(body)}\r\n\r\n"
                await response.write(head.encode() + body + b"\r\n")
                await asyncio.sleep(1 / self.fps)
        except ConnectionError:
            return response


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
async def serve():
    """Put a camera on a free port of the loopback; ``down`` and ``up`` are power cuts."""
    runners: list[web.AppRunner] = []

    async def start(camera: FakeCamera, port: int = 0) -> FakeCamera:
        app = web.Application()
        app.router.add_route("*", "/{tail:.*}", camera.handle)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=0.01, handler_cancellation=True)
        await runner.setup()
        runners.append(runner)
        site = web.TCPSite(runner, "127.0.0.1", port)
        await site.start()
        camera.url = f"http://127.0.0.1:{runner.addresses[0][1]}"
        camera.down = runner.cleanup
        return camera

    yield start
    for runner in runners:
        await runner.cleanup()


@pytest.fixture
async def camera(serve) -> FakeCamera:
    return await serve(FakeCamera())


@pytest.fixture
def password_file(tmp_path) -> Path:
    path = tmp_path / "password"
    path.write_text(PASSWORD + "\n")
    return path


@pytest.fixture
def settings_for(password_file):
    def make(camera: FakeCamera, **changes) -> Ptz:
        values = {
            "url": camera.url, "user": USER, "password_file": str(password_file), "size_px": (64, 48), "fps": 25.0,
            "poll_hz": 25.0, "settle_s": 0.05, "image_latency_s": 0.01, "report_lag_s": 0.01, "stall_s": 5.0,
            "move_spacing_s": 0.02,
        }  # fmt: skip
        return Ptz(**(values | changes))

    return make


@pytest.fixture
async def head(camera, settings_for, clock):
    async with VapixHead(settings_for(camera), Limits(), clock, jitter=lambda: 0.5) as head:
        await head.describe()
        yield head


@pytest.fixture
def eventually():
    """Waits for what is seen by looking only; a loaded machine is slow, a hang is a failure."""

    async def wait(condition: Callable[[], bool]) -> None:
        async with asyncio.timeout(100):
            while not condition():  # noqa: ASYNC110
                await asyncio.sleep(0.005)

    return wait


@pytest.fixture
def make_picture():
    return picture
