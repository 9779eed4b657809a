"""What a learned map of ranges is worth: first looks, seconds and wrong answers with 0, 10, 50 and 200 locks.

    python -m tests.bench.ranges [--scenes room yard warehouse] [--tests 60] [--write]

Every scene is taught by requests on random boxes, served by the real core and matcher; what it is tried on are other
boxes, held out, each with every map, from the same pose of the head. Conditions:

``wide``      the PTZ as it is: its widest view (62°) mostly shows the whole arc at once
``narrow``    a scan with 16° views, as with a long lens: the arc takes several
``copies``    wide, and every picture shows the region a second time elsewhere on its arc
``narrow copies``  both
``absent``    wide, and the box shows what is nowhere on its arc
``lying map`` wide, and every range of the map is twice what it is
"""

from __future__ import annotations

import argparse
import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from ptzd.config import Config, FilesSource, Ptz, Search
from ptzd.control.planning.ranges import RangeLock, RangeMap
from ptzd.geometry.arc import EpipolarArc
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.geometry.types import in_picture
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import Box, HeadReading, Outcome
from tests.bench import report, spoil
from tests.bench.scripted import Request
from tests.bench.stage import Stage, stage

SCENES = ("room", "yard", "warehouse")
LOCKS = (0, 10, 50, 200)
CONDITIONS = ("wide", "narrow", "copies", "narrow copies", "absent", "lying map")
RANGE_M = (0.8, 100.0)
NARROW_DEG = 16.0
NOISE = 3.0
"""One sigma of both cameras, grey levels."""
LEAST_CONTRAST = 6.0
WRONG_RAD = np.radians(3.0)
COPY_DEG = (9.0, 20.0)
"""How far along the arc a copy stands."""
VIEW_PX = (640, 480)
HFOV_DEG = ((1, 62.3), (2500, 40.0), (5000, 20.0), (7500, 8.0), (9999, 2.2))
WITH_LOCKS = (Outcome.LOCKED, Outcome.RELEASED)


@dataclass(frozen=True, kw_only=True)
class Trial:
    """What came of one request."""

    first_look: bool
    """Whether the first picture showed the target."""
    looks: int
    locked_s: float | None
    wrong: bool
    """Locked, and more than 3° off or on what is not there."""


class Site:
    """One scene before its rig, with boxes to teach and to try."""

    def __init__(self, name: str, seed: int = 7) -> None:
        self.name = name
        self.stage: Stage = stage(name)
        base = self.stage.rig(self.stage.scene.camera.size_px)
        focals = [(zoom, 0.5 * VIEW_PX[0] / np.tan(np.radians(hfov) / 2)) for zoom, hfov in HFOV_DEG]
        entries = [ZoomEntry(zoom=z, fx=f, fy=f, cx=319.5, cy=239.5) for z, f in focals]
        self.rig: Rig = replace(base, zoom=ZoomTable(size_px=VIEW_PX, entries=tuple(entries)))
        self.rng = np.random.default_rng(seed)
        self.clean = self.stage.fisheye(self.stage.scene.camera.size_px)
        self.fisheye = spoil.with_noise(self.clean.astype(np.float64), NOISE, self.rng)

    def box(self) -> Box:
        """A box with texture whose centre the PTZ camera sees too."""
        width, height = self.rig.fisheye.size_px
        while True:
            side = self.rng.uniform(24, 40)
            x, y = self.rng.uniform((0, 0), (width - side, height - side))
            box = Box(x=float(x), y=float(y), w=float(side), h=float(side))
            rays, valid = self.rig.fisheye.lift(np.array([box.centre, *box.corners]))
            patch = self.clean[round(y) : round(y + side), round(x) : round(x + side)]
            if not valid.all() or patch.std() < LEAST_CONTRAST or not self.stage.scene.visible_from_ptz(rays[0]):
                continue
            if RANGE_M[0] < self.stage.scene.truth(rays[0]).range_m < RANGE_M[1]:
                return box

    def ray(self, box: Box) -> np.ndarray:
        return self.rig.fisheye.lift(np.array(box.centre))[0]

    def view(self, reading: HeadReading) -> np.ndarray:
        """What the PTZ camera sees."""
        height, width = VIEW_PX[1], VIEW_PX[0]
        pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
        return self._noisy(self._drawn(self.rig.lift_from_view(pixels, reading), reading))

    def with_copy(self, box: Box, there: float, reading: HeadReading) -> np.ndarray:
        """The same with two of the region, one in its place and one as it would look at another inverse range.

        Both are drawn from what the fisheye sees, so that neither is the better one.
        """
        picture = self.view(reading)
        here = 1.0 / self.stage.scene.truth(self.ray(box)).range_m
        for inverse_range in (here, there):
            self._paste(picture, box, inverse_range, reading)
        return picture

    def _paste(self, picture: np.ndarray, box: Box, inverse_range: float, reading: HeadReading) -> None:
        area = spoil.footprint(self.rig, reading, box, inverse_range)
        if area is None:
            return
        left, top = max(round(area[0]), 0), max(round(area[1]), 0)
        right, bottom = min(round(area[2]), VIEW_PX[0]), min(round(area[3]), VIEW_PX[1])
        if right - left < 2 or bottom - top < 2:
            return
        pixels = np.stack(np.meshgrid(np.arange(left, right), np.arange(top, bottom)), axis=-1)
        seen, shift = self.rig.lift_from_view(pixels, reading), self.rig.head_from_fisheye_translation
        along = seen @ (inverse_range * shift)
        reach = along + np.sqrt(np.maximum(along**2 + 1.0 - inverse_range**2 * (shift @ shift), 0.0))
        rays = (seen * reach[..., None] - inverse_range * shift) @ self.rig.head_from_fisheye_rotation
        colour = self.stage.scene.sample_fisheye(rays, np.ones(rays.shape[:2], bool))
        picture[top:bottom, left:right] = self._noisy(cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY))

    def other_place(self, box: Box) -> float | None:
        """Inverse range of a place elsewhere on the box's arc; None when the arc is too short."""
        arc = EpipolarArc.of(self.rig, self.ray(box), 1.0 / RANGE_M[1], 1.0 / RANGE_M[0])
        own = float(arc.angle_at(1.0 / self.stage.scene.truth(self.ray(box)).range_m))
        first, last = arc.angle_at([arc.s_min, arc.s_max]).tolist()
        away = np.radians(self.rng.uniform(*COPY_DEG, 20)) * self.rng.choice([-1.0, 1.0], 20)
        return next((float(arc.inverse_range_at(own + a)) for a in away if first < own + a < last), None)

    def _drawn(self, rays: np.ndarray, reading: HeadReading) -> np.ndarray:
        colour = self.stage.scene.sample_ptz(rays, 1.0 / self.rig.camera(reading).fx)
        return cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)

    def _noisy(self, picture: np.ndarray) -> np.ndarray:
        noise = np.random.default_rng(picture.shape[0] + int(picture.mean() * 1000))
        return spoil.with_noise(picture.astype(np.float64), NOISE, noise)


