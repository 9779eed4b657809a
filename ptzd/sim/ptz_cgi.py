"""What ptz.cgi does with a checked request: orders to the unit, answers to queries. No HTTP in here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from ptzd.sim import ptz_answers as answers
from ptzd.sim.auth import User
from ptzd.sim.framing import area_zoom, centred, step
from ptzd.sim.head import MoveBy, MoveTo, Turn, ZoomRun
from ptzd.sim.ptz_request import PtzRequest, PtzSyntax
from ptzd.sim.unit import Unit

PRESET_NAME_BYTES = 31
PRESET_NUMBERS = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Reply:
    """Status and body; a command without an answer is 204 with an empty body."""

    status: int = 204
    text: str = ""
    content_type: str = "text/plain"


def answer(unit: Unit, request: PtzRequest, user: User) -> Reply:
    """Carry out a request: speed first, then moves, then queries on the state after them."""
    if request.text("whoami"):
        return Reply(status=200, text=answers.lines([unit.profile.driver if unit.enabled else "PTZ disabled"]))
    if not unit.enabled:
        return Reply(status=200, text=answers.error("PTZ disabled"))
    if request.text("info"):
        return Reply(status=200, text=answers.lines(answers.INFO.split("\n")))
    try:
        _adjust(unit, request)
        _move(unit, request, user)
        _presets(unit, request, user)
    except PtzSyntax as refusal:
        return Reply(status=200, text=answers.error(str(refusal)))
    queries = request.words("query")
    if not queries:
        return Reply()
    as_json = request.text("format") == "json"
    text = "".join(_query(unit, request, name, as_json=as_json) for name in queries)
    return Reply(status=200, text=text, content_type="application/json" if as_json else "text/plain")


def _adjust(unit: Unit, request: PtzRequest) -> None:
    """Set what is not motion: speed, focus, iris, brightness, switches."""
    speed = request.number("speed")
    if speed is not None:
        unit.parameters["PTZ.UserAdv.U1.MoveSpeed"] = str(int(speed))
    for name in unit.switches:
        state = request.text(name)
        if state is not None:
            unit.switches[name] = state
    for name, automatic in (("focus", "autofocus"), ("iris", "autoiris"), ("brightness", "")):
        absolute, relative = request.number(name), request.number(f"r{name}")
        if (absolute is None and relative is None) or unit.switches.get(automatic) == "on":
            continue
        value = absolute if absolute is not None else unit.levels[name] + (relative or 0)
        low, high = unit.limits.get(f"Min{name.capitalize()}", "1"), unit.limits.get(f"Max{name.capitalize()}", "9999")
        unit.levels[name] = int(min(max(value, int(low)), int(high)))
    if (cut := request.text("ircutfilter")) is not None:
        unit.parameters["PTZ.Various.V1.IrCutFilter"] = cut
    if (light := request.text("backlight")) is not None:
        unit.parameters["PTZ.Various.V1.BackLight"] = str(light == "on").lower()


def _move(unit: Unit, request: PtzRequest, user: User) -> None:
    _move_framed(unit, request, user)
    absolute = MoveTo(**{name: request.number(name) for name in ("pan", "tilt", "zoom")})
    if absolute != MoveTo():
        unit.submit(absolute, user.name)
    relative = MoveBy(**{name: request.number(f"r{name}") for name in ("pan", "tilt", "zoom")})
    if relative != MoveBy():
        unit.submit(relative, user.name)
    if (speeds := request.numbers("continuouspantiltmove")) is not None:
        unit.submit(_turn(unit, request, speeds), user.name)
    if (zoom_speed := request.number("continuouszoommove")) is not None:
        unit.submit(ZoomRun(percent=zoom_speed), user.name)


def _turn(unit: Unit, request: PtzRequest, speeds: tuple[float, ...]) -> Turn:
    proportional = (
        unit.flag("PTZ.Various.V1.ProportionalSpeedEnabled") and request.text("proportionalspeed") != "disabled"
    )
    share = int(unit.parameters["PTZ.Various.V1.MaxProportionalSpeed"]) / 100 if proportional else 0.0
    return Turn(pan_percent=speeds[0], tilt_percent=speeds[1], proportional=share)


def _move_framed(unit: Unit, request: PtzRequest, user: User) -> None:
    pose = unit.head.encoder(unit.clock.now_s())
    turn = int(request.text("imagerotation") or 0)
    width, height = unit.parameters["Image.I0.Appearance.Resolution"].split("x")
    size = (request.number("imagewidth") or float(width), request.number("imageheight") or float(height))
    name = request.text("move")
    if name == "home":
        unit.go_home(user.name)
    elif name == "stop":
        unit.submit(Turn(pan_percent=0, tilt_percent=0), user.name)
    elif name is not None:
        unit.submit(step(unit.profile, pose, name, turn), user.name)
    if (point := request.numbers("center")) is not None:
        unit.submit(centred(unit.profile, pose, (point[0], point[1]), size, turn), user.name)
    if (area := request.numbers("areazoom")) is not None:
        move = centred(unit.profile, pose, (area[0], area[1]), size, turn)
        unit.submit(replace(move, zoom=area_zoom(unit.profile, pose, area[2])), user.name)


def _presets(unit: Unit, request: PtzRequest, user: User) -> None:
    if (name := request.text("setserverpresetname")) is not None:
        unit.store_preset(_preset_name("setserverpresetname", name))
    if (number := request.number("setserverpresetno")) is not None:
        unit.store_preset(f"Preset {number:.0f}", int(number))
    for argument, act in (("removeserverpreset", unit.remove_preset), ("gotoserverpreset", None)):
        number = request.number(f"{argument}no")
        if (name := request.text(f"{argument}name")) is not None:
            number = unit.preset_number(name)
            if number is None:
                raise PtzSyntax(f"{argument}name", f"preset {name} not found")
        if number is None:
            continue
        done = act(int(number)) if act else unit.go_preset(int(number), user)
        if not done:
            raise PtzSyntax(f"{argument}no", "invalid value")
    if request.number("gotodevicepreset") is not None:
        raise PtzSyntax("gotodevicepreset", "not supported")


def _query(unit: Unit, request: PtzRequest, name: str, *, as_json: bool) -> str:
    if name == "attributes" and not unit.profile.has_attributes:
        return answers.error("query: unknown value: attributes")
    if name == "auxiliary":
        return '{"Camera 1": {}}' if as_json else answers.lines(["Available auxiliary commands:"])
    if name.startswith("preset"):
        return answers.presets(unit, data=name == "presetposcamdata", as_json=as_json)
    texts: dict[str, Callable[[], str]] = {
        "position": lambda: answers.position(unit),
        "limits": lambda: answers.lines(f"{key}={value}" for key, value in unit.limits.items()),
        "speed": lambda: answers.lines([f"speed={unit.speed_index}"]),
        "mode": lambda: answers.lines(["mode=normal"]),
        "attributes": lambda: answers.attributes(unit.profile, request.text("group"), as_json=as_json),
    }
    return texts[name]()


def configure(unit: Unit, arguments: dict[str, str]) -> Reply:
    """ptzconfig.cgi: keep, rename and forget presets."""
    try:
        _configure(unit, arguments)
    except PtzSyntax as refusal:
        return Reply(status=200, text=answers.error(str(refusal)))
    return Reply()


def _configure(unit: Unit, arguments: dict[str, str]) -> None:
    if name := arguments.get("setserverpresetname"):
        key = unit.store_preset(_preset_name("setserverpresetname", name))
        if arguments.get("home") == "yes":
            unit.parameters["PTZ.Preset.P0.HomePosition"] = str(key)
    if (number := _preset_number(arguments, "setserverpresetno")) is not None:
        unit.store_preset(f"Preset {number}", number)
    if (number := _preset_number(arguments, "renameserverpresetno")) is not None:
        new_name = _preset_name("newname", arguments.get("newname", ""))
        _found(unit.rename_preset(number, new_name), "renameserverpresetno")
    if (number := _preset_number(arguments, "removeserverpresetno")) is not None:
        _found(unit.remove_preset(number), "removeserverpresetno")
    if name := arguments.get("removeserverpresetname"):
        _found(unit.remove_preset(unit.preset_number(name) or 0), "removeserverpresetname")
    if arguments.get("removeallserverpresets") == "yes":
        for key in [key for key in unit.presets if str(key) != unit.parameters["PTZ.Preset.P0.HomePosition"]]:
            unit.remove_preset(key)


def _preset_number(arguments: dict[str, str], argument: str) -> int | None:
    text = arguments.get(argument)
    if text is None:
        return None
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= PRESET_NUMBERS):
        raise PtzSyntax(argument, "invalid value")
    return int(text)


def _found(found: bool, argument: str) -> None:
    if not found:
        raise PtzSyntax(argument, "preset not found")


def _preset_name(argument: str, name: str) -> str:
    if not name or len(name.encode()) > PRESET_NAME_BYTES or any(mark in name for mark in '"<>~:'):
        raise PtzSyntax(argument, "invalid value")
    return name
