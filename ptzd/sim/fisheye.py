"""The simulated fisheye: an MJPEG stream over plain HTTP, one lens, one place, no user."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from types import TracebackType

from aiohttp import web

from ptzd.geometry.types import CameraModel
from ptzd.sim.clock import SimClock
from ptzd.sim.faults import FaultBox, FaultKind
from ptzd.sim.imager import Noise, Pixels, encode
from ptzd.sim.mjpeg_out import serve_stream, spoilt
from ptzd.sim.programs import HEARTBEAT_S
from ptzd.sim.settings import SimSettings
from ptzd.sim.stream import Darkroom, ShotLog, Stream
from ptzd.sim.wire import Network, abort, html

STREAM_PATH = "/fisheye.mjpg"
STILL_PATH = "/fisheye.jpg"


class FisheyeCamera:
    """Serves :data:`STREAM_PATH` and :data:`STILL_PATH`.

    Parameters
    ----------
    settings : SimSettings
    draw : Callable
        Gives the scene as the lens draws it, (H, W, 3) uint8 without noise; called once, for the first picture.
    camera : CameraModel
        The lens.
    clock : SimClock
    """

    def __init__(self, settings: SimSettings, draw: Callable[[], Pixels], camera: CameraModel, clock: SimClock) -> None:
        self.settings = settings
        self.camera = camera
        self.faults = FaultBox()
        self.shots = ShotLog()
        self.port = 0
        self._clock = clock
        self._draw = draw
        self._picture: Pixels | None = None
        self._noise = Noise(settings.fisheye_noise_sigma, settings.seed + 1, camera.size_px)
        self._darkroom = Darkroom()
        self._stream = Stream(
            self._develop,
            clock,
            fps=settings.fisheye_fps,
            exposure_s=settings.exposure_s,
            latency_s=settings.fisheye_latency_s,
        )
        app = web.Application(middlewares=[self._fault])
        app.router.add_get(STREAM_PATH, self._video)
        app.router.add_get(STILL_PATH, self._still)
        self._network = Network(app, settings.host, clock)
        self._watcher: asyncio.Task[None] | None = None

    async def __aenter__(self) -> FisheyeCamera:
        (self.port,) = await self._network.open((self.settings.fisheye_port, None))
        self._watcher = asyncio.create_task(self._watch(), name="sim fisheye faults")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._watcher is not None:
            self._watcher.cancel()
            await asyncio.gather(self._watcher, return_exceptions=True)
        await self._network.close()
        self._darkroom.close()

    async def _watch(self) -> None:
        """Carry out the faults that happen once."""
        while True:
            now_s = self._clock.now_s()
            for fault in self.faults.due(now_s):
                await self._network.be_away(fault.for_s)
            await self._clock.sleep_until(now_s + HEARTBEAT_S)

    async def unplug(self) -> None:
        """Cut every connection and refuse new ones."""
        await self._network.lose()

    async def plug_in(self) -> None:
        """Be there again, on the same port."""
        await self._network.restore()

    @property
    def url(self) -> str:
        """Address of the stream."""
        return f"http://{self.settings.host}:{self.port}{STREAM_PATH}"

    def _jpeg(self) -> bytes:
        if self._picture is None:
            self._picture = self._draw()
        return encode(self._noise.on(self._picture), self.settings.fisheye_quality)

    async def _develop(self, t_s: float) -> bytes:
        jpeg = await self._darkroom.run(self._jpeg)
        self.shots.add(jpeg, t_s, None)
        return jpeg

    @web.middleware
    async def _fault(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        fault = self.faults.on_request(request.path_qs, self._clock.now_s())
        match fault.kind if fault else None:
            case FaultKind.RESET:
                return abort(request)
            case FaultKind.HANG:
                await asyncio.Event().wait()
            case FaultKind.SLOW if fault:
                await self._clock.sleep_until(self._clock.now_s() + fault.delay_s)
            case FaultKind.STATUS if fault:
                return html(fault.status, "Refused")
            case _:
                pass
        return await handler(request)

    async def _video(self, request: web.Request) -> web.StreamResponse:
        return await serve_stream(request, self._stream, clock=self._clock, faults=self.faults, rfc_boundary=True)

    async def _still(self, request: web.Request) -> web.StreamResponse:
        t_s = self._clock.now_s()
        jpeg = await self._develop(t_s)
        fault = self.faults.on_picture(request.path_qs, t_s)
        if fault is not None:
            jpeg = spoilt(jpeg, fault.kind, 0)
        return web.Response(body=jpeg, headers={"Content-Type": "image/jpeg"})
