"""`ptzd calibrate rig`: from pictures of both cameras to rig.yaml, with boards or without."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ptzd import __version__
from ptzd.calibrate.head import features_of, grey_of, seen_by_ptz
from ptzd.calibrate.parts import (
    EDGE_RAD,
    Outcome,
    Say,
    Shot,
    covariance_part,
    fisheye_of,
    head_of,
    part_path,
    read_part,
    read_shots,
    verdict_lines,
    write_part,
    zoom_of,
)
from ptzd.calibration.boards import BoardPair, RigFit, Seen, calibrate_boards
from ptzd.calibration.detect import Grey
from ptzd.calibration.features import find_features, match
from ptzd.calibration.file import dump_rig, fisheye_section, read_rig
from ptzd.calibration.halves import REACH_PERCENT, PointingError, pointing_error
from ptzd.calibration.lens import KANNALA_BRANDT, PERSPECTIVE, UNIFIED, Lens
from ptzd.calibration.pictures import read_boards
from ptzd.calibration.planes import refine_by_planes
from ptzd.calibration.scene_rig import ScenePairs, SceneRigFit, calibrate_scene_rig
from ptzd.calibration.target import Target
from ptzd.errors import CalibrationError
from ptzd.geometry.head import HeadModel
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.rig import Rig, Uncertainty
from ptzd.geometry.sphere import angle_between
from ptzd.geometry.types import Array, CameraModel
from ptzd.geometry.unified import UnifiedCamera
from ptzd.geometry.zoom import ZoomTable

SHARES = (0.5, 0.3)
"""Sizes at which PTZ pictures are matched to a fisheye: its pixels are two to four times as coarse."""
RANGES_M = (1.0, 3.0, 10.0, math.inf)
TURN_NAMES = ("turn_x", "turn_y", "turn_z")
"""Of R, from the left, rad."""
LEAST_ROTATION_RAD = math.radians(0.05)
"""A rig is never claimed to be known better."""
LEAST_HEAD_RAD = math.radians(0.01)


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneResult:
    """A rig from a scene, with what the report draws."""

    rig: Rig
    fit: SceneRigFit
    expected: PointingError
    outcome: Outcome


def lens_of(camera: CameraModel) -> tuple[Lens, Array]:
    """The parameter vector of a camera."""
    if isinstance(camera, UnifiedCamera):
        return UNIFIED, np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, *camera.distortion])
    lens = KANNALA_BRANDT if isinstance(camera, KannalaBrandtCamera) else PERSPECTIVE
    assert isinstance(camera, KannalaBrandtCamera | PerspectiveCamera)
    return lens, np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])


def board_pairs(
    shots_path: Path, target: Target, fisheye: CameraModel, table: ZoomTable, head: HeadModel
) -> list[BoardPair]:
    """Boards that both cameras found."""
    shots = [shot for shot in read_shots(shots_path) if shot.fisheye is not None]
    if not shots:
        raise CalibrationError(f'{shots_path}: no entry names a fisheye picture; give it as "fisheye"')
    folder = shots_path.parent
    ptz = read_boards([folder / shot.image for shot in shots], target)
    fish = read_boards(sorted({folder / str(shot.fisheye) for shot in shots}), target)
    if fish.size_px != fisheye.size_px:
        sizes = f"fisheye pictures of {fish.size_px} px, calibrated at {fisheye.size_px} px"
        raise CalibrationError(f"{shots_path}: {sizes}; take them at one size")
    lens, values = lens_of(fisheye)
    views = {view.name: view for view in fish.views}
    seen = seen_by_ptz(table, ptz, {Path(shot.image).name: shot for shot in shots}, head)
    pairs = []
    for shot in shots:
        one, other = views.get(Path(str(shot.fisheye)).name), seen.get(Path(shot.image).name)
        if one is not None and other is not None:
            mine = Seen(lens=lens, values=values, camera=fisheye, view=one, head_from_camera=np.eye(3))
            pairs.append(BoardPair(name=Path(shot.image).name, fisheye=mine, ptz=other))
    return pairs


def rig_from_boards(shots_path: Path, target: Target, work: Path, out: Path, say: Say) -> tuple[Outcome, Rig, RigFit]:
    """rig.yaml in metres from boards that both cameras see."""
    fisheye, table, (head, head_quality) = fisheye_of(work), zoom_of(work), head_of(work)
    pairs = board_pairs(shots_path, target, fisheye, table, head)
    say(f"{len(pairs)} boards seen by both cameras")
    fit = calibrate_boards(pairs)
    sigma = np.sqrt(np.diag(fit.covariance))
    rig = Rig(
        fisheye=fisheye,
        zoom=table,
        head=head,
        head_from_fisheye_rotation=fit.rotation,
        head_from_fisheye_translation=fit.translation,
        metric=True,
        uncertainty=Uncertainty(
            rotation_rad=max(math.hypot(float(sigma[:3].max()), _lens_sigma_rad(work)), LEAST_ROTATION_RAD),
            translation=max(float(sigma[3:].max()), 1e-3),
            head_rad=max(math.radians(float(head_quality["sigma_deg"])), LEAST_HEAD_RAD),
        ),
    )
    quality: dict[str, object] = {
        "method": "boards",
        "pairs": len(pairs),
        "rms_px": fit.rms_px,
        "reversed": list(fit.reversed_names),
    }
    quality["covariance"] = covariance_part((*TURN_NAMES, "t_x", "t_y", "t_z"), fit.covariance)
    written = write_rig(rig, out, {**quality, "parts": parts_quality(work)})
    baseline = float(np.linalg.norm(fit.translation))
    lines = [
        *verdict_lines(fit.verdicts),
        f"rig: |T| {1e3 * baseline:.1f} mm ± {1e3 * float(sigma[3:].max()):.1f} mm, rms {fit.rms_px:.3f} px "
        f"(fisheye {fit.fisheye_rms_px:.3f}, PTZ {fit.ptz_rms_px:.3f}) of {len(pairs)} boards",
        verdict(rig),
    ]
    return Outcome(lines=tuple(lines), document=quality, written=(written,)), rig, fit


def _lens_sigma_rad(work: Path) -> float:
    """One sigma of the fisheye's rays: for the direction that is predicted it counts like an error of R."""
    return math.radians(float(read_part(work, "fisheye")["quality"].get("ray_sigma_deg", 0.0)))


