"""Regions of a scene under one condition: the pictures, the calibration as the matcher is told it, and the truth."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, rotation_from_rotvec
from ptzd.model import Box, HeadReading
from ptzd.sim.scene import Scene
from tests.bench import spoil
from tests.bench.stage import HFOV_DEG, Stage, stage

RANGE_M = (0.8, 100.0)
BAND_DEG = 1.0
TWO_SURFACES_RAD = np.radians(0.3)
"""Directions of the centre half a pixel on differ by so much only across an occluding edge."""
DOUBLE_DEG = (3.0, 30.0)
"""How far along the arc a copy of the region is put."""


@dataclass(frozen=True, kw_only=True)
class Condition:
    """What is changed against the clean pictures."""

    name: str
    hfov_deg: float = 60.0
    fisheye_px: tuple[int, int] = (640, 480)
    noise: float = 0.0
    """One sigma, grey levels, on both pictures."""
    light: Callable[[np.ndarray, np.random.Generator], np.ndarray] | None = None
    """Applied to the views, floats in [0, 255]."""
    occlusion: float = 0.0
    """Share of the region that something hides in the views."""
    extrinsics_deg: float = 0.0
    band_deg: float = BAND_DEG
    absent: bool = False
    """The box shows something that is nowhere in the views."""
    blank: bool = False
    """The box shows nothing but noise."""
    doubled: bool = False
    """The views show the region a second time, elsewhere on the arc."""
    side_px: float | None = None
    """Side of a square box in place of the scene's own."""
    range_m: tuple[float, float] = RANGE_M
    narrow: float = 0.0
    """Search only this share of the true inverse range to either side, as while verifying a lock; 0 = all ranges."""
    aimed_deg: float | None = None
    """One view aimed at the truth with this error instead of the scan of the arc."""
    border: bool = False
    """One view that has the region's centre at its border."""
    every: int = 1
    """Only every so many regions."""
    others: bool = False
    """Whether `harris` and the peers are tried too."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One region under one condition."""

    scene: str
    index: int
    """Of the region in its scene."""
    name: str
    kind: str
    condition: str
    rig: Rig
    """As the matcher is told: wrong where the condition says so."""
    box: Box
    fisheye: np.ndarray
    views: list[tuple[HeadReading, np.ndarray]]
    truths: np.ndarray
    """(n, 3) directions of the surface at the box's centre in the head frame. Two of them when an occluding edge runs
    through the centre pixel, none when what the box shows is nowhere."""
    visible: bool
    """Whether the PTZ camera can see it."""
    inverse_range: tuple[float, float]
    band_deg: float = BAND_DEG
    seed: int = 1


def cases(scene_name: str, condition: Condition, chosen: Callable[[int], bool] = lambda index: True) -> Iterator[Case]:
    """Regions of a scene that the condition applies to, of those that are chosen by their index."""
    s = stage(scene_name)
    for index in range(len(s.scene.regions)):
        case = make_case(s, index, condition) if chosen(index) else None
        if case is not None:
            yield case


def make_case(s: Stage, index: int, condition: Condition) -> Case | None:
    """One region under a condition, or nothing where the condition has no room."""
    region = s.scene.regions[index]
    seed = zlib.crc32(f"{s.scene.name} {region.name} {condition.name}".encode())
    rng = np.random.default_rng(seed)
    true_rig = s.rig(condition.fisheye_px)
    box = _resized(s.box(region, condition.fisheye_px), condition)
    if box is None:
        return None
    ray, _ = true_rig.fisheye.lift(np.array(box.centre))
    truth = s.scene.truth(ray)
    rig = _wrong(true_rig, condition.extrinsics_deg, rng)
    views = []
    for reading in _poses(rig, true_rig, ray, truth.bearing_head, condition, rng):
        picture = _spoiled(
            s.view(reading).astype(np.float64), true_rig, reading, box, 1 / truth.range_m, condition, rng
        )
        if picture is None:
            return None
        views.append((reading, spoil.with_noise(picture, condition.noise, rng)))
    gone = condition.absent or condition.blank
    return Case(
        scene=s.scene.name,
        index=index,
        name=region.name,
        kind=region.kind,
        condition=condition.name,
        rig=rig,
        box=box,
        fisheye=_fisheye(s, index, box, condition, rng),
        views=views,
        truths=np.zeros((0, 3)) if gone else truths(s.scene, true_rig, box),
        visible=s.scene.visible_from_ptz(ray),
        inverse_range=_interval(1.0 / truth.range_m, condition),
        band_deg=condition.band_deg,
        seed=seed % 1000,
    )


