"""Where the head may rest and on which way it may go there: the limits less the zones.

A *no-go* zone is closed to the optical axis, at rest and on the way, whatever the zoom. A *privacy* zone may be passed.
At rest the axis is never in it, and as long as the picture shows any of it, by the circle around the picture, the
picture is the widest that is calibrated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from ptzd.control.planning.grid import Cell, Grid, axes_at, cell_axes, everywhere, within
from ptzd.control.planning.marks import taken_by
from ptzd.control.planning.span import Span
from ptzd.geometry.rig import Rig
from ptzd.geometry.types import Array, Mask
from ptzd.geometry.zones import Zone, along, covers
from ptzd.model import HeadLimits, HeadReading, HeadSpeed, ZoneKind

OFF_CENTRE_SHARE = 0.7
"""A target that the limits keep off the centre is held if it is within 70 % of the way to the picture's edge."""
SPOT_RAD = math.radians(1.0)
"""How finely a privacy zone is known where it is only asked whether a picture shows it."""
BISECTIONS = 20
"""Of a time: a millionth of the horizon."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reach:
    """The set points and ways a head may take; made by `reach_of`."""

    limits: HeadLimits
    rig: Rig
    no_go: tuple[Zone, ...] = ()
    privacy: tuple[Zone, ...] = ()
    _closed: Grid | None = field(init=False, repr=False)
    """Taken by no-go zones; None without any."""
    _shut: Grid | None = field(init=False, repr=False)
    """Taken by zones whose inside is no set point: no-go ones, then privacy."""
    _border: tuple[Cell, ...] = field(init=False, repr=False)
    _border_axes: Array = field(init=False, repr=False)
    """Where the axis points in the cells just outside, ``(n, 3)``."""
    _seen: Array = field(init=False, repr=False)
    """Directions ``(m, 3)`` all over the outlines of privacy zones."""

    def __post_init__(self) -> None:
        head, both = self.rig.head, (*self.no_go, *self.privacy)
        extent = everywhere(self.limits)
        axes = cell_axes(head, extent) if both else np.zeros((0, 0, 3))
        owner = np.full(axes.shape[:2], -1, dtype=np.int16)
        closed = owner.copy()
        for number, zone in enumerate(both):
            taken = taken_by(zone.head_outlines, head, extent, axes)
            owner[taken & (owner < 0)] = number
            if zone.kind is ZoneKind.NO_GO:
                closed[taken] = number
        inside = within(self.limits, extent)
        shut = Grid(limits=extent, within=inside, owner=owner) if both else None
        border = () if shut is None else tuple(shut.border())
        object.__setattr__(self, "_shut", shut)
        object.__setattr__(self, "_closed", Grid(limits=extent, within=inside, owner=closed) if self.no_go else None)
        object.__setattr__(self, "_border", border)
        object.__setattr__(self, "_border_axes", np.array([axes[cell] for cell in border]).reshape(-1, 3))
        object.__setattr__(self, "_seen", _spots(self.privacy))

    @property
    def has_ways(self) -> bool:
        """Whether there is anything to be led around."""
        return self._closed is not None

    def contains(self, reading: HeadReading) -> bool:
        """Whether the head may rest there."""
        return self.limits.contains(reading) and self.objection(reading) is None

    def objection(self, reading: HeadReading) -> str | None:
        """Why a zone forbids to rest there, e.g. ``in the no_go zone sun``; None when none does."""
        if self._shut is None:
            return None
        number = int(self._shut.owner_at(np.array(reading.pan_deg), np.array(reading.tilt_deg)))
        if number >= 0:
            zone = (*self.no_go, *self.privacy)[number]
            return f"in the {zone.kind} zone {zone.name}"
        pan, tilt = np.array([reading.pan_deg]), np.array([reading.tilt_deg])
        if reading.zoom > self.widest and self._shows_private(axes_at(self.rig.head, pan, tilt), reading.zoom)[0]:
            return f"zoomed in beside a privacy zone ({', '.join(zone.name for zone in self.privacy)})"
        return None

    def private_in(self, reading: HeadReading) -> str:
        """The privacy zones, when a picture at this pose shows any: ``privacy zones window``; else empty."""
        if not self.privacy:
            return ""
        axis = axes_at(self.rig.head, np.array([reading.pan_deg]), np.array([reading.tilt_deg]))
        low, high = self.rig.zoom.zoom_range
        inside = any(covers(zone.head_outlines, axis)[0] for zone in self.privacy)
        if not inside and not self._shows_private(axis, min(max(reading.zoom, low), high))[0]:
            return ""
        return f"privacy zones {', '.join(zone.name for zone in self.privacy)}"

    def holds(self, direction: Array) -> Zone | None:
        """The zone that must not be pointed at in which a direction ``(3,)`` of the head frame lies."""
        zones = (*self.no_go, *self.privacy)
        return next((zone for zone in zones if covers(zone.head_outlines, direction[None])[0]), None)

    def nearest(self, target: HeadReading) -> HeadReading:
        """The pose where the head may rest that is nearest: the limits first, then beside the zone, then less zoom."""
        target = nearest(target, self.limits)
        pan, tilt, _ = self.moved_off(np.array([target.pan_deg]), np.array([target.tilt_deg]), self.widest)
        off = replace(target, pan_deg=float(pan[0]), tilt_deg=float(tilt[0]))
        return off if self.objection(off) is None else replace(off, zoom=self.widest)

    def moved_off(self, pan_deg: Array, tilt_deg: Array, zoom: float) -> tuple[Array, Array, Mask]:
        """Take poses ``(n,)`` out of the zones by the shortest way; the mask says where the head may rest at a zoom."""
        allowed = np.ones(len(pan_deg), dtype=bool)
        if self._shut is None:
            return pan_deg, tilt_deg, allowed
        inside = self._shut.owner_at(pan_deg, tilt_deg) >= 0
        if inside.any() and self._border:
            axes = axes_at(self.rig.head, pan_deg[inside], tilt_deg[inside])
            chosen = (axes @ self._border_axes.T).argmax(axis=1)
            poses = [self._shut.pose(self._border[index], zoom) for index in chosen]
            pan_deg, tilt_deg = pan_deg.copy(), tilt_deg.copy()
            pan_deg[inside] = [pose.pan_deg for pose in poses]
            tilt_deg[inside] = [pose.tilt_deg for pose in poses]
        elif inside.any():
            allowed &= ~inside
        if zoom > self.widest:
            allowed &= ~self._shows_private(axes_at(self.rig.head, pan_deg, tilt_deg), zoom)
        return pan_deg, tilt_deg, allowed

    def way(self, here: Span, end: HeadReading, zoom: float) -> tuple[HeadReading, ...] | None:
        """Return the set points to go by, the last of them ``end``; None when no way leads there.

        Each leg is free however its axes run, by the whole rectangle between its ends; the first one excepted when the
        head itself stands in a zone (zones and calibrations change, others move it): then it leaves by the shortest
        way. All legs but the last keep ``zoom``, or are at the widest where privacy zones are about; corners in these
        are a last resort.

        Parameters
        ----------
        here : Span
            Where the head rests: a point.
        end : HeadReading
            Where it may rest, as by `contains`.
        zoom : float
            Now.
        """
        if self.leg_free(here, end):
            return (end,)
        grid = self._closed
        if grid is None:
            raise AssertionError("a leg that is not free without zones")
        zoom = self.widest if self.privacy else zoom
        start = HeadReading(pan_deg=here.pan_deg[0], tilt_deg=here.tilt_deg[0], zoom=zoom)
        pan, tilt, _ = self.moved_off(np.array([start.pan_deg]), np.array([start.tilt_deg]), self.widest)
        leave: tuple[HeadReading, ...] = ()
        if grid.owner_at(np.array(start.pan_deg), np.array(start.tilt_deg)) >= 0:
            start = replace(start, pan_deg=float(pan[0]), tilt_deg=float(tilt[0]))
            leave = (start,)
        elif not self.limits.contains(replace(start, zoom=self.limits.zoom[0])):
            start = nearest(start, self.limits)
            leave = (start,)
            if not self.leg_free(here, start):
                return None
        cells = (self._shut.walk(start, end) if self._shut is not None else None) or grid.walk(start, end)
        if cells is None:
            return None
        return leave + self._tight([start, *(grid.pose(cell, zoom) for cell in cells[1:-1]), end])

    def leg_free(self, here: Span, end: HeadReading) -> bool:
        """Whether one absolute move from somewhere in ``here`` stays out of every no-go zone, however its axes run."""
        return self._closed is None or self._closed.free(here.to(end, endless_pan=self.limits.endless_pan))

    def free_s(self, here: Span, speed: HeadSpeed, horizon_s: float) -> float:
        """How long the head may turn at a speed before it could be in a no-go zone.

        Parameters
        ----------
        here : Span
            Where it may be by now: ``Span.at(reading)``, larger by what it moved since.
        speed : HeadSpeed
            In the camera's own sense.
        horizon_s : float
            As far as it is asked for; what the head needs to brake is part of it.

        Returns
        -------
        float
            Seconds, 0 to ``horizon_s``. Any slower speed of the same sense is free for as long.
        """
        grid = self._closed
        if grid is None or grid.free(here.drifted(speed, horizon_s)):
            return horizon_s
        low, high = 0.0, horizon_s
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if grid.free(here.drifted(speed, middle)) else (low, middle)
        return low

    def slowed(self, here: Span, speed: HeadSpeed, foresight_s: float) -> tuple[HeadSpeed, str]:
        """Return a speed that eats up the way to a no-go zone in no less than a foresight, and which zones slowed it.

        A head that stands in a zone, or may, is not steered at all: an absolute move leads out of it.
        """
        share = self.free_s(here, speed, foresight_s) / foresight_s
        if share >= 1.0:
            return speed, ""
        slower = replace(speed, pan_deg_s=speed.pan_deg_s * share, tilt_deg_s=speed.tilt_deg_s * share)
        ahead = [] if self._closed is None else self._closed.owners(here.drifted(speed, foresight_s))
        return slower, f"zones {', '.join(self.no_go[number].name for number in ahead)}"

    @property
    def widest(self) -> float:
        """The zoom of the widest pictures, VAPIX units."""
        return max(self.rig.zoom.zoom_range[0], self.limits.zoom[0])

    def _tight(self, stops: list[HeadReading]) -> tuple[HeadReading, ...]:
        """Draw a way over cells tight: from each corner on to the farthest stop whose leg is free."""
        corners, at = [], 0
        while at < len(stops) - 1:
            here = Span.at(stops[at])
            at = next(to for to in range(len(stops) - 1, at, -1) if self.leg_free(here, stops[to]))
            corners.append(stops[at])
        return tuple(corners)

    def _shows_private(self, axes: Array, zoom: float) -> Mask:
        """Whether pictures around these axes ``(n, 3)`` show any privacy zone; inside of it not asked for."""
        if not len(self._seen):
            return np.zeros(len(axes), dtype=bool)
        camera = self.rig.zoom.camera_at(zoom)
        width, height = camera.size_px
        half_diagonal = math.atan(math.hypot(width / camera.fx, height / camera.fy) / 2)
        return np.asarray((axes @ self._seen.T).max(axis=1) >= math.cos(half_diagonal + SPOT_RAD))


def _spots(zones: tuple[Zone, ...]) -> Array:
    """Directions ``(n, 3)`` all over the outlines of zones: none of theirs is further than `SPOT_RAD` from one."""
    if not zones:
        return np.zeros((0, 3))
    points = np.concatenate([along(zone.head_outlines, SPOT_RAD / 2) for zone in zones])
    _, first = np.unique(np.round(points / (SPOT_RAD / 2)), axis=0, return_index=True)
    return np.asarray(points[first])


@lru_cache(maxsize=4)
def reach_of(limits: HeadLimits, rig: Rig, zones: tuple[Zone, ...]) -> Reach:
    """Return the reach of a head within its limits and outside the zones."""
    no_go, privacy = (tuple(z for z in zones if z.kind is kind) for kind in (ZoneKind.NO_GO, ZoneKind.PRIVACY))
    return Reach(limits=limits, rig=rig, no_go=no_go, privacy=privacy)


def nearest(target: HeadReading, limits: HeadLimits) -> HeadReading:
    """The pose within the limits that is nearest in pan and tilt; the zoom stays."""
    pan = target.pan_deg if limits.endless_pan else min(max(target.pan_deg, limits.pan_deg[0]), limits.pan_deg[1])
    tilt = min(max(target.tilt_deg, limits.tilt_deg[0]), limits.tilt_deg[1])
    return HeadReading(pan_deg=pan, tilt_deg=tilt, zoom=target.zoom)


def well_inside(rig: Rig, direction: Array, reading: HeadReading) -> bool:
    """Whether a direction ``(3,)`` in the head frame is seen well away from the picture's edge at this pose."""
    pixel, valid = rig.project_to_view(direction, reading)
    half = np.array(rig.zoom.size_px) / 2
    return bool(valid) and bool((np.abs(pixel - half) < OFF_CENTRE_SHARE * half).all())
