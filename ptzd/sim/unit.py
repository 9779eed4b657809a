"""The camera behind its CGIs: head, parameters, presets, focus and iris, and who moved it last."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace

from ptzd.sim.auth import User
from ptzd.sim.clock import SimClock
from ptzd.sim.head import Head, MoveBy, MoveTo, Order, Pose, Turn, ZoomRun
from ptzd.sim.motion import AxisSpec
from ptzd.sim.parameters import factory_parameters, limits
from ptzd.sim.profile import Profile, profile
from ptzd.sim.ptz_request import DIGITAL_ZOOM_MAX
from ptzd.sim.settings import SimSettings

ORDERS_KEPT = 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Preset:
    """A named position."""

    name: str
    pan: float
    tilt: float
    zoom: float


@dataclass(frozen=True, slots=True, kw_only=True)
class OrderRecord:
    """One accepted order, for the side channel."""

    t_s: float
    start_s: float
    source: str
    """User name, or what moved the head on its own."""
    order: Order


class Unit:
    """State of one camera; the CGIs read and change it, nothing in here knows HTTP.

    Parameters
    ----------
    settings : SimSettings
    clock : SimClock
    """

    def __init__(self, settings: SimSettings, clock: SimClock) -> None:
        self.settings = settings
        self.clock = clock
        self.profile = _adapted(profile(settings.profile), settings)
        self.parameters = factory_parameters(self.profile)
        self.parameters["Network.HTTP.AuthenticationPolicy"] = settings.policy.value
        tilt = _flipping(self.profile.tilt, settings)
        self.limits = limits(self.profile, e_flip_tilt_deg=settings.e_flip_tilt_deg)
        self.parameters["PTZ.Support.S1.DigitalZoom"] = str(settings.digital_zoom).lower()
        self.parameters |= {f"PTZ.Limit.L1.{key}": value for key, value in self.limits.items()}
        self.head = Head(self.profile, seed=settings.seed, t_s=clock.now_s(), tilt_spec=tilt)
        self.presets = {1: Preset(name="Home", **dict(zip(("pan", "tilt", "zoom"), self.profile.home, strict=True)))}
        self.levels = {"iris": 6427, "focus": 8265, "brightness": 4999}
        self.switches = {"autofocus": "on", "autoiris": "on"}
        self.orders: deque[OrderRecord] = deque(maxlen=ORDERS_KEPT)
        self.last_order_s = clock.now_s()
        self.preset_move = False
        self._write_presets()

    def flag(self, name: str) -> bool:
        """Boolean parameter, e.g. ``PTZ.Various.V1.PanEnabled``."""
        return self.parameters.get(name, "false") in ("true", "yes", "on")

    @property
    def speed_index(self) -> int:
        """Sticky speed of absolute and relative moves, 1…100."""
        return int(self.parameters["PTZ.UserAdv.U1.MoveSpeed"])

    @property
    def enabled(self) -> bool:
        """Whether the PTZ driver is on."""
        return self.flag("PTZ.ImageSource.I0.PTZEnabled")

    def submit(self, order: Order, source: str) -> None:
        """Take up an order as far as the axes are enabled and the unit is not locked."""
        if self.flag("PTZ.Various.V1.Locked"):
            return
        allowed = self._only_enabled(order)
        if allowed is not None:
            self.force(allowed, source)

    def force(self, order: Order, source: str, *, preset: bool = False) -> None:
        """Take up an order whatever is disabled, as presets and the unit's own programs do."""
        self.preset_move = preset
        now_s = self.clock.now_s()
        self.head.auto_flip = self.flag("PTZ.UserAdv.U1.AutoFlip")
        start_s = self.head.submit(now_s, order, self.speed_index)
        self.last_order_s = now_s
        self.orders.append(OrderRecord(t_s=now_s, start_s=start_s, source=source, order=order))

    def _only_enabled(self, order: Order) -> Order | None:
        axes = {name: self.flag(f"PTZ.Various.V1.{name.capitalize()}Enabled") for name in ("pan", "tilt", "zoom")}
        match order:
            case MoveTo() | MoveBy():
                kept = {name: getattr(order, name) if axes[name] else None for name in axes}
                return type(order)(**kept) if any(value is not None for value in kept.values()) else None
            case Turn():
                pan = order.pan_percent if axes["pan"] else 0.0
                tilt = order.tilt_percent if axes["tilt"] else 0.0
                return replace(order, pan_percent=pan, tilt_percent=tilt)
            case ZoomRun():
                return order if axes["zoom"] else None

    def go_home(self, source: str) -> None:
        """Move to the Home preset."""
        home = self.presets[int(self.parameters["PTZ.Preset.P0.HomePosition"])]
        self.force(MoveTo(pan=home.pan, tilt=home.tilt, zoom=home.zoom), source, preset=True)

    def at_home(self) -> bool:
        """Whether the motors stand at the Home preset or are on their way there."""
        home = self.presets[int(self.parameters["PTZ.Preset.P0.HomePosition"])]
        if self.head.busy(self.clock.now_s()):
            return self.preset_move
        pose = self.head.encoder(self.clock.now_s())
        off = max(abs(math.remainder(pose.pan_deg - home.pan, 360.0)), abs(pose.tilt_deg - home.tilt))
        return off < 0.02 and abs(pose.zoom - home.zoom) < 1

    def go_preset(self, number: int, user: User) -> bool:
        """Move to a preset; False when there is none of this number."""
        preset = self.presets.get(number)
        if preset is not None:
            self.force(MoveTo(pan=preset.pan, tilt=preset.tilt, zoom=preset.zoom), user.name, preset=True)
        return preset is not None

    def store_preset(self, name: str, number: int | None = None) -> int:
        """Keep the present position under a name; the same name or number is overwritten. Returns the number."""
        same = next((key for key, preset in self.presets.items() if preset.name == name), None)
        free = next(key for key in range(1, 258) if key not in self.presets)
        key = number or same or free
        pose = self.head.encoder(self.clock.now_s())
        quantise = self.profile.quantise
        self.presets[key] = Preset(
            name=name, pan=quantise(pose.pan_deg), tilt=quantise(pose.tilt_deg), zoom=round(pose.zoom)
        )
        self._write_presets()
        return key

    def rename_preset(self, number: int, name: str) -> bool:
        """Give a preset another name; False when there is none of this number."""
        preset = self.presets.get(number)
        if preset is not None:
            self.presets[number] = replace(preset, name=name)
            self._write_presets()
        return preset is not None

    def remove_preset(self, number: int) -> bool:
        """Forget a preset; False when there is none of this number."""
        found = self.presets.pop(number, None) is not None
        self._write_presets()
        return found

    def preset_number(self, name: str) -> int | None:
        """Number of a preset by its name."""
        return next((number for number, preset in self.presets.items() if preset.name == name), None)

    def _write_presets(self) -> None:
        prefix = "PTZ.Preset.P0.Position."
        for name in [name for name in self.parameters if name.startswith(prefix)]:
            del self.parameters[name]
        for number, preset in sorted(self.presets.items()):
            data = (
                f"tilt={preset.tilt:.6f}:focus=32766.000000:pan={preset.pan:.6f}"
                f":iris=32766.000000:zoom={preset.zoom:.6f}"
            )
            self.parameters[f"{prefix}P{number}.Data"] = data
            self.parameters[f"{prefix}P{number}.Name"] = preset.name

    def reported(self) -> Pose:
        """What a position query says now."""
        return self.head.reported(self.clock.now_s())


def _adapted(kind: Profile, settings: SimSettings) -> Profile:
    """The profile with what the settings change of it."""
    if settings.digital_zoom:
        kind = replace(kind, zoom=replace(kind.zoom, high=DIGITAL_ZOOM_MAX))
    return kind if settings.home is None else replace(kind, home=settings.home)


def _flipping(tilt: AxisSpec, settings: SimSettings) -> AxisSpec:
    return tilt if settings.e_flip_tilt_deg is None else replace(tilt, low=settings.e_flip_tilt_deg)
