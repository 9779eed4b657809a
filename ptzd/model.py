"""Values shared by every room: frozen, slotted, keyword-only; one that exists is legal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

MIN_BOX_SIDE_PX = 8.0
"""Smallest side of a box in px: requests below it are refused, since so few pixels carry too little texture."""
MATCH_BUDGET_S = 5.0
"""Most work of one match where the settings say nothing; a common match takes a hundredth of it."""


class Motion(StrEnum):
    """What the head is doing, as far as the latest positions tell."""

    UNKNOWN = "unknown"
    MOVING = "moving"
    SETTLING = "settling"
    STABLE = "stable"


class Matcher(StrEnum):
    """Which matcher recognises the region."""

    SWEEP = "sweep"
    HARRIS = "harris"


class ZoneKind(StrEnum):
    """What is forbidden in a zone."""

    NO_GO = "no_go"
    """The optical axis neither rests there nor passes through."""
    PRIVACY = "privacy"
    """May be passed; never dwelt on nor zoomed into, black in every picture."""
    IGNORE = "ignore"
    """Boxes whose centre lies inside are refused."""


class Outcome(StrEnum):
    """How a request ended. Every accepted or refused request has exactly one."""

    LOCKED = "locked"
    RELEASED = "released"
    NOT_FOUND = "not_found"
    AMBIGUOUS = "ambiguous"
    NO_TEXTURE = "no_texture"
    UNREACHABLE = "unreachable"
    STALE_FRAME = "stale_frame"
    PREEMPTED = "preempted"
    CANCELLED = "cancelled"
    TIMEOUT = "timeout"
    LOST = "lost"
    DEVICE_LOST = "device_lost"
    SHADOW = "shadow"
    """Nothing moves, so nobody can know: pictures of where the head would have looked were not taken."""
    REJECTED = "rejected"


REFUSED = frozenset({Outcome.STALE_FRAME, Outcome.REJECTED})
"""How requests end that were never accepted."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A continuous rectangle in a picture whose pixel centres lie at integers.

    Corners are ``(x, y)`` and ``(x + w, y + h)``, the centre is ``(x + w/2, y + h/2)``. All in px.
    """

    x: float
    y: float
    w: float
    h: float

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.x, self.y, self.w, self.h))):
            raise ValueError(f"box has a value that is not finite: {self.x}, {self.y}, {self.w}, {self.h} px")
        if self.w <= 0 or self.h <= 0:
            raise ValueError(f"box has no area: w = {self.w} px, h = {self.h} px")

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the rectangle, px."""
        return (self.x + self.w / 2, self.y + self.h / 2)

    @property
    def corners(self) -> tuple[tuple[float, float], ...]:
        """Four corners, clockwise in the picture from the top left, in px."""
        right, bottom = self.x + self.w, self.y + self.h
        return ((self.x, self.y), (right, self.y), (right, bottom), (self.x, bottom))


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameRef:
    """Names one picture of one stream."""

    seq: int
    """Counter of the stream, from 0; gaps are pictures that the device lost."""
    t_capture_ns: int
    """Middle of the exposure as far as known, ns since the epoch on the daemon's steady clock."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RegionAsked:
    """What somebody outside wants looked at: a box in a fisheye frame, by counter or by time; the newest if neither."""

    box: Box
    frame_seq: int | None = None
    frame_t_capture_ns: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Region:
    """What is looked for: a box in a fisheye frame that is there."""

    box: Box
    frame: FrameRef


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadReading:
    """A pose of the head in the camera's own units (VAPIX)."""

    pan_deg: float
    tilt_deg: float
    zoom: float
    """VAPIX zoom units, 1 = widest."""

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (self.pan_deg, self.tilt_deg, self.zoom))):
            raise ValueError(f"head reading is not finite: {self.pan_deg}, {self.tilt_deg}, {self.zoom}")


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadPose:
    """A pose in the calibrated head frame, as the key ``pose`` and the pictures tell it."""

    pan_deg: float
    tilt_deg: float
    zoom: float
    """VAPIX zoom units, 1 = widest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadSpeed:
    """How fast a head turns and zooms, in the camera's own sense of its axes."""

    pan_deg_s: float = 0.0
    tilt_deg_s: float = 0.0
    zoom_rate: float = 0.0
    """-1 to 1: share of the fastest zoom, positive to the tele end."""


AUTOMATIC = 0
"""Focus or iris as the camera thinks best."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """Focus and iris in VAPIX units from 1, or `AUTOMATIC`; None: as it is."""

    focus: int | None = None
    iris: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadLimits:
    """Where the head may go, in the camera's own units; ``endless_pan`` heads wrap at ±180°."""

    pan_deg: tuple[float, float]
    tilt_deg: tuple[float, float]
    zoom: tuple[float, float]
    endless_pan: bool = False
    top_deg_s: tuple[float, float] | None = None
    """Fastest continuous pan and tilt; None: not known."""
    focus: tuple[float, float] | None = None
    """VAPIX focus units; None: no focus by hand."""
    iris: tuple[float, float] | None = None
    """VAPIX iris units; None: no iris by hand."""

    def contains(self, reading: HeadReading, tolerance: float = 1e-6) -> bool:
        """Whether the reading lies inside, with a tolerance in the axis' own unit for rounding."""
        pan_ok = self.endless_pan or self.pan_deg[0] - tolerance <= reading.pan_deg <= self.pan_deg[1] + tolerance
        tilt_ok = self.tilt_deg[0] - tolerance <= reading.tilt_deg <= self.tilt_deg[1] + tolerance
        zoom_ok = self.zoom[0] - tolerance <= reading.zoom <= self.zoom[1] + tolerance
        return pan_ok and tilt_ok and zoom_ok