def scene_pairs(
    fisheye_grey: Grey, shots: Sequence[Shot], greys: Sequence[Grey], table: ZoomTable, head: HeadModel
) -> ScenePairs:
    """Features of the fisheye's picture found in the widest PTZ pictures, as directions in the head's frame."""
    mine = find_features(fisheye_grey, most=4000, contrast=0.008)
    wide = min(shot.zoom for shot in shots)
    chosen = [(shot, grey) for shot, grey in zip(shots, greys, strict=True) if shot.zoom == wide]
    camera = table.camera_at(wide)
    parts = []
    for share in SHARES:
        for (shot, _), features in zip(chosen, features_of([grey for _, grey in chosen], share), strict=True):
            pairs = match(mine, features, ratio=0.85)
            rays, valid = camera.lift(features.pixels[pairs[:, 1]])
            turned = head.head_from_camera(*head.pan_tilt_from_vapix(shot.reading))
            sigma = np.full(int(valid.sum()), 0.6 / share / camera.fx)
            parts.append((mine.pixels[pairs[valid, 0]], (rays @ turned.T)[valid], sigma))
    return ScenePairs(
        fisheye_px=np.concatenate([part[0] for part in parts]),
        directions=np.concatenate([part[1] for part in parts]),
        sigma_rad=np.concatenate([part[2] for part in parts]),
    )


def rig_from_scene(
    shots_path: Path,
    fisheye_path: Path,
    work: Path,
    out: Path,
    say: Say,
    *,
    limit_rad: float = math.inf,
    seed: int = 1,
) -> SceneResult:
    """rig.yaml with |T| = 1 from features of the scene; the fisheye too when the work folder has none.

    Raises
    ------
    CalibrationError
        When too few features agree, or when the pointing error to expect is above the limit: nothing is written then.
    """
    shots = read_shots(shots_path)
    table, (head, head_quality) = zoom_of(work), head_of(work)
    known = fisheye_of(work) if (work / "fisheye.part.yaml").is_file() else None
    if known is not None and not isinstance(known, UnifiedCamera):
        raise CalibrationError("fisheye: without a board the rig needs the unified model; `--model unified`")
    grey = grey_of(fisheye_path)
    say("matching fisheye and PTZ pictures")
    pairs = scene_pairs(grey, shots, [grey_of(shots_path.parent / shot.image) for shot in shots], table, head)
    height, width = grey.shape
    fit = calibrate_scene_rig(pairs, (width, height), None if known is None else lens_of(known)[1], progress=say)
    fit = refine_by_planes(fit, (width, height), held=known is not None, progress=say, seed=seed)
    expected = pointing_error(fit, (width, height), held=known is not None, progress=say)
    judge(expected, limit_rad, say)
    rig = Rig(
        fisheye=known or _to_edge(fit, (width, height)),
        zoom=table,
        head=head,
        head_from_fisheye_rotation=fit.rotation,
        head_from_fisheye_translation=fit.translation,
        metric=False,
        uncertainty=_scene_uncertainty(
            fit, _lens_sigma_rad(work) if known is not None else 0.0, math.radians(float(head_quality["sigma_deg"]))
        ),
    )
    quality = {
        "method": "scene",
        "features": len(fit.pairs.directions),
        "planes": fit.planes,
        "rms_px": fit.rms_px,
        "pointing": expected.document(),
        "across_median_deg": math.degrees(float(np.nanmedian(np.abs(fit.across_rad)))),
        "fisheye": "from a board" if known is not None else "from the scene",
        "covariance": covariance_part((*UNIFIED.names, *TURN_NAMES, "t_across_1", "t_across_2"), fit.covariance),
    }
    if known is None:
        write_part(work, "fisheye_from_scene", fisheye_section(rig.fisheye), quality)
    written = write_rig(rig, out, {**quality, "parts": parts_quality(work)})
    lines = (
        f"rig: {quality['features']} features on {fit.planes} planes agree to {quality['across_median_deg']:.3f}° "
        f"across their circles (median), {fit.rms_px:.3f} px",
        "  no board of known size: |T| = 1, ranges are in baselines (metric: false)",
        verdict(rig),
    )
    return SceneResult(
        rig=rig, fit=fit, expected=expected, outcome=Outcome(lines=lines, document=quality, written=(written,))
    )