def truths(scene: Scene, rig: Rig, box: Box) -> np.ndarray:
    """Directions of what the box's centre shows.

    A box's centre is known to half a pixel at best. Where an occluding edge runs through that half pixel, both surfaces
    are what the centre shows, and a matcher cannot know which is meant: both count as right.
    """
    x, y = box.centre
    ray, _ = rig.fisheye.lift(np.array(box.centre))
    found = [scene.truth(ray).bearing_head]
    if scene.fisheye_depth is None:
        return np.array(found)
    around, _ = rig.fisheye.lift(np.array([[x + i, y + j] for i in (-0.5, 0.0, 0.5) for j in (-0.5, 0.0, 0.5)]))
    for inverse_range in scene.fisheye_depth.inverse_range(around):
        moved = rig.head_from_fisheye_rotation @ ray + inverse_range * rig.head_from_fisheye_translation
        direction = moved / np.linalg.norm(moved)
        if min(angle_between(direction, other) for other in found) > TWO_SURFACES_RAD:
            found.append(direction)
    return np.array(found)


def _resized(box: Box, condition: Condition) -> Box | None:
    """The box with another side about the same centre, if that is wholly in the picture."""
    if condition.side_px is None:
        return box
    x, y = box.centre
    half = condition.side_px / 2
    width, height = condition.fisheye_px
    if min(x, y, width - x, height - y) < half:
        return None
    return Box(x=x - half, y=y - half, w=2 * half, h=2 * half)


def _fisheye(s: Stage, index: int, box: Box, condition: Condition, rng: np.random.Generator) -> np.ndarray:
    picture = s.fisheye(condition.fisheye_px)
    if condition.absent:
        picture = spoil.pasted(picture.astype(np.float64), box, _stranger(s, index, box, condition))
    if condition.blank:
        picture = spoil.blank(picture.astype(np.float64), box)
    if condition.noise == 0.0 and picture.dtype == np.uint8:
        return picture
    return spoil.with_noise(picture.astype(np.float64), condition.noise, rng)


