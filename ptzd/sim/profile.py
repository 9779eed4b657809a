"""What kinds of AXIS camera the simulator can be: frozen data, one profile per kind.

Ranges and formats follow recorded answers of cameras of each class (position keys and decimals, limits, presets);
speeds, latencies and lags are stated assumptions where no source gives a figure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ptzd.errors import SimulationError
from ptzd.sim.motion import AxisSpec

ZOOM_STEPS = 9999
"""Highest optical zoom unit of VAPIX."""
SENSOR_PX = (1920, 1440)
"""The sensor; other shapes of picture are cut out of its middle."""

SpeedTable = tuple[tuple[float, float], ...]

SLOW_START_TABLE: SpeedTable = (
    (1, 0.05), (9, 0.16), (14, 2.0), (24, 2.1), (40, 9.0), (58, 28.0), (80, 74.0), (100, 150.0),
)  # fmt: skip
"""Speed index → deg/s as documented for ``query=attributes``: strongly non-linear."""
LINEAR_TABLE: SpeedTable = ((1, 1.5), (100, 150.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Optics:
    """The true lens, which no client is told."""

    hfov_wide_deg: float
    hfov_tele_deg: float
    bend: float = 0.05
    """Departure of the magnification from linear in zoom: ``m · (1 + bend · sin π u)``."""
    k1_wide: float = -0.09
    """First radial distortion coefficient at the wide end; fades with magnification."""
    centre_wide_px: tuple[float, float] = (0.006, -0.004)
    """Principal point off the middle at the wide end, in shares of the picture's width."""
    centre_tele_px: tuple[float, float] = (-0.010, 0.007)
    """The same at the tele end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """Delays between a command, the motors, and what is reported."""

    latency_s: float = 0.12
    """Mean time from an accepted command to motion."""
    latency_sigma_s: float = 0.04
    latency_bounds_s: tuple[float, float] = (0.08, 0.20)
    serialise_s: float = 0.0
    """Least time between two commands taken up; > 0: commands wait in a buffer (old drivers)."""
    report_refresh_s: float = 0.07
    """Position reports are renewed this often."""
    report_lag_s: float = 0.08
    """Age of a report when it is renewed."""
    event_lag_s: float = 0.05
    """Delay of the ``is_moving`` event after the motor starts or stops."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Mount:
    """How the head sits against the frame `head` of the scene: the hidden truth that a calibration has to state."""

    pan_offset_deg: float = 1.7
    tilt_offset_deg: float = -0.9
    """Negative: the camera on its tilt axis looks down when the encoder says 0 (a pitched bracket)."""
    pan_scale: float = 1.0
    tilt_scale: float = 1.0
    camera_rotvec_deg: tuple[float, float, float] = (0.20, -0.15, 0.40)
    """Misalignment of the camera on the tilt axis."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Profile:
    """One kind of camera."""

    name: str
    product: str
    """Product number, e.g. ``V5915``."""
    firmware: str
    serial: str
    driver: str
    """Answer to ``whoami``."""
    pan: AxisSpec
    tilt: AxisSpec
    zoom: AxisSpec
    quantum_deg: float
    """Step of the pan and tilt encoders."""
    decimals: int
    """Decimals of reported angles."""
    position_keys: tuple[str, ...]
    """Keys of ``query=position`` in their order."""
    optics: Optics
    field_angle: tuple[int, int]
    """Advertised narrowest and widest field of view, 1/10°."""
    speed_table: SpeedTable
    """Speed index of absolute and relative moves → deg/s."""
    continuous_exponent: float = 1.0
    """Speed of continuous moves: ``(percent/100) ** exponent · v_max``."""
    timing: Timing = Timing()
    zoom_jitter: int = 0
    """Reported zoom differs by up to this from the commanded one, the same until the next move."""
    repeat_sigma_deg: float = 0.0008
    """How exactly the optics come back to the same encoder value; never further off than half a step of it."""
    has_attributes: bool = True
    """Whether ``query=attributes`` exists."""
    has_events: bool = True
    """Whether there is an event stream over WebSocket (AXIS OS 10.11 and later)."""
    old_style_digest: bool = False
    """Challenges of firmware 4."""
    reversed_mount: bool = False
    """Hung the other way round: pan and tilt count against the head frame."""
    mount: Mount = Mount()
    """How the simulator hangs it up unless told otherwise."""
    home: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Pan, tilt, zoom of the Home preset."""
    resolutions: tuple[str, ...] = (
        "1920x1080", "1280x960", "1280x720", "1024x768", "800x600", "800x450", "640x480", "640x360", "480x270",
        "320x240", "320x180", "160x120",
    )  # fmt: skip

    @property
    def full_name(self) -> str:
        """Name in the camera's own pages."""
        return f"AXIS {self.product} PTZ Network Camera"

    @property
    def max_magnification(self) -> float:
        """Magnification of the tele end that the camera believes in (ratio of the tangents)."""
        wide, tele = self.optics.hfov_wide_deg, self.optics.hfov_tele_deg
        return math.tan(math.radians(wide) / 2) / math.tan(math.radians(tele) / 2)

    def quantise(self, angle_deg: float) -> float:
        """Nearest encoder step."""
        return round(angle_deg / self.quantum_deg) * self.quantum_deg

    def move_speed(self, index: float) -> float:
        """Speed in deg/s of absolute and relative moves at speed index 1…100."""
        indices, speeds = zip(*self.speed_table, strict=True)
        return float(np.exp(np.interp(index, indices, np.log(speeds))))

    def continuous_share(self, percent: float) -> float:
        """Signed share of the top speed of a continuous move at −100…100 %."""
        return math.copysign((abs(percent) / 100) ** self.continuous_exponent, percent)


