"""The scan plan: which poses of the head show the whole epipolar arc (paper, section 5.1).

A disc of the region's size plus the calibration's band around each direction of the arc must lie whole in some view.
A view's picture is a cone between four planes through the centre of the head; a disc of radius m around direction d is
inside when ``n · d >= sin m`` for the inward normals n of the four. Along the arc, ``d(u) = cos(u) r + sin(u) f``, each
plane then allows ``|u - u0| <= acos(sin m / C)``: what a view covers of the arc is an interval in closed form, at any
roll of the arc in the picture and also when the axis is off the arc, at the limits of the head. The fewest views are
found by the greedy cover of intervals, then spread evenly where that still covers all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ptzd.control.planning.reach import Reach
from ptzd.errors import GeometryError
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, normalise, rotation_from_rotvec, wrap_angle
from ptzd.geometry.types import Array, pixel_angle_rad
from ptzd.model import Box, HeadLimits, HeadReading

CANDIDATES_PER_VIEW = 16
"""Aims tried along half a view: the loss against the best plan is below 1/16 of half a view for each view."""
MAX_CANDIDATES = 2000
MAX_MARGIN_SHARE = 0.5
"""A region too large for the view is planned for with at most this share of the view's inscribed radius: its middle is
what recognises it."""
_EPSILON_RAD = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedView:
    """One pose to take a picture at."""

    reading: HeadReading
    hfov_rad: float
    """Horizontal field of view at its zoom."""
    s_interval: tuple[float, float]
    """Inverse ranges that the view shows with the region and the band around them, ascending."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanPlan:
    """Views in the order to be walked, along the arc from the end nearest to the present pose."""

    views: tuple[PlannedView, ...]
    unreachable: tuple[tuple[float, float], ...]
    """Intervals of inverse range, ascending, that no pose within the limits shows."""
    unreachable_share: float
    """Share of the arc's length in them, 0 to 1."""
    expected: float | None = None
    """Inverse range where a map of the scene expects the target; None: it has no say."""
    plain_hfov_rad: float | None = None
    """Field of view that the views would have without that map."""

    def unreachable_in_words(self, *, metric: bool) -> str:
        """What no pose shows, e.g. ``range 0.6 to 1.1 m, 23 % of the arc``; empty when all is reached."""
        if not self.unreachable:
            return ""
        unit = "m" if metric else "baselines"
        gaps = " and ".join(f"{_range(far)} to {_range(near)} {unit}" for near, far in self.unreachable)
        return f"range {gaps}, {_percent(self.unreachable_share)} of the arc"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aims:
    """Poses of the head and the interval of the arc each covers; arrays of one length."""

    pan_deg: Array
    tilt_deg: Array
    low: Array
    """First angle along the arc that is covered, rad; above ``high`` when none is."""
    high: Array
    """Last angle along the arc that is covered, rad; both may reach past the ends of the arc."""

    def take(self, chosen: list[int]) -> _Aims:
        """Return the poses with these indices."""
        return _Aims(
            pan_deg=self.pan_deg[chosen], tilt_deg=self.tilt_deg[chosen], low=self.low[chosen], high=self.high[chosen]
        )


