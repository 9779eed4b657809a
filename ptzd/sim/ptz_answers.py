"""Texts that ptz.cgi answers queries with, in the form of recorded ones. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterable

from ptzd.sim.framing import believed_magnification
from ptzd.sim.profile import LINEAR_TABLE, ZOOM_STEPS, Profile
from ptzd.sim.unit import Unit

LINE_END = "\r\n"
INFO = """Available commands
:
{camera=[n]}
whoami=yes
center=[x],[y]
   imagewidth=[n]
   imageheight=[n]
areazoom=[x],[y],[z]
   imagewidth=[n]
   imageheight=[n]
move={ home | up | down | left | right | upleft | upright | downleft | downright | stop }
pan=[abspos]
tilt=[abspos]
zoom=[n]
focus=[n]
iris=[n]
brightness=[offset]
rpan=[offset]
rtilt=[offset]
rzoom=[offset]
rfocus=[offset]
riris=[offset]
rbrightness=[offset]
autofocus={ on | off }
autoiris={ on | off }
ircutfilter={ on | off | auto }
backlight={ on | off }
continuouspantiltmove=[x-speed],[y-speed]
continuouszoommove=[speed]
continuousfocusmove=[speed]
auxiliary=[function]
setserverpresetname=[name]
setserverpresetno=[n]
removeserverpresetname=[name]
removeserverpresetno=[n]
gotoserverpresetname=[name]
gotoserverpresetno=[n]
speed=[n]
query={ speed | position | limits | presetposcam | presetposall }"""


def lines(items: Iterable[str]) -> str:
    """Lines with the camera's ends."""
    return "".join(f"{item}{LINE_END}" for item in items)


def position(unit: Unit) -> str:
    """``query=position``: the profile's keys in the profile's order."""
    pose = unit.reported()
    decimals = unit.profile.decimals
    values = {
        "pan": f"{pose.pan_deg:.{decimals}f}",
        "tilt": f"{pose.tilt_deg:.{decimals}f}",
        "zoom": f"{pose.zoom:.0f}",
        **{name: str(value) for name, value in unit.levels.items()},
        **unit.switches,
    }
    return lines(f"{key}={values[key]}" for key in unit.profile.position_keys)


def presets(unit: Unit, *, data: bool, as_json: bool) -> str:
    """``query=presetposall``, ``presetposcam`` and, with positions, ``presetposcamdata``."""
    ordered = sorted(unit.presets.items())
    if as_json:
        names = [{"number": str(number), "name": preset.name} for number, preset in ordered]
        return json.dumps({"Camera 1": {"presets": names}}, ensure_ascii=False)
    head = "Preset Positions for camera 1"
    if not data:
        return lines([head, *(f"presetposno{number}={preset.name}" for number, preset in ordered)])
    stored = (unit.parameters[f"PTZ.Preset.P0.Position.P{number}.Data"] for number, _ in ordered)
    pairs = zip(ordered, stored, strict=True)
    return lines([head, *(f"presetposno{number}={preset.name}:{text}" for (number, preset), text in pairs)])


def attributes(profile: Profile, group: str | None, *, as_json: bool) -> str:
    """``query=attributes``: the zoom steps and the speed table."""
    believed: dict[str, object] = {}
    if group in (None, "zoom"):
        top = believed_magnification(profile, ZOOM_STEPS)
        believed["maxOpticalZoomMag"] = f"{int(top)}"
        believed["zoomSteps"] = _zoom_steps(profile)
    if group in (None, "speed"):
        table = profile.speed_table if profile.speed_table != LINEAR_TABLE else _dense(profile)
        believed["speeds"] = [{"value": f"{index:g}", "speed": f"{speed:g}"} for index, speed in table]
    if as_json:
        return json.dumps({"Camera 1": believed})
    return lines(_flat(believed))


def _zoom_steps(profile: Profile) -> list[dict[str, str]]:
    top = believed_magnification(profile, ZOOM_STEPS)
    whole = [
        (1 + int((mag - 1) * (ZOOM_STEPS - 1) / (profile.max_magnification - 1)), f"{mag}")
        for mag in range(1, int(top) + 1)
    ]
    return [{"value": str(value), "zoom": text} for value, text in [*whole, (ZOOM_STEPS, f"{top:.6f}")]]


def _dense(profile: Profile) -> list[tuple[float, float]]:
    return [(float(index), profile.move_speed(index)) for index in (1, 10, 20, 40, 60, 80, 100)]


def _flat(believed: dict[str, object]) -> list[str]:
    flat = []
    for name, value in believed.items():
        if isinstance(value, list):
            for entry in value:
                flat += [f"{key}={text}" for key, text in entry.items()]
        else:
            flat.append(f"{name}={value}")
    return flat


def error(message: str) -> str:
    """``Error:`` in the body of a 200."""
    return lines(["Error:", message])
