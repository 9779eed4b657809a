"""What the camera says of itself, and what in its settings will surprise: read before anything moves."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TypeVar

from ptzd.config import Limits, Ptz
from ptzd.devices.vapix import requests
from ptzd.devices.vapix.answers import Attributes, CameraLimits, CameraSaysNo, DeviceInfo, Parameters, SystemState
from ptzd.devices.vapix.client import CameraClient
from ptzd.devices.vapix.failures import NotOffered, Overloaded, PageFails
from ptzd.devices.vapix.requests import Request
from ptzd.errors import ConfigError, DeviceGarbled, DeviceRefused
from ptzd.model import HeadLimits

LOGGER = logging.getLogger(__name__)

T = TypeVar("T")
D = TypeVar("D")

GROUPS = ("PTZ", "Properties.PTZ", "Properties.Image", "Brand", "Image", "GuardTour")
FULL_TURN_DEG = 360.0
SAFE_TILT_DEG = (-90.0, 90.0)
"""Limits beyond belong to E-flip: the camera reaches them by turning round and over, with the picture upside down."""
_TRUE = frozenset({"true", "yes", "on", "1"})


@dataclass(frozen=True, slots=True, kw_only=True)
class Capabilities:
    """A camera as it described itself."""

    device: DeviceInfo
    limits: HeadLimits
    """The camera's own, cut to the configured ones."""
    hfov_deg: tuple[float, float] | None
    """Narrowest and widest, as advertised; calibration knows better."""
    attributes: Attributes
    speed: float | None
    """Sticky speed of absolute moves, 1 to 100."""
    boot_id: str | None
    warnings: tuple[str, ...]
    """Settings that will surprise, one sentence each, by the parameter's name."""


async def read_capabilities(client: CameraClient, settings: Ptz, limits: Limits) -> Capabilities:
    """Ask the camera for everything that matters.

    Raises
    ------
    DeviceError
        It does not answer, is starting, has no PTZ, or does not tell its limits.
    ConfigError
        The configured limits and the camera's have nothing in common.
    """
    state = await _optional(client, requests.system_ready(), SystemState(ready=True))
    if not state.ready:
        raise Overloaded(f"{client.origin}: the camera is starting")
    # the first page that asks for the password is one that the account must be allowed: if it takes it, a refusal
    # elsewhere is that page's own
    camera_limits, parameters = await _limits_and_parameters(client, settings.camera)
    device = await _optional(client, requests.device_info(), DeviceInfo())
    speed = await _optional(client, requests.speed(settings.camera), None)
    attributes = await _optional(client, requests.attributes(settings.camera), Attributes())
    return Capabilities(
        device=_device(device, parameters),
        limits=replace(
            common_limits(camera_limits, limits, settings.endless_pan),
            focus=camera_limits.focus,
            iris=camera_limits.iris,
            top_deg_s=settings.steer_top_deg_s or _twice(attributes.max_speed_deg_s),
        ),
        hfov_deg=camera_limits.hfov_deg,
        attributes=attributes,
        speed=speed,
        boot_id=state.boot_id,
        warnings=surprises(parameters, settings, speed),
    )


async def _limits_and_parameters(client: CameraClient, camera: int) -> tuple[CameraLimits, Parameters]:
    nothing = Parameters()
    try:
        limits = await client.send(requests.limits(camera))
    except (NotOffered, CameraSaysNo):
        _refuse_without_ptz(client.origin, await _optional(client, requests.parameters(*GROUPS), nothing), camera)
        raise
    parameters = await _optional(client, requests.parameters(*GROUPS), nothing)
    _refuse_without_ptz(client.origin, parameters, camera)
    return limits, parameters


async def _optional(client: CameraClient, request: Request[T], default: D) -> T | D:
    """Answer to a question that not every camera knows and not every account may ask, however it says so."""
    try:
        return await client.send(request)
    except (DeviceRefused, DeviceGarbled, PageFails) as error:
        LOGGER.info("%s", error)
        return default


def _device(device: DeviceInfo, parameters: Parameters) -> DeviceInfo:
    return DeviceInfo(
        product=device.product or parameters.get("Brand.ProdFullName") or "",
        firmware=device.firmware or parameters.get("Properties.Firmware.Version") or "",
        serial=device.serial or parameters.get("Properties.System.SerialNumber") or "",
    )


def _refuse_without_ptz(origin: str, parameters: Parameters, camera: int) -> None:
    if parameters.get("Properties.PTZ.PTZ") == "no":
        raise DeviceRefused(f"{origin}: this camera has no pan, tilt and zoom (Properties.PTZ.PTZ=no)")
    name = f"PTZ.ImageSource.I{camera - 1}.PTZEnabled"
    if parameters.get(name) == "false":
        raise DeviceRefused(
            f"{origin}: PTZ is switched off for camera {camera} ({name}=false); switch it on in the camera"
        )