def plan_views(
    rig: Rig,
    box: Box,
    interval: tuple[float, float],
    limits: HeadLimits,
    present: HeadReading,
    *,
    hfov_rad: float | None = None,
    overlap_rad: float = 0.0,
    band_rad: float | None = None,
    towards: float | None = None,
    reach: Reach | None = None,
) -> ScanPlan:
    """Return the views that show every direction where the box's target can be.

    Parameters
    ----------
    rig : Rig
        The calibration.
    box : Box
        Region in the fisheye's picture, px; its centre inside the image circle.
    interval : tuple[float, float]
        Inverse ranges to look at, ``0 <= s_min <= s_max < inf``, in the inverse unit of T.
    limits : HeadLimits
        Every reading of the plan lies inside.
    present : HeadReading
        Where the head is: the walk starts at the nearer end of the arc.
    hfov_rad : float, optional
        Field of view of the views; without it the widest at which a PTZ pixel is no larger than a fisheye pixel on the
        target. The zoom is a whole number of units where the limits have one.
    overlap_rad : float
        Room kept around the region and the band, on top of both.
    band_rad : float, optional
        How far off the arc the target may be; without it from the rig's uncertainty.
    towards : float, optional
        Inverse range where the target is expected: a single view is aimed as near to it as it still shows all.
    reach : Reach, optional
        Poses that zones forbid are left out; beside a zone the head looks into it as far as the picture reaches.

    Raises
    ------
    GeometryError
        When the box's centre is outside the image circle, the interval is empty, or no zoom within the limits is
        calibrated or has the field of view asked for.
    CalibrationError
        When there is neither ``band_rad`` nor an uncertainty.
    """
    ray, radius = _region(rig, box)
    arc = EpipolarArc.of(rig, ray, *interval)
    extremes = _extremes(arc)
    magnification = arc.magnification(extremes)
    if band_rad is None:
        band_rad = rig.band_rad(float(arc.head_inverse_range(extremes).max()))
    if hfov_rad is None:
        pixel_rad = pixel_angle_rad(rig.fisheye, box.centre) * float(magnification.min())
        zoom = _zoom_for_sampling(rig, limits, pixel_rad)
    else:
        zoom = _whole(rig.zoom.zoom_for_hfov(hfov_rad), *_zoom_range(rig, limits))
    camera = rig.zoom.camera_at(zoom)
    planes = _edge_planes(camera)
    inscribed = math.asin(float(planes[:, 2].min()))
    margin = min(radius * float(magnification.max()) + band_rad + overlap_rad, MAX_MARGIN_SHARE * inscribed)
    views: list[PlannedView] = []
    gaps: list[tuple[float, float]] = []
    length = missing = 0.0
    for piece in _pieces(arc):
        cover = _Cover(rig=rig, arc=piece, limits=limits, planes=planes, margin_rad=margin, zoom=zoom, reach=reach)
        chosen, missed = cover.plan((inscribed - margin) / CANDIDATES_PER_VIEW)
        if towards is not None and len(chosen.low) == 1 and not missed:
            chosen = cover.slid(chosen, towards)
        views += [_view(cover, chosen, index, zoom, camera.hfov_rad) for index in range(len(chosen.low))]
        gaps += [cover.interval(*gap) for gap in missed]
        first, last = cover.ends()
        length, missing = length + last - first, missing + sum(end - start for start, end in missed)
    if views and _travel(present, views[-1].reading, limits) < _travel(present, views[0].reading, limits):
        views.reverse()
    share = min(missing / length, 1.0) if length > 0.0 else float(bool(gaps))
    return ScanPlan(views=tuple(views), unreachable=tuple(gaps), unreachable_share=share)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %" if share >= 0.01 else "under 1 %"


def _range(inverse_range: float) -> str:
    return f"{1.0 / inverse_range:.3g}" if inverse_range > 0.0 else "infinity"


def _extremes(arc: EpipolarArc) -> Array:
    """Return the inverse ranges where magnification and nearness to the head are largest and smallest on the arc."""
    along = float(arc.translation @ arc.rotated)
    nearest = -1.0 / along if along < 0.0 else arc.s_max
    largest = -along / float(arc.translation @ arc.translation)
    return np.array([arc.s_min, arc.s_max, *np.clip([nearest, largest], arc.s_min, arc.s_max)])


def _pieces(arc: EpipolarArc) -> list[EpipolarArc]:
    """Return the arc, or its two points when the ray runs through the head's centre within the interval."""
    if not (arc.degenerate and arc.length_rad > 0.5 * math.pi):
        return [arc]
    at_head = 1.0 / float(np.linalg.norm(arc.translation))
    return [replace(arc, s_max=at_head * (1.0 - 1e-6)), replace(arc, s_min=at_head * (1.0 + 1e-6))]


def _view(cover: _Cover, aims: _Aims, index: int, zoom: float, hfov_rad: float) -> PlannedView:
    reading = HeadReading(pan_deg=float(aims.pan_deg[index]), tilt_deg=float(aims.tilt_deg[index]), zoom=zoom)
    s_interval = cover.interval(float(aims.low[index]), float(aims.high[index]))
    return PlannedView(reading=reading, hfov_rad=hfov_rad, s_interval=s_interval)


def _travel(start: HeadReading, end: HeadReading, limits: HeadLimits) -> float:
    """Return how far the axis that has the longer way turns, deg."""
    pan = end.pan_deg - start.pan_deg
    if limits.endless_pan:
        pan = (pan + 180.0) % 360.0 - 180.0
    return max(abs(pan), abs(end.tilt_deg - start.tilt_deg))


def _region(rig: Rig, box: Box) -> tuple[Array, float]:
    """Return the ray of the box's centre and the angle from it to the farthest part of the border that is seen."""
    x, y = box.centre
    border = [*box.corners, (x, box.y), (x, box.y + box.h), (box.x, y), (box.x + box.w, y)]
    rays, valid = rig.fisheye.lift(np.array([box.centre, *border]))
    if not valid[0]:
        raise GeometryError(f"box: its centre ({x:g}, {y:g}) px lies outside the fisheye's image circle")
    return rays[0], float(angle_between(rays[0], rays[valid]).max())