def _stranger(s: Stage, index: int, box: Box, condition: Condition) -> Box:
    """Another textured region of the scene whose place is not on this region's arc, where it could be found."""
    rig = s.rig(condition.fisheye_px)
    ray, _ = rig.fisheye.lift(np.array(box.centre))
    arc = EpipolarArc.of(rig, ray, *_interval(0.0, replace(condition, narrow=0.0)))
    places = arc.bearing(arc.steps(np.radians(0.5)))
    regions = s.scene.regions
    for step in range(len(regions)):
        other = regions[(index + len(regions) // 3 + step) % len(regions)]
        there = s.box(other, condition.fisheye_px)
        away, _ = rig.fisheye.lift(np.array(there.centre))
        near = float(angle_between(places, s.scene.truth(away).bearing_head).min())
        if other.kind not in {"texture_free", "weak_texture"} and near > np.radians(8.0):
            return there
    raise ValueError(f"{s.scene.name}: every textured region is near the arc of {regions[index].name}")


def _spoiled(
    picture: np.ndarray,
    rig: Rig,
    reading: HeadReading,
    box: Box,
    inverse_range: float,
    condition: Condition,
    rng: np.random.Generator,
) -> np.ndarray | None:
    """The view as the condition wants it; nothing when a copy of the region has no room in it."""
    area = spoil.footprint(rig, reading, box, inverse_range)
    if condition.occlusion > 0 and area is not None:
        picture = spoil.occluded(picture, area, condition.occlusion, rng)
    if condition.doubled:
        others = _other_ranges(rig, box, inverse_range)
        copies = (spoil.doubled(picture, rig, reading, box, inverse_range, other) for other in others)
        picture = next((copy for copy in copies if copy is not None), None)
        if picture is None:
            return None
    return picture if condition.light is None else condition.light(picture, rng)


def _other_ranges(rig: Rig, box: Box, inverse_range: float) -> list[float]:
    """Inverse ranges elsewhere on the region's arc, nearest first."""
    ray, _ = rig.fisheye.lift(np.array(box.centre))
    arc = EpipolarArc.of(rig, ray, 1 / RANGE_M[1], 1 / RANGE_M[0])
    own = float(arc.angle_at(inverse_range))
    first, last = arc.angle_at([arc.s_min, arc.s_max])
    away = np.radians(np.arange(DOUBLE_DEG[0], DOUBLE_DEG[1], 0.5))
    angles = [own + sign * step for step in away for sign in (-1, 1)]
    return [float(arc.inverse_range_at(angle)) for angle in angles if first <= angle <= last]


def _interval(inverse_range: float, condition: Condition) -> tuple[float, float]:
    near, far = condition.range_m
    if condition.narrow == 0.0:
        return 1.0 / far, 1.0 / near
    return max(inverse_range * (1.0 - condition.narrow) - 0.01, 0.0), inverse_range * (1.0 + condition.narrow) + 0.01


def _poses(rig: Rig, true_rig: Rig, ray: np.ndarray, truth: np.ndarray, condition: Condition, rng) -> list[HeadReading]:
    """Views along the arc, overlapping by half, from its far end; or the one aimed view."""
    zoom = HFOV_DEG.index(condition.hfov_deg) + 1.0
    if condition.border:
        exact = true_rig.aim(truth, zoom)
        tilt = np.radians(exact.tilt_deg)
        aside = np.degrees(np.arctan(np.tan(np.radians(condition.hfov_deg / 2)) / np.cos(tilt)))
        side = rng.choice([-1.0, 1.0])
        return [HeadReading(pan_deg=exact.pan_deg + side * aside, tilt_deg=exact.tilt_deg, zoom=zoom)]
    if condition.aimed_deg is not None:
        shift = rng.normal(0.0, np.radians(condition.aimed_deg), 3)
        return [true_rig.aim(truth + shift, zoom)]
    arc = EpipolarArc.of(rig, ray, 1.0 / condition.range_m[1], 1.0 / condition.range_m[0])
    camera = rig.camera(HeadReading(pan_deg=0.0, tilt_deg=0.0, zoom=zoom))
    vfov = 2.0 * np.arctan(camera.size_px[1] / 2.0 / camera.fy)
    count = max(1, int(np.ceil(arc.length_rad / (0.5 * vfov))))
    ends = arc.angle_at([arc.s_min, arc.s_max])
    middle = ends[0] + (ends[1] - ends[0]) * (np.arange(count) + 0.5) / count
    return [rig.aim(arc.bearing(float(s)), zoom) for s in arc.inverse_range_at(middle)]


def _wrong(rig: Rig, angle_deg: float, rng: np.random.Generator) -> Rig:
    """The rig turned about a random axis."""
    if angle_deg == 0.0:
        return rig
    axis = rng.normal(size=3)
    turn = rotation_from_rotvec(np.radians(angle_deg) * axis / np.linalg.norm(axis))
    return replace(rig, head_from_fisheye_rotation=turn @ rig.head_from_fisheye_rotation)
