"""What AXIS cameras answer, as values: parsed by key, refused when a required key is missing or no finite number.

Order of keys, decimals, line ends and the presence of iris and focus vary with the model and are not relied on. An
``Error:`` inside a 200 is an answer that says no (:class:`DeviceRefused`); HTML or text without the keys is garbled.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ptzd.errors import DeviceGarbled, DeviceRefused
from ptzd.model import HeadReading

_PRESET = re.compile(r"presetposno(\d{1,5})=(.*)")
SHOWN_CHARACTERS = 80
"""How much of a strange answer a message quotes."""
_PAN_DEG, _TILT_DEG, _ZOOM, _LENS = 360.0, 180.0, 20_000.0, 100_000.0
"""Beyond these a position is not believed: VAPIX allows ±180, ±180 (E-flip) and 19999."""


class CameraSaysNo(DeviceRefused):
    """``Error:`` inside a 200."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """A body with what tells how to read it."""

    status: int
    content_type: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CameraLimits:
    """``query=limits``: mechanical limits in camera units, field of view in degrees where it is no dummy."""

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]
    zoom: tuple[float, float]
    hfov_deg: tuple[float, float] | None = None
    """Narrowest and widest; None when the camera does not say."""
    focus: tuple[float, float] | None = None
    iris: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attributes:
    """``query=attributes``: what the unit says of its motors and lens."""

    max_speed_deg_s: float | None = None
    """Of absolute moves at ``speed=100``."""
    zoom_steps: tuple[tuple[float, float], ...] = ()
    """Pairs of zoom unit and magnification."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceInfo:
    """``basicdeviceinfo.cgi``."""

    product: str = ""
    firmware: str = ""
    serial: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class SystemState:
    """``systemready.cgi``; a changed ``boot_id`` means that the camera restarted."""

    ready: bool
    boot_id: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """``param.cgi``: names without ``root.``."""

    values: Mapping[str, str] = field(default_factory=dict)

    def get(self, name: str) -> str | None:
        """Value of one parameter; None when the camera does not have it."""
        return self.values.get(name)

    def matching(self, head: str, tail: str) -> dict[str, str]:
        """Parameters whose name starts and ends so, e.g. ``PTZ.Various.`` and ``.CtlQueueing``."""
        return {name: value for name, value in self.values.items() if name.startswith(head) and name.endswith(tail)}


def accepted(reply: Reply) -> None:
    """Check the answer to a command: 204, or 200 with an empty body from older drivers.

    Raises
    ------
    DeviceRefused
        The body is an error text.
    DeviceGarbled
        Anything else.
    """
    if reply.status == 204 or not reply.text.strip():
        return
    _refuse_errors(reply)
    raise DeviceGarbled(f"expected an empty answer to a command, got {_shown(reply.text)}")


def position(reply: Reply) -> HeadReading:
    """``query=position``."""
    fields = _fields(reply)
    return HeadReading(
        pan_deg=_number(fields, "pan", -_PAN_DEG, _PAN_DEG),
        tilt_deg=_number(fields, "tilt", -_TILT_DEG, _TILT_DEG),
        zoom=_number(fields, "zoom", 0.0, _ZOOM),
    )


def preset_names(reply: Reply) -> dict[int, str]:
    """``query=presetposcam``: a headline, then a line for each, e.g. ``presetposno1=Home``."""
    _refuse_html(reply)
    _refuse_errors(reply)
    found = (_PRESET.fullmatch(line.strip()) for line in reply.text.splitlines())
    return {int(match[1]): match[2].strip() for match in found if match is not None}


def limits(reply: Reply) -> CameraLimits:
    """``query=limits``."""
    fields = _fields(reply)
    missing = [key for key in ("MinPan", "MaxPan", "MinTilt", "MaxTilt", "MinZoom", "MaxZoom") if key not in fields]
    if missing:
        raise DeviceGarbled(f"limits lack {', '.join(missing)}: channel without pan, tilt or zoom; check ptz.camera")
    return CameraLimits(
        pan_deg=_interval(fields, "Pan", _PAN_DEG),
        tilt_deg=_interval(fields, "Tilt", _TILT_DEG),
        zoom=_interval(fields, "Zoom", _ZOOM),
        hfov_deg=_field_angles(fields),
        focus=_interval(fields, "Focus", _LENS) if {"MinFocus", "MaxFocus"} <= fields.keys() else None,
        iris=_interval(fields, "Iris", _LENS) if {"MinIris", "MaxIris"} <= fields.keys() else None,
    )


def speed(reply: Reply) -> float:
    """``query=speed``: 1 to 100."""
    return _number(_fields(reply), "speed", 0.0, 100.0)


def parameters(reply: Reply) -> Parameters:
    """``param.cgi?action=list``; groups that the camera does not have are left out."""
    if not reply.text.strip():
        return Parameters()
    _refuse_html(reply)
    lines = [line for line in reply.text.splitlines() if line.strip()]
    pairs = [line.partition("=") for line in lines if "=" in line and not _is_error(line)]
    if not pairs:
        _refuse_errors(reply)
        raise DeviceGarbled(f"expected parameters, got {_shown(reply.text)}")
    return Parameters(values={name.strip().removeprefix("root."): value for name, _, value in pairs})