def common_limits(camera: CameraLimits, configured: Limits, endless_pan: bool | None) -> HeadLimits:
    """Where the head may go: what camera and settings both allow.

    Parameters
    ----------
    camera, configured
        In camera units.
    endless_pan : bool or None
        None = endless when the camera's own pan limits span a full turn.
    """
    endless = camera.pan_deg[1] - camera.pan_deg[0] >= FULL_TURN_DEG if endless_pan is None else endless_pan
    free = configured.pan_deg[1] - configured.pan_deg[0] >= FULL_TURN_DEG
    return HeadLimits(
        pan_deg=camera.pan_deg if endless and free else _common("pan_deg", camera.pan_deg, configured.pan_deg),
        tilt_deg=_common("tilt_deg", _common("tilt_deg", camera.tilt_deg, SAFE_TILT_DEG), configured.tilt_deg),
        zoom=_common("zoom", camera.zoom, configured.zoom),
        endless_pan=endless and free,
    )


def _common(axis: str, camera: tuple[float, float], configured: tuple[float, float]) -> tuple[float, float]:
    low, high = max(camera[0], configured[0]), min(camera[1], configured[1])
    if low >= high:
        raise ConfigError(
            f"limits.{axis}: {configured[0]:g} to {configured[1]:g} is outside what the camera can do "
            f"({camera[0]:g} to {camera[1]:g})"
        )
    return low, high


def surprises(parameters: Parameters, settings: Ptz, speed: float | None) -> tuple[str, ...]:
    """Settings of the camera that move it, freeze its picture, turn it or slow it down."""
    found = [*_moving(parameters, settings.camera), *_picture(parameters, settings)]
    if speed is not None and speed < 100:
        found.append(f"speed={speed:g}: absolute moves run slower than the camera can; speed=100 is the fastest")
    return tuple(found)


def _moving(parameters: Parameters, camera: int) -> list[str]:
    found = []
    if _is_true(parameters.get("Properties.PTZ.DigitalPTZ")):
        found.append(
            "Properties.PTZ.DigitalPTZ=yes: pan and tilt may move a crop of the picture and no head, then nothing can "
            "be pointed; use a camera with motors for pan and tilt"
        )
    various, user = f"PTZ.Various.V{camera}", f"PTZ.UserAdv.U{camera}"
    seconds = parameters.get(f"{various}.ReturnToOverview") or "0"
    if seconds not in {"0", ""}:
        found.append(f"{various}.ReturnToOverview={seconds}: the camera goes home by itself; set it to 0")
    if _is_true(parameters.get(f"{various}.CtlQueueing")):
        found.append(f"{various}.CtlQueueing=true: other users may have the control; switch the control queue off")
    if _is_true(parameters.get(f"{various}.Locked")):
        found.append(f"{various}.Locked=true: the camera takes no moves")
    switches = (f"{various}.{axis}Enabled" for axis in ("Pan", "Tilt", "Zoom"))
    found += [f"{name}=false: this axis does not move" for name in switches if parameters.get(name) in {"false", "no"}]
    if _is_true(parameters.get(f"{user}.AutoFlip")):
        found.append(f"{user}.AutoFlip=true: the head may turn round to reach a pan; poses in between are far away")
    housing = parameters.get(f"{user}.CameraHousingConfiguration")
    if housing not in {None, "default", ""}:
        found.append(f"{user}.CameraHousingConfiguration={housing}: tilt counts the other way; calibrate as it is now")
    tours = parameters.matching("GuardTour.", ".Running")
    found += [
        f"{name}={value}: a guard tour moves the camera; stop it" for name, value in tours.items() if _is_true(value)
    ]
    return found


def _picture(parameters: Parameters, settings: Ptz) -> list[str]:
    found = []
    freeze = parameters.get(f"PTZ.UserAdv.U{settings.camera}.ImageFreeze")
    if freeze not in {None, "off", ""}:
        found.append(
            f"PTZ.UserAdv.U{settings.camera}.ImageFreeze={freeze}: pictures stand still while the head moves; set off"
        )
    image = f"Image.I{settings.camera - 1}.Appearance"
    rotation = parameters.get(f"{image}.Rotation")
    if rotation not in {None, "0", ""}:
        found.append(f"{image}.Rotation={rotation}: the picture is turned; calibrate as it is now")
    if _is_true(parameters.get(f"{image}.MirrorEnabled")):
        found.append(f"{image}.MirrorEnabled=yes: a mirrored picture cannot be matched; switch it off")
    sizes = parameters.get("Properties.Image.Resolution")
    size = f"{settings.size_px[0]}x{settings.size_px[1]}"
    if sizes and size not in sizes.split(","):
        found.append(f"Properties.Image.Resolution lacks {size} of ptz.size_px; it has {sizes}")
    return found


def _twice(speed_deg_s: float | None) -> tuple[float, float] | None:
    """What a camera says of its moves goes for both axes."""
    return None if speed_deg_s is None else (speed_deg_s, speed_deg_s)


def _is_true(value: str | None) -> bool:
    return value is not None and value.lower() in _TRUE