def settings(hfov_deg: float | None = None) -> Config:
    return Config(
        rig="bench",
        calibration="rig.yaml",
        fisheye=FilesSource(path="pictures"),
        ptz=Ptz(url="http://127.0.0.1:1", user="bench"),
        search=Search(range_m=RANGE_M, scan_hfov_deg=hfov_deg),
    )


def teach(site: Site, count: int) -> list[RangeLock]:
    """Locks on random boxes, as they are served one after the other without a map."""
    taught: list[RangeLock] = []
    while len(taught) < count:
        request = Request(
            rig=site.rig, config=settings(), fisheye=site.fisheye, view=site.view, box=site.box(), ranges=RangeMap()
        ).run()
        taught += request.machine.ranges.locks
    return taught[:count]


def lying(locks: Sequence[RangeLock]) -> list[RangeLock]:
    """The same map with everything twice as far away."""
    return [replace(lock, inverse_range=0.5 * lock.inverse_range) for lock in locks]


def trial(site: Site, box: Box, condition: str, locks: Sequence[RangeLock], other: float | None, away: Box) -> Trial:
    """One request under a condition with a map of these locks."""
    fisheye, view = site.fisheye, site.view
    if "copies" in condition:

        def view(reading: HeadReading) -> np.ndarray:
            return site.with_copy(box, other or 0.0, reading)

    if condition == "absent":
        pasted = spoil.pasted(site.clean.astype(np.float64), box, away)
        fisheye = spoil.with_noise(pasted, NOISE, np.random.default_rng(3))
    known = RangeMap(locks=lying(locks) if condition == "lying map" else list(locks))
    config = settings(NARROW_DEG if "narrow" in condition else None)
    request = Request(rig=site.rig, config=config, fisheye=fisheye, view=view, box=box, ranges=known).run()
    truth = site.stage.scene.truth(site.ray(box)).bearing_head
    result = request.result
    found = result is not None and result.outcome in WITH_LOCKS
    off = 0.0
    if found and result.pan_deg is not None and result.tilt_deg is not None:
        off = float(angle_between(bearing(np.radians(result.pan_deg), np.radians(result.tilt_deg)), truth))
    pixel, valid = site.rig.project_to_view(truth, request.taken[0])
    return Trial(
        first_look=bool(valid) and bool(in_picture(site.rig.camera(request.taken[0]), pixel)),
        looks=len(request.taken),
        locked_s=request.locked_s if found else None,
        wrong=found and (condition == "absent" or bool(off > WRONG_RAD)),
    )


