"""Requests to an AXIS camera as data; :class:`ptzd.devices.vapix.client.CameraClient` only sends them.

Ranges and forms are those of VAPIX' pan/tilt/zoom, video streaming and parameter APIs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

from ptzd.devices.vapix import answers
from ptzd.devices.vapix.answers import Attributes, CameraLimits, DeviceInfo, Parameters, Reply, SystemState
from ptzd.devices.vapix.speeds import SpeedForm
from ptzd.model import HeadReading, Lens

T = TypeVar("T")

PTZ = "/axis-cgi/com/ptz.cgi"
QUERY_TIMEOUT_S = 3.0
COMMAND_TIMEOUT_S = 5.0
LIST_TIMEOUT_S = 10.0
"""Parameter lists of large cameras take seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Request(Generic[T]):
    """One exchange: what is sent and how the answer is read."""

    path: str
    parse: Callable[[Reply], T]
    params: tuple[tuple[str, str], ...] = ()
    method: Literal["GET", "POST"] = "GET"
    document: dict[str, object] | None = None
    """Sent as JSON."""
    timeout_s: float = QUERY_TIMEOUT_S
    attempts: int = 3
    """Of those that may be sent again when the connection is cut: queries and absolute moves."""

    @property
    def orders(self) -> bool:
        """Whether it moves or changes the camera; all others only ask."""
        pages = ("/axis-cgi/com/ptz", "/axis-cgi/param.cgi", "/axis-cgi/restart.cgi")
        asks = {"query", "info", "whoami"} & {key for key, _ in self.params} or ("action", "list") in self.params
        return self.path.startswith(pages) and not asks

    @property
    def name(self) -> str:
        """Path with the parameters, for messages; what a user wrote behind a ``?`` may be secret and is left out."""
        query = "&".join(f"{key}={value}" for key, value in self.params)
        path = self.path.partition("?")[0]
        return f"{path}?{query}" if query else path


def position(camera: int) -> Request[HeadReading]:
    """Where the head is."""
    return Request(path=PTZ, params=(("query", "position"), ("camera", str(camera))), parse=answers.position)


def limits(camera: int) -> Request[CameraLimits]:
    """Where the head can go."""
    return Request(path=PTZ, params=(("query", "limits"), ("camera", str(camera))), parse=answers.limits)


def speed(camera: int) -> Request[float]:
    """Speed of absolute moves, 1 to 100."""
    return Request(path=PTZ, params=(("query", "speed"), ("camera", str(camera))), parse=answers.speed)


def attributes(camera: int) -> Request[Attributes]:
    """Speeds and magnifications; older cameras do not know the question."""
    params = (("query", "attributes"), ("camera", str(camera)), ("format", "json"))
    return Request(path=PTZ, params=params, parse=answers.attributes)


def absolute_move(camera: int, target: HeadReading) -> Request[None]:
    """Pan, tilt and zoom at once: four decimals, no exponent, zoom as an integer from 1 up."""
    params = (
        ("camera", str(camera)),
        ("pan", f"{target.pan_deg:.4f}"),
        ("tilt", f"{target.tilt_deg:.4f}"),
        ("zoom", str(round(target.zoom))),
    )
    return Request(path=PTZ, params=params, parse=answers.accepted, timeout_s=COMMAND_TIMEOUT_S)


def continuous_move(camera: int, percents: tuple[float, float, float], form: SpeedForm) -> Request[None]:
    """Turn and zoom at these percents of the fastest until told otherwise."""
    pan, tilt, zoom = (form.text(percent) for percent in percents)
    params = [("camera", str(camera)), ("continuouspantiltmove", f"{pan},{tilt}"), ("continuouszoommove", zoom)]
    if form.unproportional:
        params.append(("proportionalspeed", "disabled"))
    return Request(path=PTZ, params=tuple(params), parse=answers.accepted, timeout_s=COMMAND_TIMEOUT_S, attempts=1)


def lens(camera: int, wanted: Lens) -> tuple[Request[None], ...]:
    """Focus and iris, one after the other: a value is ignored unless the camera leaves it alone before."""
    steps: list[tuple[str, str]] = []
    for name, value in (("focus", wanted.focus), ("iris", wanted.iris)):
        if value is not None:
            steps.append((f"auto{name}", "off" if value else "on"))
        if value:
            steps.append((name, str(value)))
    return tuple(
        Request(path=PTZ, params=(("camera", str(camera)), step), parse=answers.accepted, timeout_s=COMMAND_TIMEOUT_S)
        for step in steps
    )


def stops(camera: int) -> tuple[Request[None], ...]:
    """Everything that stops an axis: one stop of each kind leaves the other kind moving."""
    continuous = (("camera", str(camera)), ("continuouspantiltmove", "0,0"), ("continuouszoommove", "0"))
    absolute = (("camera", str(camera)), ("move", "stop"))
    return tuple(
        Request(path=PTZ, params=params, parse=answers.accepted, timeout_s=COMMAND_TIMEOUT_S)
        for params in (continuous, absolute)
    )


def preset_names(camera: int) -> Request[dict[int, str]]:
    """Names of the positions that the camera keeps, by number."""
    params = (("query", "presetposcam"), ("camera", str(camera)))
    return Request(path=PTZ, params=params, parse=answers.preset_names)


def parameters(*groups: str) -> Request[Parameters]:
    """Values of parameter groups."""
    params = (("action", "list"), ("group", ",".join(groups)))
    return Request(path="/axis-cgi/param.cgi", params=params, parse=answers.parameters, timeout_s=LIST_TIMEOUT_S)


def device_info() -> Request[DeviceInfo]:
    """Model, firmware, serial number."""
    document: dict[str, object] = {"apiVersion": "1.0", "method": "getAllProperties"}
    return Request(method="POST", path="/axis-cgi/basicdeviceinfo.cgi", document=document, parse=answers.device_info)


def system_ready() -> Request[SystemState]:
    """Whether the camera has finished booting; needs no password."""
    document: dict[str, object] = {"apiVersion": "1.0", "method": "systemready", "params": {"timeout": 1}}
    return Request(method="POST", path="/axis-cgi/systemready.cgi", document=document, parse=answers.system_state)


def event_session() -> Request[str]:
    """A token for the event stream."""
    return Request(path="/axis-cgi/wssession.cgi", parse=answers.session_token)


def video(camera: int, size_px: tuple[int, int], fps: float, compression: int) -> Request[None]:
    """MJPEG: always the same parameters, since a camera serves few different streams at once."""
    params = (
        ("camera", str(camera)),
        ("resolution", f"{size_px[0]}x{size_px[1]}"),
        ("fps", f"{fps:g}"),
        ("compression", str(compression)),
    )
    return Request(path="/axis-cgi/mjpg/video.cgi", params=params, parse=answers.accepted)