@dataclass(frozen=True, slots=True, kw_only=True)
class ViewRef:
    """A PTZ picture taken at rest, with the pose it was taken at."""

    frame: FrameRef
    reading: HeadReading
    sigma_deg: float
    """One sigma of the pose, deg on the sphere, timing and repeatability together."""


class Turn(StrEnum):
    """What two pictures say of the poses that were reported for them."""

    AGREES = "agrees"
    UNMOVED = "unmoved"
    """The later one shows what the earlier one did, though the head is reported elsewhere."""
    SLIPPED = "slipped"
    """The later one looks elsewhere than is reported."""
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True, kw_only=True)
class Turned:
    """Two pictures at rest, compared with their reported poses."""

    verdict: Turn
    before: HeadReading
    after: HeadReading
    share: float = 0.0
    """Of the blocks with structure, those that show the same as the verdict says."""
    pan_off_deg: float = 0.0
    """Where the later picture looks minus where it is reported; of ``SLIPPED`` only."""
    tilt_off_deg: float = 0.0
    turned: bool = False
    """Whether the poses are far enough apart to tell standing from turning."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Candidate:
    """One place in one view where the region may be."""

    pan_rad: float
    tilt_rad: float
    """Direction of the surface seen at the box's centre, in the calibrated head frame."""
    inverse_range: float
    """1/range along the fisheye's ray, in 1/m (1/baseline when the rig is not metric); 0 = infinitely far."""
    offset_rad: float
    """How far the place lies across the epipolar arc."""
    score: float
    """Robust similarity in [-1, 1]; 1 = identical up to gain and offset."""
    sharpness: float
    """Curvature of the score along the arc at the peak, in score per (fisheye pixel)²; 0 = flat."""
    sigma_rad: float
    """One sigma of the direction from the residuals."""
    plane: tuple[float, float, float]
    """N of ``H = I + T Nᵀ`` on pre-rotated rays (paper, eq. 6); N·(R P_f) is the inverse range."""
    box_px: tuple[tuple[float, float], ...]
    """The region's four corners in the view, px; may lie outside the picture."""
    inliers: int = 0
    """Corners that agree with the plane (a second witness; the paper's count for ``harris``)."""
    in_view: float = 1.0
    """Share of the region's samples that fall inside the view."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What came of a request: of each exactly one, on the bus and in the log."""

    id: str
    outcome: Outcome
    reason: str
    """One sentence."""
    label: str
    elapsed_ms: int
    views: int
    """Pictures taken for it."""
    pan_deg: float | None = None
    """Where the target is, calibrated head frame, pan right +, tilt up +; None where none was found."""
    tilt_deg: float | None = None
    zoom: float | None = None
    """Of the last picture, VAPIX zoom units."""
    hfov_deg: float | None = None
    box_ptz: tuple[tuple[float, float], ...] = ()
    """Corners of the region in the last picture, px."""
    range_m: float | None = None
    """In baselines when the rig is not metric; None when unknown or infinitely far."""
    probability: float | None = None
    sigma_deg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LeaseHeld:
    """Who has the head for himself."""

    owner: str
    rank: int
    since_ns: int
    until_ns: int
    """At the latest; sooner when nothing is heard of him."""
    wanted_by: str = ""
    """Who asked for it last."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GotoShown:
    """The place that an operator sent the head to."""

    place: str
    by: str
    since_ns: int
    """When it was asked for."""
    there_ns: int | None = None
    """None: on the way."""
    until_ns: int | None = None
    """How long it stays; None: on the way, or kept by `hold`."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PatrolShown:
    """The patrol that is under way."""

    patrol: str
    place: str
    """Where it is, goes, or goes on."""
    phase: str
    """``on the way``, ``there``, ``waiting`` for whatever goes before it, or ``paused``."""
    since_ns: int
    scheduled: bool = False
    """The schedule began it."""
    paused: str = ""
    """By what."""
    until_ns: int | None = None
    """When it goes on to the next place; None: not there."""
    trouble: str = ""
    """Why the head did not get to a place, until it does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class HomeAfter:
    """How long the head is left where it is before it goes home, as somebody said while the daemon ran."""

    after_s: float | None
    """None: it does not go home by itself."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MatchResult:
    """What a matcher says of one region in one view."""

    matcher: Matcher
    texture: float
    """Standard deviation of the region's high-passed grey values over the sensor's noise; < 1 = texture-free."""
    candidates: tuple[Candidate, ...]
    """Separate peaks, best first."""
    coverage: tuple[float, float]
    """Interval of inverse range that this view could show; (0, 0) when none."""
    seed: int
    elapsed_ms: float
    """Time of the matcher alone; never looked at by a decision."""
