"""How alike the region and the PTZ's pixels are under many hypotheses at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Floats

if TYPE_CHECKING:
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import Samples


BLOCKS_PER_SIDE = 3
REVERSED_PENALTY = 0.9
"""A region that matches only with its contrast reversed (infrared) has to be that much better."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """What of a patch does not change from one hypothesis to the next."""

    patch: Patch
    blocks: Floats
    """(n, b) membership of a sample in a block, times its weight."""
    moments: Floats
    """(n, 3 b): blocks, blocks x grey, blocks x grey²."""
    orientation: Floats
    """(2, n) unit vector of the doubled angle of the gradient."""
    orientation_weight: Floats
    """(n,) weight of each sample in the orientation channel, sums to 1."""
    variance_floor: float
    """Grey levels²: variance that noise alone leaves after the low-pass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Similarities of k hypotheses, all (k,)."""

    total: Floats
    in_view: Floats


def make_template(patch: Patch, noise: float) -> Template:
    """Prepare a patch for scoring.

    Parameters
    ----------
    patch : Patch
        With grey values less a constant near their mean for precision.
    noise : float
        One sigma of a sample's noise, grey levels.
    """
    rows, columns = patch.shape
    of_row = np.minimum(np.arange(rows) * BLOCKS_PER_SIDE // rows, BLOCKS_PER_SIDE - 1)
    of_column = np.minimum(np.arange(columns) * BLOCKS_PER_SIDE // columns, BLOCKS_PER_SIDE - 1)
    block = (of_row[:, None] * BLOCKS_PER_SIDE + of_column[None, :]).ravel()
    blocks = np.zeros((block.size, BLOCKS_PER_SIDE**2), np.float32)
    blocks[np.arange(block.size), block] = patch.weight
    grey = patch.grey[:, None]
    floor = noise * noise
    vectors, strength = _orientation(patch.grey[None], patch.shape, floor)
    weight = patch.weight * strength[0]
    directions = vectors[:, 0] / np.maximum(strength, 1e-6)
    total = float(weight.sum())
    return Template(
        patch=patch,
        blocks=blocks,
        moments=np.concatenate([blocks, blocks * grey, blocks * grey * grey], axis=1),
        orientation=directions,
        orientation_weight=(weight / total if total > 0 else weight).astype(np.float32),
        variance_floor=floor,
    )


def score(template: Template, samples: Samples) -> Scores:
    """Compare a region with k warped pieces of the view.

    Returns
    -------
    Scores
        The mean of three similarities: zero-mean normalised correlation over the whole patch, over blocks (each with
        its own gain and offset, so that an occluder or a shade spoils only its own), and of gradient directions with
        the sign dropped. Correlations of reversed contrast count with a penalty.
    """
    inside = samples.inside.astype(np.float32)
    whole, blockwise, in_view = _correlations(template, samples.grey, inside)
    alike = _orientation_score(template, samples.grey, inside)
    upright = whole + np.maximum(blockwise, 0.0).sum(axis=1)
    turned = -whole + np.maximum(-blockwise, 0.0).sum(axis=1)
    total = (np.maximum(upright, REVERSED_PENALTY * turned) + alike) / 3.0
    return Scores(total=total, in_view=in_view)


def _correlations(template: Template, grey: Floats, inside: Floats) -> tuple[Floats, Floats, Floats]:
    count = template.blocks.shape[1]
    reference = inside @ template.moments
    weight, first, second = reference[:, :count], reference[:, count : 2 * count], reference[:, 2 * count :]
    masked = grey * inside
    seen = masked @ template.blocks
    squared = (masked * grey) @ template.blocks
    product = masked @ template.moments[:, count : 2 * count]
    floor = template.variance_floor
    total = weight.sum(axis=1)
    whole = _ncc(total, first.sum(1), second.sum(1), seen.sum(1), squared.sum(1), product.sum(1), floor)
    local = _ncc(weight, first, second, seen, squared, product, floor)
    safe = np.maximum(weight, 1e-6)
    spread = np.maximum(second / safe - (first / safe) ** 2, 0.0)
    trust = weight * spread / (spread + 4.0 * floor)
    return whole, local * trust / np.maximum(trust.sum(axis=1, keepdims=True), 1e-6), total


def _ncc(
    weight: Floats, first: Floats, second: Floats, seen: Floats, squared: Floats, product: Floats, floor: float
) -> Floats:
    safe = np.maximum(weight, 1e-6)
    mean_f, mean_i = first / safe, seen / safe
    variance_f = np.maximum(second / safe - mean_f * mean_f, 0.0) + floor
    variance_i = np.maximum(squared / safe - mean_i * mean_i, 0.0) + floor
    return (product / safe - mean_f * mean_i) / np.sqrt(variance_f * variance_i)


def _orientation_score(template: Template, grey: Floats, inside: Floats) -> Floats:
    vectors, _ = _orientation(grey, template.patch.shape, template.variance_floor)
    weighted = inside * template.orientation_weight
    agreement = vectors[0] * template.orientation[0] + vectors[1] * template.orientation[1]
    return np.asarray((agreement * weighted).sum(axis=1) / np.maximum(weighted.sum(axis=1), 1e-6))


def _orientation(grey: Floats, shape: tuple[int, int], floor: float) -> tuple[Floats, Floats]:
    """Doubled gradient angles (2, k, n) shortened where the gradient drowns in noise, and that shortening (k, n)."""
    grid = grey.reshape(-1, *shape)
    gx, gy = np.zeros_like(grid), np.zeros_like(grid)
    gx[:, :, 1:-1] = grid[:, :, 2:] - grid[:, :, :-2]
    gy[:, 1:-1, :] = grid[:, 2:, :] - grid[:, :-2, :]
    gx[:, 0] = gx[:, -1] = 0.0
    gy[:, :, 0] = gy[:, :, -1] = 0.0
    square_x, square_y = gx * gx, gy * gy
    power = square_x + square_y
    scale = 1.0 / (power + 8.0 * floor)
    vectors = np.stack([(square_x - square_y) * scale, 2.0 * gx * gy * scale])
    return vectors.reshape(2, len(grid), -1), (power * scale).reshape(len(grid), -1)
