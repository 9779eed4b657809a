"""What a simulated rig is told: frozen, every default a plausible camera on a plausible pole."""

from __future__ import annotations

from dataclasses import dataclass, field

from ptzd.sim.auth import Policy, Role, User
from ptzd.sim.profile import Mount


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationError:
    """What the handed-out calibration states wrongly; zero: the truth."""

    rotation_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector put on top of the rig's."""
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pan_offset_deg: float = 0.0
    tilt_offset_deg: float = 0.0
    focal_share: float = 0.0
    """Relative error of every focal length of the PTZ."""
    sigma_rotation_deg: float = 0.1
    """Stated uncertainty."""
    sigma_translation_m: float = 0.005
    sigma_head_deg: float = 0.03


@dataclass(frozen=True, slots=True, kw_only=True)
class SimSettings:
    """A rig without hardware."""

    scene: str = "room"
    profile: str = "v5915"
    user: str = "ptzd"
    password: str = field(default="pan-tilt-zoom", repr=False)
    role: Role = Role.OPERATOR
    ptz_right: bool = True
    extra_users: tuple[User, ...] = ()
    policy: Policy = Policy.RECOMMENDED
    basic_first: bool = False
    """Order of the challenges of ``basic_digest``."""
    https: bool = False
    """Also serve HTTPS with a self-signed certificate, on a port of its own."""
    nonce_life_s: float = 300.0
    seed: int = 1
    host: str = "127.0.0.1"
    ptz_port: int = 0
    """0: any free one."""
    fisheye_port: int = 0
    truth_port: int = 0
    ptz_size_px: tuple[int, int] = (640, 480)
    """Picture size that the handed-out calibration is made for."""
    ptz_noise_sigma: float = 2.0
    """Sensor noise in grey values."""
    fisheye_noise_sigma: float = 2.0
    fisheye_fps: float = 10.0
    fisheye_quality: int = 90
    fisheye_size_px: tuple[int, int] | None = None
    """Other than the scene's own: the same lens at another resolution."""
    image_latency_s: float = 0.07
    """Middle of the exposure to the first byte on the wire."""
    fisheye_latency_s: float = 0.04
    exposure_s: float = 0.01
    """Motion during it blurs the picture."""
    default_fps: float = 25.0
    """Of streams that ask for 0 (unlimited)."""
    max_viewers: int = 20
    max_configurations: int = 4
    """Different MJPEG settings at the same time, above which the answer is 503."""
    boot_s: float = 3.0
    """Refused connections of a reboot; half as long again the answer is 503."""
    wrong_password_s: float = 0.2
    """The camera's time to say no to a wrong password."""
    e_flip_tilt_deg: float | None = None
    """Lower tilt limit past -90 with the picture turned there (domes); None: no E-flip."""
    digital_zoom: bool = False
    """Zoom goes on to 19999 by cropping."""
    auto_exposure: bool = False
    """A gain step that fades after each larger move."""
    mount: Mount | None = None
    """None: the profile's."""
    calibration: CalibrationError = CalibrationError()
    home: tuple[float, float, float] | None = None
    """Pan, tilt, zoom of the Home preset; None: the profile's."""
    faults: str | None = None
    """Path of a fault script (YAML)."""
