"""`ptzd calibrate`: the parts of a rig, each from its pictures, kept in a work folder until the rig joins them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import yaml

from ptzd import __version__
from ptzd.calibration.file import fisheye_section, read_fisheye_section
from ptzd.calibration.intrinsics import LensFit, calibrate_lens
from ptzd.calibration.lens import KANNALA_BRANDT, PERSPECTIVE, UNIFIED, WIDE_RAD
from ptzd.calibration.pictures import Boards, read_boards
from ptzd.calibration.reach import reach_of
from ptzd.calibration.target import Target
from ptzd.calibration.views import ViewVerdict
from ptzd.documents import DocumentError, parse_json, parse_yaml, read_text
from ptzd.errors import CalibrationError
from ptzd.geometry.head import Axis, HeadModel
from ptzd.geometry.sphere import angle_between
from ptzd.geometry.types import Array, CameraModel
from ptzd.geometry.zoom import ZoomEntry, ZoomTable
from ptzd.model import HeadReading

EDGE_RAD = math.radians(2.0)
"""The image circle is believed so far beyond the farthest point that was seen."""
Say = Callable[[str], None]


class Shot(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One entry of a list of PTZ pictures: what `ptzd locate` reads, and which fisheye picture was taken with it."""

    image: str
    pan_deg: float
    tilt_deg: float
    zoom: float
    fisheye: str | None = None
    place: int = 0
    """Boards of one place did not move between the pictures."""

    @property
    def reading(self) -> HeadReading:
        """Angles and zoom as the camera reported them."""
        return HeadReading(pan_deg=self.pan_deg, tilt_deg=self.tilt_deg, zoom=self.zoom)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a step found, for a person and for a program."""

    lines: tuple[str, ...]
    document: Mapping[str, object]
    written: tuple[Path, ...]
    figures: tuple[str, ...] = field(default=(), repr=False)
    """Parts of the HTML report."""


def read_shots(path: Path) -> tuple[Shot, ...]:
    """Read a list of PTZ pictures; image paths are relative to it."""
    try:
        shots = msgspec.convert(parse_json(read_text(path)), tuple[Shot, ...])
    except OSError as error:
        raise CalibrationError(f"{path}: {error.strerror}; give the list of pictures with their angles") from None
    except (DocumentError, msgspec.ValidationError) as error:
        raise CalibrationError(f"{path}: {error}; expected a list of image, pan_deg, tilt_deg, zoom") from None
    if not shots:
        raise CalibrationError(f"{path}: no pictures; take some with `ptzd calibrate capture`")
    return shots


def part_path(work: Path, name: str) -> Path:
    """Where a part of the rig is kept."""
    return work / f"{name}.part.yaml"


def write_part(work: Path, name: str, section: object, quality: Mapping[str, object]) -> Path:
    """Keep a part of the rig in the work folder."""
    work.mkdir(parents=True, exist_ok=True)
    path = part_path(work, name)
    when = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    document = {"ptzd_part": name, name: section, "quality": dict(quality), "made": when, "ptzd": __version__}
    path.write_text(yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=120))
    return path


def covariance_part(names: Sequence[str], covariance: Array) -> dict[str, object]:
    """A covariance as the provenance of rig.yaml has it: names, and rows of numbers (px, rad, the unit of T)."""
    rows = [[float(f"{value:.6g}") for value in row] for row in covariance.tolist()]
    return {"of": list(names), "rows": rows}


def read_part(work: Path, name: str) -> dict[str, Any]:
    """Read a part of the rig from the work folder.

    Raises
    ------
    CalibrationError
        When it has not been made yet.
    """
    path = part_path(work, name)
    try:
        document = parse_yaml(read_text(path))
    except DocumentError as error:
        raise CalibrationError(f"{path}: {error}") from None
    except OSError:
        made_by = {"fisheye": "fisheye", "ptz": "zoom", "head": "head"}[name]
        raise CalibrationError(f"{path}: missing; make it with `ptzd calibrate {made_by} --work {work}`") from None
    if not isinstance(document, dict) or document.get("ptzd_part") != name:
        raise CalibrationError(f"{path}: not a part {name} of a calibration")
    return document


def fisheye_of(work: Path) -> CameraModel:
    """The fisheye in the work folder."""
    return read_fisheye_section(read_part(work, "fisheye")["fisheye"], str(work / "fisheye.part.yaml"))


def zoom_of(work: Path) -> ZoomTable:
    """The zoom table in the work folder."""
    part = read_part(work, "ptz")["ptz"]
    entries = tuple(ZoomEntry(**{**entry, "distortion": tuple(entry["distortion"])}) for entry in part["zoom"])
    width, height = part["size_px"]
    return ZoomTable(size_px=(width, height), entries=entries)


def head_of(work: Path) -> tuple[HeadModel, dict[str, Any]]:
    """The head in the work folder, and how well it is known."""
    document = read_part(work, "head")
    part = document["head"]
    axes = [
        Axis(sign=axis["sign"], scale=axis["scale"], offset_rad=math.radians(axis["offset_deg"]))
        for axis in (part["pan"], part["tilt"])
    ]
    x, y, z = (math.radians(angle) for angle in part["camera_rotvec_deg"])
    return HeadModel(pan=axes[0], tilt=axes[1], camera_rotvec_rad=(x, y, z)), document["quality"]


def write_head(work: Path, head: HeadModel, quality: Mapping[str, object]) -> Path:
    """Keep the head in the work folder."""
    section = {
        name: {"sign": axis.sign, "scale": axis.scale, "offset_deg": math.degrees(axis.offset_rad)}
        for name, axis in (("pan", head.pan), ("tilt", head.tilt))
    }
    turn = [math.degrees(angle) for angle in head.camera_rotvec_rad]
    return write_part(work, "head", {**section, "camera_rotvec_deg": turn}, quality)


def write_zoom(work: Path, table: ZoomTable, quality: Mapping[str, object]) -> Path:
    """Keep the zoom table in the work folder."""
    entries = [
        {
            "zoom": float(entry.zoom),
            **{name: float(getattr(entry, name)) for name in ("fx", "fy", "cx", "cy")},
            "distortion": [float(value) for value in entry.distortion],
        }
        for entry in table.entries
    ]
    return write_part(work, "ptz", {"size_px": list(table.size_px), "zoom": entries}, quality)


def verdict_lines(verdicts: tuple[ViewVerdict, ...]) -> list[str]:
    """A line per picture."""
    lines = []
    for verdict in verdicts:
        numbers = "" if math.isnan(verdict.rms_px) else f"rms {verdict.rms_px:.3f} px"
        if not math.isnan(verdict.held_out_rms_px):
            numbers += f", held out {verdict.held_out_rms_px:.3f} px"
        lines.append(f"  {verdict.name:24} {verdict.status:20} {numbers} {verdict.reason}".rstrip())
    return lines


def camera_to_edge(fit: LensFit) -> CameraModel:
    """The camera valid to a little beyond the farthest point seen, as far as the model reaches."""
    reach = fit.max_angle_rad + EDGE_RAD
    limit = fit.camera(WIDE_RAD).limit_rad - 1e-6
    return fit.camera(min(reach, limit))


def apart_rad(one: CameraModel, other: CameraModel, pixels: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    """Angles between the rays of two cameras, the best turn removed."""
    first, valid = one.lift(pixels)
    second, also = other.lift(pixels)
    first, second = first[valid & also], second[valid & also]
    left, _, right = np.linalg.svd(first.T @ second)
    turn = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return angle_between(first, second @ turn.T)


def fisheye(source: Path, target: Target, work: Path, model: str, say: Say) -> tuple[Outcome, LensFit, Boards]:
    """The fisheye from pictures of a board: both models, the one that is asked for kept."""
    boards = read_boards(source, target, lambda text, done, total: say(f"[{done}/{total}] {text}"))
    lens, rival = (UNIFIED, KANNALA_BRANDT) if model == "unified" else (KANNALA_BRANDT, UNIFIED)
    fit = calibrate_lens(boards.views, boards.size_px, lens, progress=say)
    other = calibrate_lens(boards.views, boards.size_px, rival, held_out=False, progress=say)
    pixels = np.concatenate([view.pixels for view in fit.views])
    difference = np.degrees(apart_rad(camera_to_edge(fit), camera_to_edge(other), pixels))
    verdicts = (*fit.verdicts, *boards.refused)
    held = [verdict.held_out_rms_px for verdict in verdicts if not math.isnan(verdict.held_out_rms_px)]
    quality = {
        "views": len(fit.views),
        "pictures": len(boards.paths),
        "rms_px": fit.rms_px,
        "held_out_rms_px": float(np.sqrt(np.mean(np.square(held)))),
        "ray_sigma_deg": math.degrees(fit.ray_sigma_rad()),
        "other_model": {"model": rival.name, "rms_px": other.rms_px, "rays_apart_deg": float(np.median(difference))},
        "sigma": dict(zip(lens.names, np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)),
        "covariance": covariance_part(lens.names, fit.covariance),
    }
    reach = reach_of(camera_to_edge(fit))
    quality |= reach.document()
    path = write_part(work, "fisheye", fisheye_section(camera_to_edge(fit)), quality)
    lines = [
        *verdict_lines(verdicts),
        f"fisheye: {len(fit.views)} of {len(boards.paths)} pictures used, rms {fit.rms_px:.3f} px, held out "
        f"{quality['held_out_rms_px']:.3f} px, rays known to {quality['ray_sigma_deg']:.3f}°",
        "  " + ", ".join(f"{name} {value:.5g}" for name, value in zip(lens.names, fit.values.tolist(), strict=True)),
        f"  {rival.name}: rms {other.rms_px:.3f} px, its rays differ by {np.median(difference):.3f}° in the median, "
        f"{np.percentile(difference, 95):.3f}° at 95 %",
        f"  {reach.told(_why_it_ends(fit))}",
    ]
    document = {**quality, "verdicts": [_plain(verdict) for verdict in verdicts]}
    return Outcome(lines=tuple(lines), document=document, written=(path,)), fit, boards


def _plain(verdict: ViewVerdict) -> dict[str, object]:
    numbers = {"rms_px": verdict.rms_px, "held_out_rms_px": verdict.held_out_rms_px}
    known = {name: float(value) for name, value in numbers.items() if not math.isnan(value)}
    return {"name": verdict.name, "status": verdict.status.value, "reason": verdict.reason, **known}


def _why_it_ends(fit: LensFit) -> str:
    if camera_to_edge(fit).limit_rad < fit.max_angle_rad + EDGE_RAD - 1e-5:
        return "where the model folds back"
    return f"{math.degrees(EDGE_RAD):g}° beyond the farthest point of a board"


def zoom_from_boards(shots: Path, target: Target, work: Path, say: Say) -> Outcome:
    """The zoom table from pictures of a board at every zoom."""
    listed = read_shots(shots)
    entries, lines, quality = [], [], []
    size_px = (0, 0)
    for zoom in sorted({shot.zoom for shot in listed}):
        paths = [shots.parent / shot.image for shot in listed if shot.zoom == zoom]
        say(f"zoom {zoom:g}: {len(paths)} pictures")
        boards = read_boards(paths, target)
        try:
            fit = calibrate_lens(boards.views, boards.size_px, PERSPECTIVE, held_out=False, progress=say)
        except CalibrationError as error:
            raise CalibrationError(f"zoom {zoom:g}: {error}") from error
        if size_px not in ((0, 0), fit.size_px):
            raise CalibrationError(f"zoom {zoom:g}: pictures of {fit.size_px} px, the others have {size_px} px")
        size_px = fit.size_px
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = fit.values.tolist()
        entries.append(ZoomEntry(zoom=zoom, fx=fx, fy=fy, cx=cx, cy=cy, distortion=(k1, k2, p1, p2, k3)))
        share = float(np.sqrt(fit.covariance[0, 0])) / fx
        quality.append(
            {
                "zoom": zoom,
                "views": len(fit.views),
                "rms_px": fit.rms_px,
                "focal_sigma": share,
                "covariance": covariance_part(PERSPECTIVE.names, fit.covariance),
            }
        )
        lines += [f"zoom {zoom:g}: fx {fx:.2f} px ± {100 * share:.2f} %, rms {fit.rms_px:.3f} px"]
    path = write_zoom(work, ZoomTable(size_px=size_px, entries=tuple(entries)), {"zooms": quality, "board": True})
    return Outcome(lines=tuple(lines), document={"zooms": quality}, written=(path,))
