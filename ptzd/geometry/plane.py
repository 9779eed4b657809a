"""Planes between the two spheres: the homographies of planes under a known motion (paper, section 5.2, eqs. 6 to 8).

A plane ``N · X = 1``, with X in the fisheye's place but the head's axes (``X = range · R P_f``), sends pre-rotated
rays to directions of the head by ``P_h ∝ H R P_f`` with ``H = I + T Nᵀ``; this is the paper's ``I - T nᵀ/d`` with the
sign of n absorbed. ``N · R P_f`` is the inverse range of that ray. N = 0 is the plane at infinity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ptzd.errors import GeometryError
from ptzd.geometry.arc import inverse_range_of
from ptzd.geometry.sphere import normalise
from ptzd.geometry.types import Array, Mask, checked

MIN_SINGULAR = 1e-3
"""Least singular value of stacked unit rays that span a plane: roughly how far, in rad, they stray from one line; this
is a fraction of a fisheye pixel."""


def plane_from_pairs(
    rotated: ArrayLike, bearings: ArrayLike, translation: ArrayLike, min_singular: float = MIN_SINGULAR
) -> tuple[Array, Mask]:
    """Return the planes that carry pairs of directions over, and where the pairs determine one.

    Each pair puts its ray at the inverse range s of `inverse_range_of` and asks for ``N · R P_f = s`` (the one
    independent row of the paper's eq. 8); three pairs are solved, more fitted by least squares.

    Parameters
    ----------
    rotated : ArrayLike
        Pre-rotated unit rays R P_f, shape ``(..., m, 3)`` with m >= 3.
    bearings : ArrayLike
        Their partners P_h in the head frame, the same shape.
    translation : ArrayLike
        T, shape ``(3,)``.
    min_singular : float
        Refuse sets whose rays' least singular value is below this.

    Returns
    -------
    planes : Array
        N, shape ``(..., 3)``; zero where invalid.
    valid : Mask
        Shape ``(...)``; False for nearly collinear rays, and where a bearing lies on the epipole.
    """
    shift = checked(translation, 3, "translation")
    rays, partners = checked(rotated, 3, "rotated"), normalise(checked(bearings, 3, "bearings"))
    if rays.shape != partners.shape or rays.ndim < 2 or rays.shape[-2] < 3:
        raise GeometryError(f"pairs: expected two arrays (..., m >= 3, 3), got {rays.shape} and {partners.shape}")
    inverse = inverse_range_of(rays, partners, shift)
    seen = np.isfinite(inverse)
    left, singular, right = np.linalg.svd(rays, full_matrices=False)
    valid = np.asarray((singular[..., 2] >= min_singular) & seen.all(axis=-1))
    weights = np.einsum("...mk,...m->...k", left, np.where(seen, inverse, 0.0)) / np.where(
        valid[..., None], singular, 1.0
    )
    planes = np.einsum("...kj,...k->...j", right, weights)
    return np.where(valid[..., None], planes, 0.0), valid


def in_front_of_both(translation: ArrayLike, plane: ArrayLike, rotated: ArrayLike, s_min: float = 0.0) -> Mask:
    """Tell which planes N ``(..., 3)`` both cameras see, from the same side, along all rays ``(..., m, 3)``.

    The fisheye has the plane in front along a ray when ``N · R P_f >= 0``; the head's centre is at ``-T`` and on the
    same side when ``1 + N · T > 0``.

    Parameters
    ----------
    translation, plane, rotated : ArrayLike
        T ``(3,)``, N ``(..., 3)``, pre-rotated unit rays ``(m, 3)`` or ``(..., m, 3)``.
    s_min : float
        Least inverse range allowed; slightly negative to let noise at far planes pass.
    """
    normal, rays = checked(plane, 3, "plane"), checked(rotated, 3, "rotated")
    inverse = np.einsum("...mj,...j->...m", rays, normal)
    height = 1.0 + normal @ checked(translation, 3, "translation")
    return np.asarray((inverse >= s_min).all(axis=-1) & (height > 0.0))


def facing(plane: ArrayLike, rays: ArrayLike) -> Array:
    """Return the cosine between planes' normals N ``(..., 3)`` and unit rays ``(..., 3)``: 1 face on, 0 edge on.

    The plane at infinity, N = 0, faces every ray.
    """
    normal, direction = checked(plane, 3, "plane"), checked(rays, 3, "rays")
    length = np.linalg.norm(normal, axis=-1)
    cosine = (normal * direction).sum(axis=-1) / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, cosine, 1.0)


def too_oblique(plane: ArrayLike, rays: ArrayLike, max_angle_rad: float = np.radians(80.0)) -> Mask:
    """Tell which planes are seen at more than ``max_angle_rad`` off their normal along the rays: not recognisable."""
    return np.asarray(facing(plane, rays) < np.cos(max_angle_rad))