def _zoom_range(rig: Rig, limits: HeadLimits) -> tuple[float, float]:
    low, high = max(rig.zoom.zoom_range[0], limits.zoom[0]), min(rig.zoom.zoom_range[1], limits.zoom[1])
    if low > high:
        table, head = rig.zoom.zoom_range, limits.zoom
        raise GeometryError(f"zoom: calibrated {table[0]:g} to {table[1]:g}, allowed {head[0]:g} to {head[1]:g}")
    return float(low), float(high)


def _whole(zoom: float, low: float, high: float) -> float:
    """Return the zoom rounded up to a whole unit, or as it is where that would leave the range."""
    if not low - 1e-6 <= zoom <= high + 1e-6:
        raise GeometryError(f"zoom {zoom:g} is outside what is both calibrated and allowed, {low:g} to {high:g}")
    up = float(math.ceil(zoom - 1e-6))
    return up if low <= up <= high else min(max(zoom, low), high)


def _zoom_for_sampling(rig: Rig, limits: HeadLimits, pixel_rad: float) -> float:
    """Return the widest zoom whose central pixel is at most ``pixel_rad``, or the narrowest there is."""
    low, high = _zoom_range(rig, limits)
    focal = 1.0 / pixel_rad
    if rig.zoom.camera_at(low).fx >= focal:
        return low
    if rig.zoom.camera_at(high).fx <= focal:
        return high
    return _whole(rig.zoom.zoom_for_focal(focal), low, high)