def judge(expected: PointingError, limit_rad: float, say: Say) -> None:
    """Say what pointing error to expect; refuse what is above the limit."""
    told = "unknown size" if math.isinf(expected.p95_rad) else f"{math.degrees(expected.p95_rad):.3f}° at 95 %"
    halves = expected.halves_rad
    told_halves = "unknown, they are too few" if math.isinf(halves) else f"{math.degrees(halves):.3f}°"
    say(
        f"verdict: expect a pointing error of {told} (covariance {math.degrees(expected.covariance_rad):.3f}°, "
        f"halves of the scene against each other {told_halves})"
    )
    if expected.p95_rad > limit_rad:
        raise CalibrationError(
            f"rig: the pointing error to expect, {told}, is above the limit of {math.degrees(limit_rad):g}°, nothing "
            "was written: capture a scene with more texture, walls and floor in view, or a board; or take it as it is "
            "with --accept"
        )


def _scene_uncertainty(fit: SceneRigFit, lens_rad: float, head_rad: float) -> Uncertainty:
    sigma = np.sqrt(np.diag(fit.covariance))
    across = 1.4826 * float(np.nanmedian(np.abs(fit.across_rad)))
    return Uncertainty(
        rotation_rad=max(math.hypot(float(sigma[9:12].max()), lens_rad), across, LEAST_ROTATION_RAD),
        translation=min(max(float(sigma[12:].max()), 1e-3), 0.5),
        head_rad=max(head_rad, LEAST_HEAD_RAD),
    )


def _to_edge(fit: SceneRigFit, size_px: tuple[int, int]) -> CameraModel:
    camera = fit.lens.camera(fit.values, size_px, math.radians(179.0))
    rays, valid = camera.lift(fit.pairs.fisheye_px)
    reach = float(np.percentile(angle_between(rays[valid], np.array([0.0, 0.0, 1.0])), REACH_PERCENT)) + EDGE_RAD
    return fit.lens.camera(fit.values, size_px, min(reach, camera.limit_rad - 1e-6))


def parts_quality(work: Path) -> dict[str, object]:
    """What the work folder knows of how well each part was measured."""
    made = [name for name in ("fisheye", "ptz", "head") if part_path(work, name).exists()]
    return {name: read_part(work, name)["quality"] for name in made}


def write_rig(rig: Rig, out: Path, quality: Mapping[str, object]) -> Path:
    """Write rig.yaml, read it back, and only then put it in place."""
    when = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    text = dump_rig(rig, {"made": when, "ptzd": __version__, **quality})
    read_rig(text, str(out))
    out.parent.mkdir(parents=True, exist_ok=True)
    fresh = out.with_suffix(".new")
    fresh.write_text(text)
    fresh.replace(out)
    return out


def expected_error_rad(rig: Rig, range_: float) -> float:
    """One sigma of the predicted direction at a range, in the unit of T."""
    assert rig.uncertainty is not None
    shift = 0.0 if math.isinf(range_) else rig.uncertainty.translation / range_
    return math.hypot(rig.uncertainty.rotation_rad, rig.uncertainty.head_rad, shift)


def verdict(rig: Rig) -> str:
    """One sentence: what pointing error to expect, and what would make it less."""
    unit = "m" if rig.metric else "baselines"
    told = ", ".join(
        f"{math.degrees(expected_error_rad(rig, metres)):.2f}° at "
        + ("infinity" if math.isinf(metres) else f"{metres:g} {unit}")
        for metres in RANGES_M
    )
    assert rig.uncertainty is not None
    near, far = expected_error_rad(rig, 1.0), expected_error_rad(rig, math.inf)
    if not rig.metric:
        advice = "a board of known size in both cameras would give ranges in metres"
    elif near > 2.0 * far:
        advice = "more boards close to both cameras, spread over the field, would improve near targets most"
    elif rig.uncertainty.head_rad > rig.uncertainty.rotation_rad:
        advice = "more pictures with pan and tilt far apart would improve the head, which limits it"
    else:
        advice = "more boards far apart in the fisheye's picture would improve it most"
    return f"verdict: expect a pointing error (one sigma) of {told}; {advice}."
