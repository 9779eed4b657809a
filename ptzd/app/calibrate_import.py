"""`ptzd calibrate fisheye --from`: the fisheye from another tool's file."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

from ptzd.app.calibrating import Outcome, write_part
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
        f"  {reach.told()}, {_why_it_ends(read.camera, reach, asked)}",
    )
    return Outcome(lines=lines, document={**quality, "source": str(path)}, written=(written,)), read.camera, reach


def _why_it_ends(camera: CameraModel, reach: Reach, asked: Asked) -> str:
    """What ends the rays, and what to do where something can be done."""
    if reach.share == 1.0:
        return "corners included"
    if camera.limit_rad < asked.max_angle_rad or isinstance(camera, PerspectiveCamera):
        return "where the model itself ends; beyond it its coefficients fold back"
    assert isinstance(camera, UnifiedCamera | KannalaBrandtCamera)
    given = f"where --max-angle {math.degrees(asked.max_angle_rad):g} ends them"
    most = reach_of(replace(camera, max_angle_rad=_WIDEST_RAD))
    if most.share <= reach.share:
        return given
    reaches = math.floor(math.degrees(most.angle_rad) * 10.0) / 10.0
    return f"{given}; with --max-angle {reaches:.1f}, as far as the model goes, {percent(most.share)}"