@lru_cache(maxsize=16)
def _edge_planes(camera: PerspectiveCamera) -> Array:
    """Return the inward unit normals ``(4, 3)`` of the upright cone inscribed in the picture, in the camera frame."""
    width, height = camera.size_px
    across, down = np.linspace(-0.5, width - 0.5, 9), np.linspace(-0.5, height - 0.5, 9)
    edges = [
        np.stack(np.broadcast_arrays(x, y), axis=-1)
        for x, y in ((-0.5, down), (width - 0.5, down), (across, -0.5), (across, height - 0.5))
    ]
    rays, valid = camera.lift(np.stack(edges))
    if not valid.all():
        raise GeometryError(f"the distortion {camera.distortion} folds inside the PTZ's picture; calibrate it again")
    left, right, top, bottom = rays[..., :2] / rays[..., 2:]
    normals = normalise(
        [
            [1.0, 0.0, -left[:, 0].max()],
            [-1.0, 0.0, right[:, 0].min()],
            [0.0, 1.0, -top[:, 1].max()],
            [0.0, -1.0, bottom[:, 1].min()],
        ]
    )
    if normals[:, 2].min() <= 0.0:
        raise GeometryError(f"the principal point ({camera.cx:g}, {camera.cy:g}) px is outside the PTZ's picture")
    return normals


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cover:
    """Which poses cover which part of one arc."""

    rig: Rig
    arc: EpipolarArc
    limits: HeadLimits
    planes: Array
    margin_rad: float
    zoom: float
    reach: Reach | None = None

    def plan(self, step_rad: float) -> tuple[_Aims, list[tuple[float, float]]]:
        """Return the chosen poses in the order of the arc, and the gaps, as angles along the arc, that none covers."""
        first, last = self.ends()
        count = min(MAX_CANDIDATES, math.ceil((last - first) / step_rad) + 1)
        candidates = self.aims(np.linspace(first, last, count))
        chosen, gaps = _greedy(candidates, first, last)
        if not gaps:
            number = len(chosen)
            even = self.aims(first + (np.arange(number) + 0.5) / number * (last - first))
            reached = np.concatenate([[first], even.high])
            if (even.low <= reached[:-1] + _EPSILON_RAD).all() and reached[-1] >= last - _EPSILON_RAD:
                return even, gaps
        return candidates.take(chosen), gaps

    def slid(self, single: _Aims, towards: float) -> _Aims:
        """Return the one pose that shows the whole arc, aimed as near to an inverse range as it still does."""
        first, last = self.ends()
        angle = min(max(float(self.arc.angle_at(towards)), first), last)
        tried = self.aims(angle + np.linspace(0.0, 1.0, 2 * CANDIDATES_PER_VIEW + 1) * (0.5 * (first + last) - angle))
        shows_all = (tried.low <= first + _EPSILON_RAD) & (tried.high >= last - _EPSILON_RAD)
        return tried.take([int(np.argmax(shows_all))]) if shows_all.any() else single

    def ends(self) -> tuple[float, float]:
        """Return the angles along the arc where it begins and ends."""
        first, last = self.arc.angle_at([self.arc.s_min, self.arc.s_max]).tolist()
        return first, last

    def interval(self, low: float, high: float) -> tuple[float, float]:
        """Return the inverse ranges between two angles along the arc, cut to the arc."""
        first, last = self.ends()
        s_low = self.arc.s_min if low <= first + _EPSILON_RAD else float(self.arc.inverse_range_at(low))
        s_high = self.arc.s_max if high >= last - _EPSILON_RAD else float(self.arc.inverse_range_at(high))
        return s_low, s_high

    def aims(self, angles: Array) -> _Aims:
        """Return the poses nearest to aiming at angles ``(n,)`` along the arc within the limits; what each covers."""
        head, arc = self.rig.head, self.arc
        pan, tilt = head.aim_all(np.cos(angles)[:, None] * arc.rotated + np.sin(angles)[:, None] * arc.forward)
        turned = wrap_angle(pan - head.pan.offset_rad) + head.pan.offset_rad
        pan_deg = _into(head.pan.vapix_deg(turned), self.limits, 360.0 / head.pan.scale)
        tilt_deg = np.clip(head.tilt.vapix_deg(tilt), *self.limits.tilt_deg)
        allowed = np.ones(len(pan_deg), dtype=bool)
        if self.reach is not None:
            pan_deg, tilt_deg, allowed = self.reach.moved_off(pan_deg, tilt_deg, self.zoom)
        normals = self._planes_in_head(head.pan.angle_rad(pan_deg), head.tilt.angle_rad(tilt_deg))
        along, aside = normals @ arc.rotated, normals @ arc.forward
        share = math.sin(self.margin_rad) / np.maximum(np.hypot(along, aside), 1e-12)
        reach = np.where(share <= 1.0, np.arccos(np.minimum(share, 1.0)), -np.inf)
        middle = angles[:, None] + wrap_angle(np.arctan2(aside, along) - angles[:, None])
        low, high = (middle - reach).max(axis=-1), (middle + reach).min(axis=-1)
        low, high = np.where(allowed, low, np.inf), np.where(allowed, high, -np.inf)
        return _Aims(pan_deg=pan_deg, tilt_deg=tilt_deg, low=low, high=high)

    def _planes_in_head(self, pan: Array, tilt: Array) -> Array:
        """Return the planes' normals ``(n, 4, 3)`` in the head frame: `HeadModel.head_from_camera` for many poses."""
        x, y, z = (self.planes @ rotation_from_rotvec(self.rig.head.camera_rotvec_rad).T).T
        sine, cosine = np.sin(tilt)[:, None], np.cos(tilt)[:, None]
        down, ahead = cosine * y - sine * z, sine * y + cosine * z
        sine, cosine = np.sin(pan)[:, None], np.cos(pan)[:, None]
        return np.stack([cosine * x + sine * ahead, down, cosine * ahead - sine * x], axis=-1)


def _into(pan_deg: Array, limits: HeadLimits, turn_deg: float) -> Array:
    """Return the pan angles inside the limits that are nearest, whole turns counted as equal."""
    if limits.endless_pan:
        return pan_deg
    turns = pan_deg[:, None] + np.array([0.0, -turn_deg, turn_deg])
    inside = np.clip(turns, *limits.pan_deg)
    nearest = np.abs(inside - turns).argmin(axis=-1)
    return np.asarray(inside[np.arange(len(pan_deg)), nearest])


def _greedy(aims: _Aims, first: float, last: float) -> tuple[list[int], list[tuple[float, float]]]:
    """Return the fewest intervals that cover ``[first, last]``, by index, and the gaps that no interval covers."""
    chosen: list[int] = []
    gaps: list[tuple[float, float]] = []
    position = first
    while True:
        usable = (aims.low <= position + _EPSILON_RAD) & (aims.high > position + _EPSILON_RAD)
        if usable.any():
            chosen.append(int(np.argmax(np.where(usable, aims.high, -np.inf))))
            position = float(aims.high[chosen[-1]])
        else:
            later = aims.low[(aims.low > position + _EPSILON_RAD) & (aims.low < aims.high)]
            begins = float(later.min(initial=np.inf))
            gaps.append((position, min(begins, last)))
            position = begins
        if position >= last - _EPSILON_RAD:
            return chosen, gaps
