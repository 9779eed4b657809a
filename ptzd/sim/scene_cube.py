"""What one viewpoint sees in every direction: six cube faces of colour, and six of range.

Frames are those of a camera (x right, y down, z forward). A face has the axes (right, down, forward) of
:data:`FACES`; its texel (i, j) of n x n looks along forward + u right + v down with u = (2 j + 1) / n - 1 and
v = (2 i + 1) / n - 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Pixels = NDArray[np.uint8]
Mask = NDArray[np.bool_]

FACES: dict[str, tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]] = {
    "front": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "right": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "back": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "left": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "up": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "down": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}
_APRON_PX = 2
"""Texels borrowed from the neighbours around every face, so that interpolation has no seam."""
_OUTSIDE_PX = -1e4


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourFace:
    """One face as a pyramid; level 0 is the finest, each with an apron of :data:`_APRON_PX` texels."""

    size_px: int
    levels: tuple[Pixels, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class ColourCube:
    """The picture in every direction around one viewpoint."""

    faces: Mapping[str, ColourFace]

    def sample(self, rays: Floats, pixel_angle_rad: float | Floats) -> Pixels:
        """Draw the picture seen along a grid of rays.

        Parameters
        ----------
        rays : (H, W, 3)
            Unit rays.
        pixel_angle_rad : float or (H, W)
            Angle between neighbouring pixels. Detail finer than this is filtered out: one pyramid level for a
            single angle, a blend of two levels for an angle per pixel.

        Returns
        -------
        (H, W, 3) uint8
            BGR.
        """
        out = np.zeros((*rays.shape[:2], 3), np.uint8)
        angles = np.asarray(pixel_angle_rad)
        for name, (rows, columns) in _windows(rays).items():
            face = self.faces[name]
            x, y, z = cv2.split(np.asarray(rays[rows, columns], np.float32))
            u, v, inside = _project(*(_component((x, y, z), axis) for axis in FACES[name]))
            view = out[rows, columns]
            ratio = (angles if angles.ndim == 0 else angles[rows, columns]) * (face.size_px / 2)
            if ratio.ndim == 0:
                level = int(np.clip(round(float(np.log2(max(float(ratio), 1e-9)))), 0, len(face.levels) - 1))
                _draw(face.levels[level], u, v, inside, view)
            elif inside.any():
                _draw_blended(face, ratio, u, v, inside, view)
        return out


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthCube:
    """The range of the first surface in every direction around one viewpoint."""

    faces: Mapping[str, Floats]
    """(n + 4, n + 4) per face: 1 / (distance along the face's forward axis), per metre, affine in u, v on a plane,
    with two texels on each side that continue it in a straight line."""

    def inverse_range(self, rays: Floats) -> Floats:
        """Inverse range along rays, exact on planes and never a mixture of two surfaces.

        Where the texels around the ray continue one surface they are interpolated; at an edge the nearest counts.

        Parameters
        ----------
        rays : (N, 3)
            Unit rays.

        Returns
        -------
        (N,)
            1 / range, per metre.
        """
        rays = np.asarray(rays, np.float64)
        out = np.zeros(len(rays))
        for name, here, row, col in self._texels(rays):
            patch = _neighbourhood(self.faces[name], row, col)
            out[here] = _interpolate_on_surface(patch, row - np.floor(row), col - np.floor(col))
            out[here] *= rays[here] @ np.asarray(FACES[name][2], np.float64)
        return out

    def farthest_nearby(self, rays: Floats) -> Floats:
        """Smallest inverse range, per metre, of the four texels around each of the (N, 3) rays."""
        rays = np.asarray(rays, np.float64)
        out = np.zeros(len(rays))
        for name, here, row, col in self._texels(rays):
            patch = _neighbourhood(self.faces[name], row, col)
            out[here] = patch[:, 1:3, 1:3].min(axis=(1, 2)) * (rays[here] @ np.asarray(FACES[name][2], np.float64))
        return out

    def _texels(self, rays: Floats) -> list[tuple[str, NDArray[np.intp], Floats, Floats]]:
        """Rays by face: its name, which rays, and their continuous texel rows and columns."""
        axes = np.array([forward for _, _, forward in FACES.values()], np.float64)
        owner = np.argmax(rays @ axes.T, axis=1)
        found = []
        for k, (name, (right, down, forward)) in enumerate(FACES.items()):
            here = np.flatnonzero(owner == k)
            n = self.faces[name].shape[0] - 4
            depth = rays[here] @ np.asarray(forward, np.float64)
            col = (rays[here] @ np.asarray(right, np.float64) / depth + 1) * n / 2 - 0.5
            row = (rays[here] @ np.asarray(down, np.float64) / depth + 1) * n / 2 - 0.5
            found.append((name, here, row, col))
        return found


def colour_cube(pictures: Mapping[str, Pixels]) -> ColourCube:
    """Build the pyramids and aprons from six square BGR pictures, one per name in :data:`FACES`."""
    stacks: dict[str, list[Pixels]] = {}
    for name, picture in pictures.items():
        stacks[name] = [picture]
        while stacks[name][-1].shape[0] >= 32 and stacks[name][-1].shape[0] % 2 == 0:
            half = stacks[name][-1].shape[0] // 2
            stacks[name].append(np.asarray(cv2.resize(stacks[name][-1], (half, half), interpolation=cv2.INTER_AREA)))
    faces = {
        name: ColourFace(
            size_px=stack[0].shape[0],
            levels=tuple(_with_apron(name, level, stacks) for level in stack),
        )
        for name, stack in stacks.items()
    }
    return ColourCube(faces=faces)


def depth_cube(inverse_depths: Mapping[str, Floats]) -> DepthCube:
    """Build the cube from six (n, n) faces of 1 / (distance along the face's forward axis), per metre."""
    return DepthCube(
        faces={name: np.pad(face, 2, mode="reflect", reflect_type="odd") for name, face in inverse_depths.items()}
    )


def face_rays(name: str, size_px: int) -> Floats:
    """Unit rays of a face's texels, (size_px, size_px, 3)."""
    right, down, forward = (np.asarray(axis, np.float64) for axis in FACES[name])
    t = (2 * np.arange(size_px) + 1) / size_px - 1
    rays = forward + t[None, :, None] * right + t[:, None, None] * down
    return np.asarray(rays / np.linalg.norm(rays, axis=-1, keepdims=True))


def _windows(rays: Floats) -> dict[str, tuple[slice, slice]]:
    """Rows and columns of the grid that can hold a face's pixels, found on every eighth ray with a margin."""
    step = 8
    height, width = rays.shape[:2]
    i = np.unique(np.append(np.arange(0, height, step), height - 1))
    j = np.unique(np.append(np.arange(0, width, step), width - 1))
    coarse = np.asarray(rays[np.ix_(i, j)], np.float32)
    steps = [float(np.abs(np.diff(coarse, axis=axis)).max(initial=0)) for axis in (0, 1)]
    reach = max(0.03, 3 * max(steps))
    found = {}
    for name, axes in FACES.items():
        right, down, forward = (_component((coarse[..., 0], coarse[..., 1], coarse[..., 2]), axis) for axis in axes)
        near = (np.maximum(np.abs(right), np.abs(down)) <= forward + reach) & (forward > 0.57 - reach)
        if near.any():
            r = np.flatnonzero(near.any(axis=1))
            c = np.flatnonzero(near.any(axis=0))
            rows = slice(max(int(i[r[0]]) - step, 0), int(i[r[-1]]) + step + 1)
            found[name] = rows, slice(max(int(j[c[0]]) - step, 0), int(j[c[-1]]) + step + 1)
    return found


def _component(xyz: tuple[Any, Any, Any], axis: tuple[int, int, int]) -> Floats:
    index = int(np.flatnonzero(axis)[0])
    part = xyz[index]
    return np.asarray(part if axis[index] > 0 else -part)


def _project(right: Floats, down: Floats, forward: Floats) -> tuple[Floats, Floats, Mask]:
    """Face coordinates u, v in -1..1 and which rays belong to the face."""
    safe = np.maximum(forward, np.float32(0.1))
    u = right / safe
    v = down / safe
    return u, v, (forward > 0.5) & (np.maximum(np.abs(u), np.abs(v)) <= np.float32(1.0 + 1e-5))


def _draw(level: Pixels, u: Floats, v: Floats, inside: Mask, out: Pixels) -> None:
    n = level.shape[0] - 2 * _APRON_PX
    half = np.float32(n / 2)
    shift = np.float32(n / 2 - 0.5 + _APRON_PX)
    columns = np.where(inside, u * half + shift, np.float32(_OUTSIDE_PX))
    rows = v * half + shift
    cv2.remap(level, columns, rows, cv2.INTER_LINEAR, dst=out, borderMode=cv2.BORDER_TRANSPARENT)


def _draw_blended(face: ColourFace, ratio: Floats, u: Floats, v: Floats, inside: Mask, out: Pixels) -> None:
    wanted = np.clip(np.log2(np.maximum(ratio, 1e-9)), 0, len(face.levels) - 1)
    low, high = int(wanted[inside].min()), int(np.ceil(wanted[inside].max()))
    total = np.zeros((*u.shape, 3), np.float32)
    drawn = np.zeros((*u.shape, 3), np.uint8)
    for k in range(low, high + 1):
        _draw(face.levels[k], u, v, inside, drawn)
        total += np.maximum(0, 1 - np.abs(wanted - k)).astype(np.float32)[..., None] * drawn
    out[inside] = np.round(total[inside]).astype(np.uint8)


def _with_apron(name: str, level: Pixels, stacks: Mapping[str, list[Pixels]]) -> Pixels:
    """Copy a level into a frame of texels taken from the neighbours at the resolution next to its own."""
    n = level.shape[0]
    bordered = np.pad(level, ((_APRON_PX, _APRON_PX), (_APRON_PX, _APRON_PX), (0, 0)), mode="edge")
    ring = np.ones(bordered.shape[:2], np.bool_)
    ring[_APRON_PX:-_APRON_PX, _APRON_PX:-_APRON_PX] = False
    row, column = ((2 * (part - _APRON_PX) + 1) / n - 1 for part in np.nonzero(ring))
    right, down, forward = (np.asarray(axis, np.float64) for axis in FACES[name])
    rays = forward + column[:, None] * right + row[:, None] * down
    x, y, z = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32).T
    line = np.ascontiguousarray(bordered[ring][:, None, :])
    sides = (4 * _APRON_PX, -1)  # OpenCV takes less than 32,767 places in a row or column; the ring has more
    for other, (right_axis, down_axis, forward_axis) in FACES.items():
        if other == name:
            continue
        parts = (_component((x, y, z), axis) for axis in (right_axis, down_axis, forward_axis))
        u, v, inside = _project(*parts)
        source = min(stacks[other], key=lambda picture: abs(picture.shape[0] - n))
        m = source.shape[0]
        columns = np.where(inside, (u + 1) * (m / 2) - 0.5, _OUTSIDE_PX).astype(np.float32)
        rows = ((v + 1) * (m / 2) - 0.5).astype(np.float32)
        found = np.asarray(
            cv2.remap(source, columns.reshape(sides), rows.reshape(sides), cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
        ).reshape(line.shape)
        line[inside] = found[inside]
    bordered[ring] = line[:, 0]
    return bordered


def _neighbourhood(wide: Floats, row: Floats, col: Floats) -> Floats:
    """The (N, 4, 4) texels around continuous positions."""
    i = np.floor(row).astype(np.intp) + 1
    j = np.floor(col).astype(np.intp) + 1
    k = np.arange(4)
    return np.asarray(wide[i[:, None, None] + k[:, None], j[:, None, None] + k])


def _interpolate_on_surface(patch: Floats, row: Floats, col: Floats) -> Floats:
    """Bilinear in the middle cell where all its sides continue a neighbouring slope, else the nearest texel."""
    tolerance = 3e-4 + 1e-3 * patch[:, 1:3, 1:3].mean(axis=(1, 2))
    across = np.diff(patch[:, 1:3, :], axis=2)
    along = np.diff(patch[:, :, 1:3], axis=1).transpose(0, 2, 1)
    slopes = np.concatenate((across, along), axis=1)
    kink = np.minimum(np.abs(slopes[..., 1] - slopes[..., 0]), np.abs(slopes[..., 1] - slopes[..., 2]))
    smooth = kink.max(axis=1) < tolerance
    wr = np.where(smooth, row, np.round(row))
    wc = np.where(smooth, col, np.round(col))
    top = patch[:, 1, 1] * (1 - wc) + patch[:, 1, 2] * wc
    bottom = patch[:, 2, 1] * (1 - wc) + patch[:, 2, 2] * wc
    return np.asarray(top * (1 - wr) + bottom * wr)
