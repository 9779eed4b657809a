"""`ptzd calibrate zoom` and `head`: lens over zoom and axes from pictures with angles, with boards or without."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import cv2
import numpy as np

from ptzd.calibrate.parts import (
    Outcome,
    Say,
    Shot,
    covariance_part,
    read_shots,
    write_head,
    write_zoom,
    zoom_of,
)
from ptzd.calibration.boards import Seen
from ptzd.calibration.detect import Grey
from ptzd.calibration.features import Features, find_features
from ptzd.calibration.lens import PERSPECTIVE
from ptzd.calibration.pictures import Boards, read_boards, read_grey
from ptzd.calibration.rotation import TurnedPicture, TurningFit, calibrate_turning, collect, without_poor_zooms
from ptzd.calibration.target import Target
from ptzd.calibration.turned_boards import TurnedBoard, calibrate_head
from ptzd.calibration.turning import head_model
from ptzd.errors import CalibrationError
from ptzd.geometry.head import HeadModel
from ptzd.geometry.zoom import ZoomTable

HEAD_NAMES = ("pan_scale", "tilt_scale", "tilt_offset", "camera_turn_y", "camera_turn_z")
"""Of `ptzd.calibration.turning`: shares and rad."""
LENS_NAMES = ("f", "cx", "cy", "k1", "k2")
"""Of one zoom without a board: px and Brown's coefficients."""


def grey_of(path: Path) -> Grey:
    """A picture that must be there."""
    grey = read_grey(path)
    if grey is None:
        raise CalibrationError(f"{path}: not a picture")
    return grey


def features_of(greys: Sequence[Grey], share: float = 1.0) -> list[Features]:
    """Features of pictures, two at a time."""
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(lambda grey: find_features(grey, share=share), greys))
    finally:
        cv2.setNumThreads(threads)


def turning(shots_path: Path, work: Path, say: Say) -> Outcome:
    """Zoom table and head from pictures of the scene."""
    shots = read_shots(shots_path)
    greys = [grey_of(shots_path.parent / shot.image) for shot in shots]
    shapes = {grey.shape for grey in greys}
    if len(shapes) > 1:
        raise CalibrationError(f"{shots_path}: pictures of several sizes {sorted(shapes)}; take all at one size")
    say(f"features of {len(greys)} pictures")
    pictures = [
        TurnedPicture(name=shot.image, reading=shot.reading, features=features)
        for shot, features in zip(shots, features_of(greys), strict=True)
    ]
    say("matching")
    kept, matches, poor = without_poor_zooms(pictures, collect(pictures))
    if not kept:
        raise CalibrationError(f"{shots_path}: no zoom has enough matches; point the camera at something with texture")
    height, width = greys[0].shape
    say(f"bundle of {len(matches.first)} matches")
    fit = calibrate_turning(kept, (width, height), matches, say)
    head = head_model(fit.head, fit.signs)
    sigma = np.sqrt(np.diag(fit.covariance))
    head_sigma = float(math.degrees(max(sigma[2:5])))
    zooms = [
        {"zoom": entry.zoom, "fx": entry.fx, "focal_sigma": share, "rms_px": rms, "matches": count, "covariance": part}
        for entry, share, rms, count, part in zip(
            fit.entries, fit.focal_sigma, fit.zoom_rms_px, fit.counts, lens_parts(fit), strict=True
        )
    ]
    quality = {"zooms": zooms, "board": False, "rms_px": fit.rms_px}
    written = (
        write_zoom(work, ZoomTable(size_px=(width, height), entries=fit.entries), quality),
        write_head(
            work,
            head,
            {
                "sigma_deg": head_sigma,
                "t_ptz_mm": None,
                "rms_px": fit.rms_px,
                "covariance": covariance_part(HEAD_NAMES, fit.covariance[: len(HEAD_NAMES), : len(HEAD_NAMES)]),
            },
        ),
    )
    lines = [
        f"zoom {row['zoom']:g}: fx {row['fx']:.2f} px ± {100 * float(str(row['focal_sigma'])):.3f} %, "
        f"rms {row['rms_px']:.2f} px of {row['matches']} matches"
        for row in zooms
    ]
    lines += [f"zoom {zoom:g}: left out, its pictures share too little texture" for zoom in poor]
    lines += head_lines(head)
    lines += ["  T_ptz cannot be seen without a board of known size; `ptzd calibrate head --board` measures it"]
    return Outcome(lines=tuple(lines), document={**quality, "left_out": list(poor)}, written=written)


