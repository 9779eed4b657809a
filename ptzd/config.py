"""Settings of the daemon: one frozen class per part, units in the names, unknown keys refused by path.

The text of ``config/ptzd.yaml`` documents every key; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import msgspec
from msgspec import Meta, field

from ptzd.config_types import (
    DAY_S,
    Angle,
    Bytes,
    Degrees,
    Interval,
    Name,
    Part,
    PositiveSeconds,
    PositiveSpeed,
    Probability,
    Rate,
    Seconds,
    Share,
    Size,
    Word,
    ZoomUnit,
    check_order,
    check_range,
    converted,
    refuse_not_finite,
)
from ptzd.config_zones import Zones, check_zones
from ptzd.errors import ConfigError
from ptzd.model import MATCH_BUDGET_S, Matcher
from ptzd.presets import Presets, parse_presets


class V4l2Source(Part, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="source", tag="v4l2"):
    """A camera behind a kernel driver."""

    device: str
    """Stable name, e.g. ``/dev/v4l/by-id/…-video-index0``; numbers change at every replug."""
    size_px: Size
    fps: Rate = 30.0
    format: Literal["MJPG", "JPEG", "YUYV", "UYVY", "GREY"] = "MJPG"
    controls: dict[str, Word] = field(default_factory=dict)
    """Driver controls by name, set at every open, e.g. ``{exposure_time_absolute: 150}``."""
    stall_s: PositiveSeconds = 2.0
    """No frame for this long = the camera is lost."""


class HttpSource(Part, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="source", tag="http"):
    """A fisheye that serves MJPEG over HTTP."""

    url: str
    user: str | None = None
    password_file: str | None = None
    latency_s: Seconds = 0.0
    """Exposure to arrival of the last byte."""
    stall_s: PositiveSeconds = 2.0
    allow_basic_over_http: bool = False
    certificate_sha256: str | None = None
    """SHA-256 of the certificate to insist on, 64 hex digits, whoever signed it."""


class FilesSource(Part, frozen=True, forbid_unknown_fields=True, kw_only=True, tag_field="source", tag="files"):
    """Pictures from a folder, in the order of their names."""

    path: str
    fps: Rate = 10.0
    loop: bool = True


FisheyeSource = V4l2Source | HttpSource | FilesSource


class Ptz(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The AXIS camera and its stream."""

    url: str
    """``http://host[:port]`` or ``https://host[:port]``."""
    user: str
    password_file: str | None = None
    """A file with one line; without it ``$CREDENTIALS_DIRECTORY/axis-password``."""
    camera: Annotated[int, Meta(ge=1, le=64)] = 1
    size_px: Size = (640, 480)
    fps: Rate = 15.0
    compression: Annotated[int, Meta(ge=0, le=100)] = 20
    allow_basic_over_http: bool = False
    """Basic sends the password readable by anybody on the way: only over TLS unless this is true."""
    certificate_sha256: str | None = None
    """Fingerprint of a self-signed certificate (hex, colons allowed); without it the system's authorities decide."""
    poll_hz: Annotated[float, Meta(ge=1, le=25)] = 10.0
    image_latency_s: Seconds = 0.10
    """Middle of the exposure to arrival of the last byte."""
    report_lag_s: Seconds = 0.10
    """Age of a reported position."""
    arrival_tolerance_deg: Degrees = 0.05
    zoom_tolerance: Annotated[float, Meta(gt=0, le=9999)] = 8.0
    """VAPIX zoom units."""
    settle_s: Seconds = 0.2
    """Rest before a picture counts, on top of the stable positions."""
    move_spacing_s: Seconds = 0.1
    """Least time between two moves; 1.0 for cameras of the 214 class, which buffer commands."""
    move_timeout_s: PositiveSeconds = 15.0
    stall_s: PositiveSeconds = 5.0
    steer_top_deg_s: tuple[PositiveSpeed, PositiveSpeed] | None = None
    """Fastest continuous pan and tilt, deg/s; without it, what the camera says of its moves."""
    steer_exponent: Annotated[float, Meta(ge=1, le=4)] = 1.0
    """Of their speed over the percent asked for: 1 = in proportion (domes), about 2.4 = articulated heads."""
    endless_pan: bool | None = None
    """Whether the head turns on over ±180°; without it, told from the camera's pan limits."""


