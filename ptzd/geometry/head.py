"""The pan-tilt head: from what the camera reports to the head frame and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.sphere import POLE_GUARD, normalise, rotation_from_rotvec, rx, ry, wrap_angle
from ptzd.geometry.types import Array, checked
from ptzd.model import HeadReading

_RAD_PER_DEG = math.pi / 180.0
_Number = TypeVar("_Number", float, Array)


@dataclass(frozen=True, slots=True, kw_only=True)
class Axis:
    """One axis of the head: ``angle_rad = sign · scale · (π/180) · vapix_deg + offset_rad``."""

    sign: int = 1
    """+1 or -1."""
    scale: float = 1.0
    """Angle of the head frame per reported angle, > 0; 1 for an honest encoder."""
    offset_rad: float = 0.0
    """Angle of the head frame where the camera reports 0, rad."""

    def __post_init__(self) -> None:
        if self.sign not in (-1, 1) or not self.scale > 0.0 or not math.isfinite(self.scale * self.offset_rad):
            raise GeometryError(f"not an axis: sign ±1, scale > 0, finite offset; got {self!r}")

    def angle_rad(self, vapix_deg: _Number) -> _Number:
        """Return the angle in the head frame, rad, of a reported angle in deg; not wrapped."""
        return vapix_deg * (self.sign * self.scale * _RAD_PER_DEG) + self.offset_rad

    def vapix_deg(self, angle_rad: _Number) -> _Number:
        """Return the angle in deg that the camera would report; the inverse of `angle_rad`, not wrapped."""
        return (angle_rad - self.offset_rad) / (self.sign * self.scale * _RAD_PER_DEG)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadModel:
    """Both axes, and how the camera sits on them.

    ``head_from_camera(pan, tilt) = Ry(pan) · Rx(tilt) · M`` with ``M = exp(camera_rotvec)``, so without misalignment
    ``head_from_camera @ [0, 0, 1] == bearing(pan, tilt)``. Pan and tilt are the angles of the axes; with a misalignment
    they are not the direction of the optical axis: that is what `aim` is for.
    """

    pan: Axis
    tilt: Axis
    camera_rotvec_rad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotation vector of M, the camera's misalignment on the tilt axis, rad; the optical axis is ``M @ z``."""

    def __post_init__(self) -> None:
        if rotation_from_rotvec(self.camera_rotvec_rad)[2, 2] < math.sqrt(0.5):
            raise GeometryError(
                f"the optical axis is over 45° off the head's axis: rotvec {self.camera_rotvec_rad} rad"
            )

    def pan_tilt_from_vapix(self, reading: HeadReading) -> tuple[float, float]:
        """Return pan in ``[-π, π)`` and tilt, rad, of a reading in the camera's units."""
        return float(wrap_angle(self.pan.angle_rad(reading.pan_deg))), self.tilt.angle_rad(reading.tilt_deg)

    def vapix_from_pan_tilt(self, pan: float, tilt: float, zoom: float) -> HeadReading:
        """Return the reading, in the camera's units, of pan and tilt in rad; pan comes out in ``[-180, 180)``/scale."""
        turned = self.pan.offset_rad + float(wrap_angle(pan - self.pan.offset_rad))
        return HeadReading(pan_deg=self.pan.vapix_deg(turned), tilt_deg=self.tilt.vapix_deg(tilt), zoom=zoom)

    def head_from_camera(self, pan: float, tilt: float) -> Array:
        """Return the 3x3 rotation from the camera frame at pan, tilt (rad) to the head frame."""
        return np.asarray(ry(pan) @ rx(tilt) @ rotation_from_rotvec(self.camera_rotvec_rad))

    def aim(self, bearing: ArrayLike) -> tuple[float, float]:
        """Return pan and tilt, rad, that point the optical axis at one bearing ``(3,)``; see `aim_all`."""
        pan, tilt = self.aim_all(bearing)
        return float(pan), float(tilt)

    def aim_all(self, bearings: ArrayLike) -> tuple[Array, Array]:
        """Return pan and tilt, rad, that point the optical axis, misalignment included, at bearings ``(..., 3)``.

        Solves ``Ry(pan) Rx(tilt) a = b`` for the optical axis ``a = M z``: the x component gives
        ``sin(pan_b - pan) = a_x / hypot(b_x, b_z)``, the other two give tilt. Closer to a pole than ``|a_x|`` no pose
        points there, and the one whose axis passes nearest is returned, off by at most ``asin |a_x|``. At the pole
        itself ``pan_b`` is 0 by definition.
        """
        target = normalise(checked(bearings, 3, "bearings"))
        axis_x, axis_y, axis_z = rotation_from_rotvec(self.camera_rotvec_rad)[:, 2]
        x, y, z = target[..., 0], target[..., 1], target[..., 2]
        flat = np.hypot(x, z)
        regular = flat > POLE_GUARD
        toward = np.where(regular, np.arctan2(x, z), 0.0)
        pan = toward - np.arcsin(np.clip(axis_x / np.where(regular, flat, 1.0), -1.0, 1.0))
        forward = np.sin(pan) * x + np.cos(pan) * z
        tilt = np.arctan2(forward, y) - math.atan2(axis_z, axis_y)
        return wrap_angle(pan), wrap_angle(tilt)
