"""The calibrated pair: fisheye, head and zoom table, and where they are to each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import CalibrationError, GeometryError
from ptzd.geometry.head import HeadModel
from ptzd.geometry.perspective import PerspectiveCamera
from ptzd.geometry.types import Array, CameraModel, Mask, checked
from ptzd.geometry.zoom import ZoomTable
from ptzd.model import HeadReading

BAND_SIGMAS = 3.0
"""Half width of the band across the arc, in sigmas of the predicted direction."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Uncertainty:
    """One sigma of the calibration."""

    rotation_rad: float
    """Of R, about any axis, rad."""
    translation: float
    """Of T, along any axis, in the unit of T."""
    head_rad: float
    """Of the head's angles, rad."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rig:
    """A calibrated fisheye and PTZ: ``X_head = R X_fisheye + T``.

    Compared by identity; the arrays are copies that cannot be written.
    """

    fisheye: CameraModel
    zoom: ZoomTable
    head: HeadModel
    head_from_fisheye_rotation: Array
    """R, shape (3, 3)."""
    head_from_fisheye_translation: Array
    """T, shape (3,), in metres when ``metric``, of length 1 otherwise."""
    metric: bool
    """Whether T is in metres; if not, ranges are in baselines."""
    uncertainty: Uncertainty | None = None

    def __post_init__(self) -> None:
        rotation = checked(self.head_from_fisheye_rotation, 3, "head_from_fisheye_rotation").copy()
        translation = checked(self.head_from_fisheye_translation, 3, "head_from_fisheye_translation").copy()
        if rotation.shape != (3, 3) or not np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-6:
            raise GeometryError("head_from_fisheye_rotation: not a rotation")
        if np.linalg.det(rotation) < 0.0:
            raise GeometryError("head_from_fisheye_rotation: mirrored, its determinant is -1")
        if translation.shape != (3,) or not 0.0 < np.linalg.norm(translation) < np.inf:
            raise GeometryError("head_from_fisheye_translation: expected three finite numbers, not all zero")
        rotation.flags.writeable = translation.flags.writeable = False
        object.__setattr__(self, "head_from_fisheye_rotation", rotation)
        object.__setattr__(self, "head_from_fisheye_translation", translation)

    def head_from_camera(self, reading: HeadReading) -> Array:
        """Return the 3x3 rotation from the camera frame at this reading to the head frame."""
        return self.head.head_from_camera(*self.head.pan_tilt_from_vapix(reading))

    def camera(self, reading: HeadReading) -> PerspectiveCamera:
        """Return the PTZ's camera model at the reading's zoom; GeometryError outside the zoom table."""
        return self.zoom.camera_at(reading.zoom)

    def project_to_view(self, bearings_head: ArrayLike, reading: HeadReading) -> tuple[Array, Mask]:
        """Return pixels ``(..., 2)`` of head-frame directions ``(..., 3)`` in the view at this reading, and the mask.

        The mask is the camera's valid set; whether a pixel is inside the picture is `in_picture`'s answer.
        """
        rays = checked(bearings_head, 3, "bearings_head") @ self.head_from_camera(reading)
        return self.camera(reading).project(rays)

    def lift_from_view(self, pixels: ArrayLike, reading: HeadReading) -> Array:
        """Return head-frame unit directions ``(..., 3)`` of pixels ``(..., 2)`` of the view at this reading.

        Raises
        ------
        GeometryError
            When a pixel lies beyond the fold of the distortion; ``camera(reading).lift`` gives a mask instead.
        """
        rays, valid = self.camera(reading).lift(pixels)
        if not valid.all():
            raise GeometryError(f"{int((~valid).sum())} pixel(s) of the view at zoom {reading.zoom:g} cannot be lifted")
        return np.asarray(rays @ self.head_from_camera(reading).T)

    def aim(self, bearing: ArrayLike, zoom: float) -> HeadReading:
        """Return the reading that points the optical axis at a head-frame direction ``(3,)``, as `HeadModel.aim`."""
        return self.head.vapix_from_pan_tilt(*self.head.aim(bearing), zoom)

    def band_rad(self, inverse_range: float = 0.0) -> float:
        """Return how far off the arc the target may lie, rad: 3 sigma of the predicted direction.

        The variances of R, of the head and of T over the target's distance add up: an error of T turns the direction
        by its share across the line of sight.

        Parameters
        ----------
        inverse_range : float
            1 / distance from the head, in the inverse unit of T; `EpipolarArc.head_inverse_range` gives it, and the
            inverse range from the fisheye is a fair stand-in for distances over a few baselines.

        Raises
        ------
        CalibrationError
            When the calibration comes without its uncertainty.
        """
        if self.uncertainty is None:
            raise CalibrationError("uncertainty: missing; give one sigma of rotation, translation and head in rig.yaml")
        shift = self.uncertainty.translation * inverse_range
        return BAND_SIGMAS * math.hypot(self.uncertainty.rotation_rad, self.uncertainty.head_rad, shift)