def _angle_axis(low: float, high: float, v_max: float, a_max: float, *, endless: bool = False) -> AxisSpec:
    return AxisSpec(low=low, high=high, v_max=v_max, a_max=a_max, endless=endless, ring_s=4e-4)


_FULL_KEYS = ("pan", "tilt", "zoom", "iris", "focus", "brightness", "autofocus", "autoiris")

V5915 = Profile(
    name="v5915",
    product="V5915",
    firmware="10.12.91",
    serial="ACCC8E5915A1",
    driver="Sony_camblock",
    pan=_angle_axis(-170, 170, 100, 400),
    tilt=_angle_axis(-20, 90, 90, 400),
    zoom=AxisSpec(low=1, high=ZOOM_STEPS, v_max=3500, a_max=14000),
    quantum_deg=1 / 256,
    decimals=4,
    position_keys=_FULL_KEYS,
    optics=Optics(hfov_wide_deg=62.3, hfov_tele_deg=2.2),
    field_angle=(22, 623),
    speed_table=SLOW_START_TABLE,
    continuous_exponent=2.38824,
    mount=Mount(tilt_offset_deg=-30.3),
)

DOME = Profile(
    name="dome",
    product="Q6075-E",
    firmware="10.12.91",
    serial="B8A44F60751E",
    driver="Axis_ptz_dome",
    pan=_angle_axis(-180, 180, 150, 500, endless=True),
    tilt=_angle_axis(-90, 20, 150, 500),
    zoom=AxisSpec(low=1, high=ZOOM_STEPS, v_max=5000, a_max=20000),
    quantum_deg=0.0011,
    repeat_sigma_deg=0.0002,
    decimals=4,
    position_keys=("pan", "tilt", "zoom", "autofocus", "autoiris"),
    optics=Optics(hfov_wide_deg=65.1, hfov_tele_deg=2.0, bend=-0.04, k1_wide=-0.11),
    field_angle=(20, 651),
    speed_table=LINEAR_TABLE,
)

OLD214 = Profile(
    name="old214",
    product="214 PTZ",
    firmware="4.49",
    serial="00408C8121A4",
    driver="Sony_camblock",
    pan=_angle_axis(-170, 170, 90, 250),
    tilt=_angle_axis(-30, 90, 70, 250),
    zoom=AxisSpec(low=1, high=ZOOM_STEPS, v_max=2500, a_max=10000),
    quantum_deg=0.01,
    decimals=2,
    position_keys=("pan", "tilt", "zoom", "iris", "focus", "autofocus", "autoiris"),
    optics=Optics(hfov_wide_deg=48.0, hfov_tele_deg=2.7, bend=0.12, k1_wide=-0.14),
    field_angle=(27, 480),
    speed_table=SLOW_START_TABLE,
    timing=Timing(latency_s=0.3, latency_sigma_s=0.08, latency_bounds_s=(0.15, 0.6), serialise_s=1.0,
                  report_refresh_s=0.1, report_lag_s=0.15, event_lag_s=0.1),
    repeat_sigma_deg=0.002,
    has_events=False,
    old_style_digest=True,
    has_attributes=False,
    resolutions=("768x576", "704x576", "704x288", "640x480", "352x288", "320x240", "176x144", "160x120"),
)  # fmt: skip

INVERTED = Profile(
    name="inverted",
    product="Q6215-LE",
    firmware="10.12.91",
    serial="B8A44F62151E",
    driver="Axis_ptz_dome",
    pan=_angle_axis(-180, 180, 150, 500),
    tilt=_angle_axis(-45, 90, 150, 500),
    zoom=AxisSpec(low=1, high=ZOOM_STEPS, v_max=4000, a_max=16000),
    quantum_deg=1 / 256,
    decimals=4,
    position_keys=_FULL_KEYS,
    optics=Optics(hfov_wide_deg=58.3, hfov_tele_deg=2.1, bend=0.03, k1_wide=-0.07),
    field_angle=(21, 583),
    speed_table=SLOW_START_TABLE,
    zoom_jitter=2,
    reversed_mount=True,
)

PROFILES: dict[str, Profile] = {profile.name: profile for profile in (V5915, DOME, OLD214, INVERTED)}


def profile(name: str) -> Profile:
    """Profile of this name.

    Raises
    ------
    SimulationError
        When there is none; the message lists the names.
    """
    if name not in PROFILES:
        raise SimulationError(f"no camera profile {name!r}; there are {', '.join(sorted(PROFILES))}")
    return PROFILES[name]