def attributes(reply: Reply) -> Attributes:
    """``query=attributes&format=json``; values are strings there."""
    document = _json(reply)
    cameras = [value for value in document.values() if isinstance(value, dict)]
    camera = cameras[0] if len(cameras) == 1 else document
    speeds = [entry[1] for entry in _table(camera, "speed")]
    return Attributes(
        max_speed_deg_s=max(speeds, default=None),
        zoom_steps=tuple(_table(camera, "zoom")),
    )


def device_info(reply: Reply) -> DeviceInfo:
    """``basicdeviceinfo.cgi`` getAllProperties."""
    properties = _data(reply).get("propertyList")
    if not isinstance(properties, dict):
        raise DeviceGarbled(f"device information lacks data.propertyList: {_shown(reply.text)}")
    texts = {name: value for name, value in properties.items() if isinstance(value, str)}
    return DeviceInfo(
        product=texts.get("ProdFullName", texts.get("ProdNbr", "")),
        firmware=texts.get("Version", ""),
        serial=texts.get("SerialNumber", ""),
    )


def system_state(reply: Reply) -> SystemState:
    """``systemready.cgi``."""
    data = _data(reply)
    boot_id = data.get("bootid")
    if "systemready" not in data:
        raise DeviceGarbled(f"answer lacks data.systemready: {_shown(reply.text)}")
    return SystemState(ready=data.get("systemready") == "yes", boot_id=boot_id if isinstance(boot_id, str) else None)


def session_token(reply: Reply) -> str:
    """``wssession.cgi``: the token that opens the event stream, valid for 15 s."""
    _refuse_html(reply)
    _refuse_errors(reply)
    token = reply.text.strip()
    if not token or len(token) > 256 or not token.isprintable() or " " in token:
        raise DeviceGarbled(f"expected a session token, got {_shown(reply.text)}")
    return token


def _fields(reply: Reply) -> dict[str, str]:
    _refuse_html(reply)
    _refuse_errors(reply)
    pairs = (line.partition("=") for line in reply.text.splitlines() if "=" in line)
    return {name.strip(): value.strip() for name, _, value in pairs}


def _number(fields: Mapping[str, str], key: str, low: float, high: float) -> float:
    text = fields.get(key)
    if text is None:
        raise DeviceGarbled(f"answer lacks {key}=; it has {', '.join(sorted(fields)) or 'no key at all'}")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise DeviceGarbled(f"{key}={_shown(text)} is no number between {low:g} and {high:g}")
    return value


def _interval(fields: Mapping[str, str], axis: str, bound: float) -> tuple[float, float]:
    low, high = _number(fields, f"Min{axis}", -bound, bound), _number(fields, f"Max{axis}", -bound, bound)
    if low >= high:
        raise DeviceGarbled(f"limits of {axis.lower()} are in the wrong order: {low:g} to {high:g}")
    return low, high


def _field_angles(fields: Mapping[str, str]) -> tuple[float, float] | None:
    """Tenths of a degree, tele and wide; units without a lens table answer dummies like 1 and 100."""
    try:
        tele, wide = float(fields["MinFieldAngle"]), float(fields["MaxFieldAngle"])
    except (KeyError, ValueError):
        return None
    return (tele / 10, wide / 10) if 2 <= tele < wide <= 1500 else None


def _table(camera: Mapping[str, object], quantity: str) -> list[tuple[float, float]]:
    """Entries ``{"value": …, <quantity>: …}`` of whatever list holds them."""
    lists = [value for value in camera.values() if isinstance(value, list)]
    entries = [entry for items in lists for entry in items if isinstance(entry, dict) and quantity in entry]
    pairs = ((_positive(entry.get("value")), _positive(entry[quantity])) for entry in entries)
    return [(unit, value) for unit, value in pairs if unit is not None and value is not None]


def _positive(value: object) -> float | None:
    if not isinstance(value, str | int | float):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if 0 < number < math.inf else None


def _json(reply: Reply) -> dict[str, object]:
    _refuse_html(reply)
    _refuse_errors(reply)
    try:
        document = json.loads(reply.text)
    except (ValueError, RecursionError):
        raise DeviceGarbled(f"expected JSON, got {_shown(reply.text)}") from None
    if not isinstance(document, dict):
        raise DeviceGarbled(f"expected a JSON object, got {_shown(reply.text)}")
    return document


def _data(reply: Reply) -> dict[str, object]:
    document = _json(reply)
    data = document.get("data")
    if isinstance(data, dict):
        return data
    error = document.get("error")
    if isinstance(error, dict):
        raise CameraSaysNo(f"the camera says: {_shown(str(error.get('message', error)))}")
    raise DeviceGarbled(f"answer lacks data: {_shown(reply.text)}")


def _is_error(line: str) -> bool:
    return line.lstrip("# ").startswith("Error")


def _refuse_errors(reply: Reply) -> None:
    lines = reply.text.split("\n")
    first = next((line for line in lines if line.strip()), "")
    if _is_error(first):
        raise CameraSaysNo(f"the camera says: {_shown(' '.join(line.strip() for line in lines))}")


def _refuse_html(reply: Reply) -> None:
    if "html" in reply.content_type.lower() or reply.text.lstrip().startswith("<"):
        raise DeviceGarbled(f"expected plain text, got HTML or XML: {_shown(reply.text)}")


def _shown(text: str) -> str:
    line = " ".join(text.split())
    return repr(line if len(line) <= SHOWN_CHARACTERS else line[:SHOWN_CHARACTERS] + "…")
