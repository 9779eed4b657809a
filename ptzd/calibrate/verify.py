"""`ptzd calibrate verify`: how well a calibration predicts pictures it has not seen."""

from __future__ import annotations

import math
from pathlib import Path

import aiohttp
import numpy as np

from ptzd.calibrate.head import grey_of
from ptzd.calibrate.parts import Outcome, read_shots
from ptzd.calibrate.rig import board_pairs, scene_pairs
from ptzd.calibration.file import load_rig, read_rig
from ptzd.calibration.pose import plane_pose
from ptzd.calibration.target import Target
from ptzd.errors import CalibrationError, DeviceLost
from ptzd.geometry.rig import Rig
from ptzd.geometry.sphere import angle_between, normalise, rotation_from_rotvec
from ptzd.geometry.types import Array
from ptzd.model import HeadReading

NEAR_RAD, CHANCE_RAD = math.radians(2.0), math.radians(1.0)
"""Matches farther off their circle than the first are chance; so are those between both, which tell how many of the
nearer ones are, since chance lies evenly across a circle."""
WIDEST_RAD = math.radians(25.0)
MIN_MATCHES = 30


def _summary(name: str, errors_rad: Array) -> tuple[str, dict[str, object]]:
    low, high = np.degrees(np.percentile(errors_rad, [50, 95]))
    most, count = math.degrees(float(errors_rad.max())), len(errors_rad)
    line = f"{name}: median {low:.3f}°, 95 % {high:.3f}°, largest {most:.3f}° of {count}"
    return line, {"median_deg": float(low), "p95_deg": float(high), "count": len(errors_rad)}


def with_scene(shots_path: Path, fisheye_path: Path, calibration: Path) -> Outcome:
    """Angles of matched features off their epipolar circles: the error that a search's band has to cover."""
    rig = load_rig(calibration)
    shots = read_shots(shots_path)
    greys = [grey_of(shots_path.parent / shot.image) for shot in shots]
    pairs = scene_pairs(grey_of(fisheye_path), shots, greys, rig.zoom, rig.head)
    rays, valid = rig.fisheye.lift(pairs.fisheye_px)
    carried = rays @ rig.head_from_fisheye_rotation.T
    unit = normalise(rig.head_from_fisheye_translation)
    off = np.abs(np.arcsin(np.clip((pairs.directions * normalise(np.cross(unit, carried))).sum(1), -1.0, 1.0)))
    good = valid & (off < NEAR_RAD) & (angle_between(carried, pairs.directions) < WIDEST_RAD)
    if good.sum() < MIN_MATCHES:
        raise CalibrationError(
            f"verify: {int(good.sum())} matches lie within {math.degrees(NEAR_RAD):g}° of their circles; the "
            "calibration does not belong to these pictures, or they show nothing in common: calibrate again"
        )
    line, document = _without_chance("across the circles", off[good])
    return Outcome(lines=(line,), document={"across": document}, written=())


def _without_chance(name: str, errors_rad: Array) -> tuple[str, dict[str, object]]:
    """Percentiles of the true matches among some that are chance."""
    ordered = np.sort(errors_rad)
    density = float((ordered > CHANCE_RAD).sum()) / (NEAR_RAD - CHANCE_RAD)
    true = np.maximum.accumulate(np.arange(1, len(ordered) + 1) - density * ordered)
    total = max(len(ordered) - density * NEAR_RAD, 1.0)
    middle, most = (math.degrees(ordered[int(np.searchsorted(true, share * total))]) for share in (0.5, 0.95))
    chance = 1.0 - total / len(ordered)
    line = f"{name}: median {middle:.3f}°, 95 % {most:.3f}° of {total:.0f} matches, another {chance:.0%} are chance"
    return line, {"median_deg": middle, "p95_deg": most, "count": round(total), "chance": chance}