def lens_parts(fit: TurningFit) -> list[dict[str, object]]:
    """The covariance of every zoom's lens."""
    count = len(HEAD_NAMES)
    starts = range(count, len(fit.covariance), len(LENS_NAMES))
    blocks = [slice(start, start + len(LENS_NAMES)) for start in starts]
    return [covariance_part(LENS_NAMES, fit.covariance[block, block]) for block in blocks]


def head_lines(head: HeadModel) -> list[str]:
    """The head for a person."""
    turn = ", ".join(f"{math.degrees(angle):.3f}" for angle in head.camera_rotvec_rad)
    return [
        f"head: pan sign {head.pan.sign:+d}, scale {head.pan.scale:.5f}; tilt sign {head.tilt.sign:+d}, "
        f"scale {head.tilt.scale:.5f}, offset {math.degrees(head.tilt.offset_rad):.3f}°; camera turned by ({turn})°"
    ]


def seen_by_ptz(table: ZoomTable, boards: Boards, shots: Mapping[str, Shot], head: HeadModel | None) -> dict[str, Seen]:
    """Boards of PTZ pictures by the picture's name."""
    found = {}
    for view in boards.views:
        shot = shots[view.name]
        camera = table.camera_at(shot.zoom)
        values = np.array([camera.fx, camera.fy, camera.cx, camera.cy, *camera.distortion])
        turned = np.eye(3) if head is None else head.head_from_camera(*head.pan_tilt_from_vapix(shot.reading))
        found[view.name] = Seen(
            lens=PERSPECTIVE, values=values, camera=camera, view=view, head_from_camera=np.asarray(turned)
        )
    return found


def head_from_boards(shots_path: Path, target: Target, work: Path, say: Say) -> Outcome:
    """The head, and T_ptz, from boards that rest while the camera turns."""
    shots = read_shots(shots_path)
    table = zoom_of(work)
    boards = read_boards([shots_path.parent / shot.image for shot in shots], target, lambda text, i, n: say(text))
    by_name = {Path(shot.image).name: shot for shot in shots}
    seen = seen_by_ptz(table, boards, by_name, None)
    turned = [
        TurnedBoard(place=by_name[name].place, reading=by_name[name].reading, seen=one) for name, one in seen.items()
    ]
    fit = calibrate_head(turned)
    head = head_model(fit.values, fit.signs)
    millimetres = 1e3 * float(np.linalg.norm(fit.offset_m))
    sigma = np.sqrt(np.diag(fit.covariance))
    errors = {metres: math.degrees(fit.offset_error_rad(metres)) for metres in (2.0, 10.0)}
    quality = {
        "sigma_deg": math.degrees(float(max(sigma[2:5]))),
        "t_ptz_mm": millimetres,
        "t_ptz_sigma_mm": 1e3 * float(np.linalg.norm(sigma[5:])),
        "error_at_2_m_deg": errors[2.0],
        "error_at_10_m_deg": errors[10.0],
        "rms_px": fit.rms_px,
        "pictures": len(turned),
        "covariance": covariance_part((*HEAD_NAMES, "t_x", "t_y", "t_z"), fit.covariance),
    }
    path = write_head(work, head, quality)
    lines = [
        *head_lines(head),
        f"  rms {fit.rms_px:.3f} px of {len(turned)} pictures; T_ptz {millimetres:.1f} ± "
        f"{quality['t_ptz_sigma_mm']:.1f} mm, neglecting it errs by {errors[2.0]:.3f}° at 2 m and "
        f"{errors[10.0]:.3f}° at 10 m",
    ]
    return Outcome(lines=tuple(lines), document=quality, written=(path,))