def rows(names: Sequence[str], tests: int, conditions: Sequence[str], log: bool) -> list[dict[str, object]]:
    """One row per scene, condition and number of locks."""
    found: list[dict[str, object]] = []
    for name in names:
        site = Site(name)
        locks = teach(site, max(LOCKS))
        boxes = [site.box() for _ in range(tests)]
        others = [site.other_place(box) for box in boxes]
        away = [boxes[(k + tests // 2) % tests] for k in range(tests)]
        for condition in conditions:
            asked = [k for k in range(tests) if "copies" not in condition or others[k] is not None]
            trials = {
                count: [trial(site, boxes[k], condition, locks[:count], others[k], away[k]) for k in asked]
                for count in LOCKS
            }
            for count in LOCKS:
                found.append(row(name, condition, count, trials[0], trials[count]))
                if log:
                    print(json.dumps(found[-1]), flush=True)
    return found


def row(
    scene: str, condition: str, count: int, without: Sequence[Trial], with_map: Sequence[Trial]
) -> dict[str, object]:
    """The figures of one map, paired with no map."""
    saved = [
        one.locked_s - other.locked_s
        for one, other in zip(without, with_map, strict=True)
        if one.locked_s is not None and other.locked_s is not None and not (one.wrong or other.wrong)
    ]
    seconds = [one.locked_s for one in with_map if one.locked_s is not None]
    return {
        "scene": scene,
        "condition": condition,
        "locks": count,
        "trials": len(with_map),
        "first_look": sum(one.first_look for one in with_map),
        "locked": sum(one.locked_s is not None and not one.wrong for one in with_map),
        "wrong": sum(one.wrong for one in with_map),
        "seconds": round(statistics.median(seconds), 2) if seconds else None,
        "saved_median_s": round(statistics.median(saved), 2) if saved else None,
        "saved_mean_s": round(statistics.mean(saved), 2) if saved else None,
        "looks": round(statistics.mean(one.looks for one in with_map), 2),
    }


def table(found: Sequence[dict[str, object]]) -> str:
    """Markdown."""
    head = [
        "scene",
        "condition",
        "locks",
        "first look shows it",
        "locked",
        "wrong",
        "s to the lock",
        "s saved",
        "looks",
    ]
    return report.markdown([head, *map(_line, found)])


def _line(each: dict[str, object]) -> list[str]:
    trials = each["trials"]
    return [
        str(each["scene"]),
        str(each["condition"]),
        str(each["locks"]),
        f"{each['first_look']} of {trials}",
        f"{each['locked']} of {trials}",
        f"{each['wrong']} of {trials}",
        _number(each["seconds"]),
        f"{_number(each['saved_median_s'])} ({_number(each['saved_mean_s'])})",
        _number(each["looks"]),
    ]


def _number(value: object) -> str:
    return "–" if value is None else f"{value:.2f}"


def summary(found: Sequence[dict[str, object]]) -> str:
    """All scenes together, for README."""
    lines = [["condition", *(f"{count} locks" for count in LOCKS)]]
    for condition in CONDITIONS:
        cells = []
        for count in LOCKS:
            rows_ = [each for each in found if each["condition"] == condition and each["locks"] == count]
            cells.append(_cell(rows_))
        lines.append([condition, *cells])
    return report.markdown(lines)


def _cell(rows_: Sequence[dict[str, object]]) -> str:
    trials, first, locked, wrong = (sum(int(r[k]) for r in rows_) for k in ("trials", "first_look", "locked", "wrong"))
    weights = [(float(r["saved_mean_s"]), int(r["locked"])) for r in rows_ if r["saved_mean_s"] is not None]
    count = sum(n for _, n in weights)
    saved = f", {sum(s * n for s, n in weights) / count:.2f} s saved" if count and rows_[0]["locks"] else ""
    return f"first look {first}, locked {locked}, wrong {wrong} of {trials}{saved}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=list(SCENES))
    parser.add_argument("--conditions", nargs="+", default=list(CONDITIONS))
    parser.add_argument("--tests", type=int, default=16)
    parser.add_argument("--rows", type=Path, nargs="+", help="rows printed by earlier runs, in place of a run")
    parser.add_argument("--write", action="store_true", help="into docs/accuracy.md and README")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    if args.rows:
        printed = [line for path in args.rows for line in path.read_text().splitlines() if line.startswith("{")]
        found = [json.loads(line) for line in printed]
    else:
        found = rows(args.scenes, args.tests, args.conditions, log=True)
    print(table(found))
    print(summary(found))
    if args.write:
        report.replace(report.PAGE, "ranges", table(found))
        report.replace(report.README, "ranges", summary(found))


if __name__ == "__main__":
    main()