def with_boards(shots_path: Path, target: Target, calibration: Path) -> Outcome:
    """Angles between where the fisheye's board is predicted for the head and where the PTZ sees it: the whole error."""
    rig = load_rig(calibration)
    pairs = board_pairs(shots_path, target, rig.fisheye, rig.zoom, rig.head)
    errors = []
    for pair in pairs:
        rays, valid = rig.fisheye.lift(pair.fisheye.view.pixels)
        pose = plane_pose(pair.fisheye.view.points_m[valid], rays[valid])
        options = []
        for view in pair.ptz.view.orders():
            points = view.points_m @ rotation_from_rotvec(pose[:3]).T + pose[3:]
            scale = 1.0 if rig.metric else np.inf
            predicted = points @ rig.head_from_fisheye_rotation.T + rig.head_from_fisheye_translation / scale
            seen, _ = pair.ptz.camera.lift(view.pixels)
            options.append(angle_between(predicted, seen @ pair.ptz.head_from_camera.T))
        errors.append(min(options, key=lambda angles: float(np.median(angles))))
    if not errors:
        raise CalibrationError("verify: no board is seen by both cameras; hold it where both see it whole")
    # a board's distance is in metres, which says nothing in baselines: its parallax stays in the error
    name = "boards" if rig.metric else "boards, as if infinitely far (the rig has no scale)"
    line, document = _summary(name, np.concatenate(errors))
    return Outcome(lines=(line,), document={"boards": document}, written=())


async def with_truth(url: str, calibration: Path, step_px: float = 24.0) -> Outcome:
    """Pointing error against a simulated rig's side channel.

    Over a grid of the fisheye's picture, wherever the surface that is seen there is also seen from the PTZ: the angle
    between where the rig points at the surface's true range (in true baselines when the rig is not metric) and where
    the head must point.
    """
    rig = load_rig(calibration)
    width, height = rig.fisheye.size_px
    told, across = [], []
    try:
        async with aiohttp.ClientSession() as session:
            unit_m = 1.0 if rig.metric else await _baseline_m(session, url)
            for x in np.arange(step_px, width - step_px, step_px).tolist():
                for y in np.arange(step_px, height - step_px, step_px).tolist():
                    if not bool(rig.fisheye.lift(np.array([x, y]))[1]):
                        continue
                    async with session.get(f"{url}/truth/direction", params={"x": str(x), "y": str(y)}) as answer:
                        truth = await answer.json()
                        if answer.status == 200 and truth["visible"]:
                            range_ = float(truth["range_m"]) / unit_m
                            told.append(pointing_error_rad(rig, (x, y), truth["vapix"], range_))
                            across.append(across_rad(rig, (x, y), truth["vapix"]))
    except aiohttp.ClientError as error:
        raise DeviceLost(f"{url}: {error}; start the simulator with `ptzd sim`") from None
    if not across:
        raise CalibrationError(f"{url}: knows no direction; is it the side channel of `ptzd sim`?")
    line, document = _summary("pointing error across the arc", np.array(across))
    lines, result = [line], {"across": document}
    line, result["pointing"] = _summary("pointing error at the true range", np.array(told))
    lines.append(line)
    return Outcome(lines=tuple(lines), document={"truth": result}, written=())


async def _baseline_m(session: aiohttp.ClientSession, url: str) -> float:
    """The true distance of the two viewpoints, m."""
    async with session.get(f"{url}/truth/calibration") as answer:
        truth = read_rig(await answer.text(), url)
    return float(np.linalg.norm(truth.head_from_fisheye_translation))


def _wanted(rig: Rig, reading: dict[str, float]) -> Array:
    """Where the optical axis points, in this rig's head frame, when the camera is told what it should be told."""
    told = HeadReading(pan_deg=reading["pan_deg"], tilt_deg=reading["tilt_deg"], zoom=rig.zoom.zoom_range[0])
    return np.asarray(rig.head_from_camera(told)[:, 2])


def pointing_error_rad(rig: Rig, pixel: tuple[float, float], truth: dict[str, float], range_m: float) -> float:
    """Angle between where the rig points for a fisheye pixel at its true range and where it should, rad."""
    ray, _ = rig.fisheye.lift(np.array(pixel))
    predicted = rig.head_from_fisheye_rotation @ ray + rig.head_from_fisheye_translation / range_m
    return float(angle_between(predicted, _wanted(rig, truth)))


def across_rad(rig: Rig, pixel: tuple[float, float], truth: dict[str, float]) -> float:
    """Angle between the true direction and the epipolar circle: what a search along the arc cannot make good, rad."""
    ray, _ = rig.fisheye.lift(np.array(pixel))
    normal = normalise(np.cross(rig.head_from_fisheye_translation, rig.head_from_fisheye_rotation @ ray))
    return abs(math.asin(float(np.clip(normal @ _wanted(rig, truth), -1.0, 1.0))))