class Limits(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the head may go, in the camera's own units; intersected with the camera's own limits."""

    pan_deg: tuple[Angle, Angle] = (-180.0, 180.0)
    tilt_deg: tuple[Angle, Angle] = (-90.0, 90.0)
    zoom: tuple[ZoomUnit, ZoomUnit] = (1.0, 9999.0)


class Home(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where the head rests, in the camera's own units."""

    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    zoom: float = 1.0
    idle_s: Seconds = 5.0
    """Quiet time after the last request before the head goes home."""


class Search(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Scan and match."""

    matcher: Matcher = Matcher.SWEEP
    range_m: Interval = (1.0, 100.0)
    """Default interval of range (in baselines when the rig is not metric); ``.inf`` allowed as its end."""
    scan_hfov_deg: Annotated[float, Meta(gt=0, lt=180)] | None = None
    """Field of view of the scan; without it, chosen from the region's sampling."""
    accept_probability: Probability = 0.8
    """At or above it a match is believed."""
    certain_probability: Probability = 0.97
    """At or above it the remaining views are not taken."""
    max_rounds: Annotated[int, Meta(ge=1, le=3)] = 2
    """Scans of one request; each further one looks closer."""
    frame_max_age_s: PositiveSeconds = 3.0
    """A request on an older fisheye frame is refused as stale."""
    seed: Annotated[int, Meta(ge=0, le=(1 << 63) - 1)] = 1
    match_budget_s: Annotated[float, Meta(ge=0.1, le=20)] = MATCH_BUDGET_S
    """Most time of one match, counted in work and not by the clock; a match that needs more fails and says so."""


class Lock(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Centre, zoom, verify, hold."""

    tolerance_deg: Degrees = 0.15
    """Offset under which the lock needs no further correction."""
    max_corrections: Annotated[int, Meta(ge=0, le=5)] = 2
    fill: Share = 0.5
    hold_s: Seconds = 5.0
    verify_every_s: PositiveSeconds = 2.0
    verify_probability: Probability = 0.6
    sigma_limit: Annotated[float, Meta(gt=0, le=100)] = 3.0
    """Never zoom so far that this many sigma of the pointing error leave the picture."""


class Queue(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Waiting requests."""

    size: Annotated[int, Meta(ge=0, le=64)] = 8
    timeout_s: PositiveSeconds = 60.0
    """Default time from acceptance to the lock."""
    results_kept_s: PositiveSeconds = 600.0


class Lease(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A person who has the head."""

    max_s: Annotated[float, Meta(gt=0, le=86_400)] = 900.0
    """Longest lease; whoever wants it longer takes it again."""
    silence_s: Annotated[float, Meta(ge=1, le=3600)] = 5.0
    """Over after so long without a word from whoever has it."""


class Motor(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Sparing the motors."""

    dead_zone_deg: Annotated[float, Meta(ge=0, le=5)] = 0.05
    """A set point this near to where the head rests is not driven; less where the lens or the lock needs it."""
    moves_per_hour: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    """Budget of the last hour; None: no end."""
    degrees_per_hour: Annotated[float, Meta(ge=1, le=10_000_000)] | None = None
    """The same for pan and tilt together."""
    watch: bool = True
    """Whether pictures are compared, to tell a stuck head and one that has lost its zero."""
    reserve: Annotated[float, Meta(ge=0, le=0.5)] = 0.2
    """Share of a budget that requests of the lowest priority leave to higher ones; patrols leave twice that."""


class Shadow(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Decide and log everything, move nothing."""

    enabled: bool = False
    """Also by ``ptzd run --shadow``."""
    speed_deg_s: Annotated[float, Meta(gt=0, le=2000)] | None = None
    """Of the head that is imagined; None: what the camera says of itself, else 100."""
    acceleration_deg_s2: Annotated[float, Meta(gt=0, le=20_000)] = 400.0
    zoom_units_s: Annotated[float, Meta(gt=0, le=100_000)] = 3500.0


class Ranges(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What confirmed locks teach of the scene's ranges."""

    learn: bool = True
    """Whether they are kept and used; they order the looks and never decide."""
    half_life_h: Annotated[float, Meta(ge=0.1, le=8760)] = 72.0
    """A lock counts half as much after each."""


class BusSettings(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The Zenoh session."""

    prefix: Annotated[str, Meta(pattern=r"^[A-Za-z0-9._-]+(/[A-Za-z0-9._-]+)*$(?!\n)")] = "ptzd"
    mode: Literal["peer", "router", "client"] = "peer"
    listen: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    connect: tuple[str, ...] = ()
    config_file: str | None = None
    """A Zenoh JSON5 file (TLS, access control); the keys above are put on top of it."""


class LogSettings(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The black box."""

    directory: str = "log"
    fisheye_every_n: Annotated[int, Meta(ge=1, le=1_000_000)] = 1
    """Of the fisheye frames that no request used, every n-th is kept; used ones always are."""
    rotate_bytes: Bytes = 1 << 30
    rotate_s: Annotated[float, Meta(ge=1, le=7 * DAY_S)] = 300.0
    keep_bytes: Bytes = 20 << 30
    keep_days: Annotated[float, Meta(gt=0, le=36_500)] = 30.0
    min_free_bytes: Annotated[int, Meta(ge=0, le=1 << 50)] = 2 << 30
    queue_frames: Annotated[int, Meta(ge=1, le=10_000)] = 64


class DriftSettings(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What confirmed locks say of the calibration."""

    monitor: bool = False
    """Whether offsets of locks across their arcs are kept, logged and reported when their median leaves the band."""
    refine: bool = False
    """Whether R is then turned back onto them, in a calibration of its own beside the log; needs ``monitor``."""


class Config(Part, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Everything the daemon is told."""

    rig: Name
    calibration: str
    """Path of rig.yaml, relative to this file."""
    fisheye: FisheyeSource
    ptz: Ptz
    limits: Limits = Limits()
    home: Home = Home()
    search: Search = Search()
    lock: Lock = Lock()
    queue: Queue = Queue()
    lease: Lease = Lease()
    ranges: Ranges = Ranges()
    bus: BusSettings = BusSettings()
    log: LogSettings = LogSettings()
    drift: DriftSettings = DriftSettings()
    motor: Motor = Motor()
    shadow: Shadow = Shadow()
    zones: Zones = ()
    """Or the name of a file that holds them, under the key ``zones``."""
    presets: Presets = Presets()
    """Here, or in ``presets.yaml`` beside this file."""


WHILE_RUNNING = (
    "search",
    "lock",
    "home",
    "lease",
    "ranges",
    "motor",
    "presets",
    "queue.size",
    "queue.timeout_s",
    "log.fisheye_every_n",
    "log.rotate_bytes",
    "log.rotate_s",
    "log.keep_bytes",
    "log.keep_days",
    "log.min_free_bytes",
)
"""What a running daemon takes over when it reads its settings again: whole parts, or single keys of a part."""
CORE_PARTS = ("search", "lock", "home", "queue", "lease", "ranges", "motor", "presets")
"""Parts that decisions depend on and that may change while they are taken."""


def core_parts(config: Config) -> dict[str, object]:
    """The parts of :data:`CORE_PARTS` as plain values."""
    return {name: msgspec.to_builtins(getattr(config, name)) for name in CORE_PARTS}


def with_parts(config: Config, parts: Mapping[str, object]) -> Config:
    """Reverse of :func:`core_parts`: these settings with other parts.

    Raises
    ------
    ConfigError
        A part that is none of :data:`CORE_PARTS`, or that does not hold what it must.
    """
    strangers = sorted(parts.keys() - set(CORE_PARTS))
    if strangers:
        raise ConfigError(f"{', '.join(strangers)}: cannot change while the daemon runs; restart it")
    try:
        taken = {name: msgspec.convert(value, type(getattr(config, name))) for name, value in parts.items()}
    except msgspec.ValidationError as error:
        raise ConfigError(f"{', '.join(parts)}: {error}") from None
    return msgspec.structs.replace(config, **taken)


def parse_config(document: object, name: str) -> Config:
    """Turn a parsed YAML document into settings.

    Parameters
    ----------
    document : object
        What the YAML parser returned.
    name : str
        File name for messages.

    Raises
    ------
    ConfigError
        With the path of the culprit, e.g. ``ptzd.yaml: ptz.fps: Expected `float` > 0.0``.
    """
    if not isinstance(document, dict):
        raise ConfigError(f"{name}: the file must hold a mapping of settings, got {type(document).__name__}")
    refuse_not_finite(document, name, "")
    presets = parse_presets(document.get("presets"), f"{name}: presets")
    config = converted({**document, "presets": presets}, Config, name)
    _check_ranges(config, name)
    check_zones(config.zones, name)
    return config


def _check_ranges(config: Config, name: str) -> None:
    intervals: dict[str, Interval] = {
        "limits.pan_deg": config.limits.pan_deg,
        "limits.tilt_deg": config.limits.tilt_deg,
        "limits.zoom": config.limits.zoom,
    }
    for path, interval in intervals.items():
        check_order(interval, f"{name}: {path}")
    check_range(config.search.range_m, f"{name}: search.range_m")
    for axis, value in (
        ("pan_deg", config.home.pan_deg),
        ("tilt_deg", config.home.tilt_deg),
        ("zoom", config.home.zoom),
    ):
        low, high = intervals[f"limits.{axis}"]
        if not low <= value <= high:
            raise ConfigError(f"{name}: home.{axis}: {value} is outside limits.{axis} ({low} to {high})")
    if config.search.certain_probability < config.search.accept_probability:
        raise ConfigError(f"{name}: search.certain_probability: must not be below search.accept_probability")
