"""`ptzd calibrate fisheye --from`: the fisheye from another tool's file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from ptzd.calibrate.parts import Outcome, write_part
from ptzd.calibration.file import fisheye_section
from ptzd.calibration.foreign.described import Asked
from ptzd.calibration.reach import Reach, percent, reach_of
from ptzd.calibration.readers import read_foreign
from ptzd.errors import CalibrationError
from ptzd.geometry.kannala_brandt import KannalaBrandtCamera
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import CameraModel
from ptzd.geometry.unified import UnifiedCamera

_WIDEST_RAD = math.radians(179.9)
_NOTHING = 0.05
"""A camera with rays in a smaller share of its picture was not calibrated for it."""


def foreign(path: Path, work: Path, asked: Asked) -> tuple[Outcome, CameraModel, Reach]:
    """The fisheye from another tool's file, how far its rays reach and what ends them.

    Raises
    ------
    CalibrationError
        The file as in `read_foreign`, an angle that is none, or rays in hardly any of the picture.
    """
    if not 0.0 < asked.max_angle_rad < math.pi:
        raise CalibrationError(f"--max-angle {math.degrees(asked.max_angle_rad):g}: must be over 0° and under 180°")
    read = read_foreign(path, asked)
    reach = reach_of(read.camera)
    if reach.share < _NOTHING:
        raise CalibrationError(
            f"{path}: {reach.told()}: is the matrix of another resolution, or are the coefficients of another model?"
        )
    section = fisheye_section(read.camera)
    quality = {"source": path.name, "format": read.source, **reach.document()}
    if read.name is not None:
        quality["camera"] = read.name
    written = write_part(work, "fisheye", section, quality)
    width, height = read.camera.size_px
    chosen = "" if read.name is None else f", camera {read.name}"
    lines = (
        f"fisheye: {section['model']} {width}×{height} px read from {path} ({read.source}{chosen})",
        *(f"  {line}" for line in _told(read.camera, reach, asked)),
    )
    return Outcome(lines=lines, document={**quality, "source": str(path)}, written=(written,)), read.camera, reach


def _told(camera: CameraModel, reach: Reach, asked: Asked) -> list[str]:
    """How far the rays reach, what ends them, and what to do where something can be done."""
    if reach.share == 1.0:
        return [reach.told()]
    if camera.limit_rad < asked.max_angle_rad or isinstance(camera, PerspectiveCamera):
        return [reach.told("where the model's own coefficients end it")]
    assert isinstance(camera, UnifiedCamera | KannalaBrandtCamera)
    lines = [reach.told(f"where --max-angle {math.degrees(asked.max_angle_rad):g} ends them")]
    most = reach_of(replace(camera, max_angle_rad=_WIDEST_RAD))
    if most.share > reach.share:
        reaches = math.degrees(most.angle_rad)
        reaches = math.ceil(reaches * 10.0) / 10.0 if most.share == 1.0 else math.floor(reaches * 10.0) / 10.0
        lines.append(
            f"the model goes on to {reaches:.1f}° and {percent(most.share)}; where the lens still has a picture there, "
            f"give --max-angle, up to {reaches:.1f}"
        )
    return lines
