"""image.cgi, video.cgi and imagesize.cgi."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

from aiohttp import web

from ptzd.sim.exposure import exposure_at
from ptzd.sim.faults import FaultBox
from ptzd.sim.imager import PtzEye, quality_of
from ptzd.sim.mjpeg_out import serve_stream, spoilt
from ptzd.sim.stream import Darkroom, ShotLog, Stream
from ptzd.sim.unit import Unit
from ptzd.sim.wire import ViewerLimit, html, plain


class PictureSyntax(Exception):
    """An argument of a picture request that the camera does not take."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureKind:
    """What makes one stream differ from another."""

    size_px: tuple[int, int]
    compression: int
    rotation: int
    fps: float


def picture_kind(unit: Unit, query: Mapping[str, str]) -> PictureKind:
    """Read the arguments of image.cgi and video.cgi; what is absent comes from the parameters.

    Raises
    ------
    PictureSyntax
        With the argument's name and value.
    """
    appearance = "Image.I0.Appearance."
    resolution = query.get("resolution", unit.parameters[f"{appearance}Resolution"])
    if resolution not in unit.profile.resolutions:
        raise PictureSyntax(f"resolution: {resolution}")
    if query.get("camera", "1") != "1":
        raise PictureSyntax(f"camera: {query['camera']}")
    rotation = _number(query, "rotation", unit.parameters[f"{appearance}Rotation"], 270)
    if rotation % 90:
        raise PictureSyntax(f"rotation: {rotation:g}")
    width, height = resolution.split("x")
    return PictureKind(
        size_px=(int(width), int(height)),
        compression=int(_number(query, "compression", unit.parameters[f"{appearance}Compression"], 100)),
        rotation=int(rotation),
        fps=_number(query, "fps", unit.parameters["Image.I0.Stream.FPS"], 1000) or unit.settings.default_fps,
    )


def _number(query: Mapping[str, str], name: str, default: str, high: float) -> float:
    try:
        value = float(query.get(name, default))
    except ValueError:
        raise PictureSyntax(f"{name}: {query[name]}") from None
    if not 0 <= value <= high:
        raise PictureSyntax(f"{name}: {query[name]}")
    return value


class PictureCgi:
    """The picture side of one camera.

    Parameters
    ----------
    unit : Unit
    eye : PtzEye
    darkroom : Darkroom
    faults : FaultBox
    shots : ShotLog
    """

    def __init__(self, unit: Unit, eye: PtzEye, darkroom: Darkroom, faults: FaultBox, shots: ShotLog) -> None:
        self._unit = unit
        self._eye = eye
        self._darkroom = darkroom
        self._faults = faults
        self._shots = shots
        self._streams: dict[PictureKind, Stream] = {}
        self._limit = ViewerLimit(unit.settings.max_viewers, unit.settings.max_configurations)

    @property
    def viewers(self) -> int:
        """Open streams."""
        return self._limit.viewers

    async def develop(self, t_s: float, kind: PictureKind) -> bytes:
        """JPEG of an exposure around ``t_s``, which must have passed."""
        exposure = exposure_at(self._unit, t_s, kind.size_px)
        work = partial(self._eye.jpeg, exposure, quality=quality_of(kind.compression), rotation=kind.rotation)
        jpeg = await self._darkroom.run(work)
        self._shots.add(jpeg, t_s, exposure.pose)
        return jpeg

    async def image(self, request: web.Request) -> web.StreamResponse:
        """image.cgi: one picture."""
        try:
            kind = picture_kind(self._unit, request.query)
        except PictureSyntax as error:
            return _refused(error)
        clock, settings = self._unit.clock, self._unit.settings
        t_s = clock.now_s() + settings.exposure_s / 2
        await clock.sleep_until(t_s + settings.exposure_s / 2)
        jpeg = await self.develop(t_s, kind)
        await clock.sleep_until(t_s + settings.image_latency_s)
        fault = self._faults.on_picture(request.path_qs, clock.now_s())
        if fault is not None:
            jpeg = spoilt(jpeg, fault.kind, 0)
        return web.Response(body=jpeg, headers={"Content-Type": "image/jpeg", "Cache-Control": "no-cache"})

    async def video(self, request: web.Request) -> web.StreamResponse:
        """video.cgi: pictures without end."""
        try:
            kind = picture_kind(self._unit, request.query)
            frames = int(
                _number(request.query, "nbrofframes", self._unit.parameters["Image.I0.Stream.NbrOfFrames"], 1e9)
            )
            duration_s = _number(request.query, "duration", self._unit.parameters["Image.I0.Stream.Duration"], 1e9)
        except PictureSyntax as error:
            return _refused(error)
        if not self._limit.enter(kind):
            return html(503, "Service Unavailable")
        try:
            return await serve_stream(
                request,
                self._stream(kind),
                clock=self._unit.clock,
                faults=self._faults,
                rfc_boundary=self._unit.flag("Image.RFCCompliantMultipartEnabled"),
                frames=frames,
                duration_s=duration_s,
            )
        finally:
            self._limit.leave(kind)

    def _stream(self, kind: PictureKind) -> Stream:
        if kind not in self._streams:
            settings = self._unit.settings
            self._streams[kind] = Stream(
                partial(self.develop, kind=kind),
                self._unit.clock,
                fps=min(kind.fps, settings.default_fps),
                exposure_s=settings.exposure_s,
                latency_s=settings.image_latency_s,
            )
        return self._streams[kind]

    async def size(self, request: web.Request) -> web.StreamResponse:
        """imagesize.cgi."""
        try:
            width, height = picture_kind(self._unit, request.query).size_px
        except PictureSyntax as error:
            return _refused(error)
        return plain(f"image width = {width}\nimage height = {height}\n")


def _refused(error: PictureSyntax) -> web.Response:
    return plain(f"Error: invalid value, {error}\r\n", status=400)
