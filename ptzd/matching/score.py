"""How alike the region and the PTZ's pixels are under many hypotheses at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ptzd.matching.arrays import Floats

if TYPE_CHECKING:
    from ptzd.matching.patch import Patch
    from ptzd.matching.view import Samples

BLOCK_STEPS = 8
"""Side of a block in grid steps, about; a patch has 2 x 2 to 4 x 4 of them."""
REVERSED_PENALTY = 0.9
"""A region that matches only with its contrast reversed (infrared) has to be that much better."""
LEAST_SIGNAL = 0.3
"""Share of a variance that is kept as signal however large the noise is said to be."""
FLAT = 0.1
"""Variance, grey levels², below which a block carries nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Template:
    """What of a patch does not change from one hypothesis to the next."""

    patch: Patch
    blocks: Floats
    """(n, b) membership of a sample in a block, times its weight."""
    moments: Floats
    """(n, 3 b): blocks, blocks x grey, blocks x grey²."""
    direction: Floats
    """(2, rows - 2, columns - 2) unit vector of the doubled angle of the patch's gradient."""
    edge_weight: Floats
    """(rows - 2, columns - 2) weight of each sample in the channel of directions."""
    noise: tuple[float, float]
    """Variance of a sample from noise, grey levels²: of the patch and of the view."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scores:
    """Similarities of k hypotheses, all (k,)."""

    total: Floats
    in_view: Floats


def make_template(patch: Patch, noise: tuple[float, float]) -> Template:
    """Prepare a patch for scoring.

    Parameters
    ----------
    patch : Patch
        The region.
    noise : (float, float)
        One sigma of a sample's noise in the patch and in the view, grey levels.
    """
    rows, columns = patch.shape
    blocks = _blocks(rows, columns) * patch.weight[:, None]
    grey = patch.grey[:, None]
    across, down = _gradients(patch.grey.reshape(1, rows, columns))
    power = (across * across + down * down)[0]
    floor = 8.0 * noise[0] ** 2
    doubled = np.concatenate([across * across - down * down, 2.0 * across * down])
    weight = patch.weight.reshape(rows, columns)[1:-1, 1:-1]
    return Template(
        patch=patch,
        blocks=blocks,
        moments=np.concatenate([blocks, blocks * grey, blocks * grey * grey], axis=1),
        direction=doubled / np.maximum(power, 1e-6),
        edge_weight=weight * power / (power + floor),
        noise=(noise[0] ** 2, noise[1] ** 2),
    )


def score(template: Template, samples: Samples) -> Scores:
    """Compare a region with k warped pieces of the view.

    Returns
    -------
    Scores
        The mean of two similarities. The first: correlation block by block, each block with its own gain and offset,
        so that an occluder or a shade spoils only its own; noise is taken out of the variances, so that the same
        surface scores alike in good and bad light. The second: agreement of gradient directions with the sign
        dropped. Correlations of reversed contrast count with a penalty.
    """
    inside = None if samples.inside.all() else samples.inside.astype(np.float32)
    upright, turned, in_view = _block_correlation(template, samples.grey, inside)
    alike = _direction_agreement(template, samples.grey, inside)
    return Scores(total=(np.maximum(upright, REVERSED_PENALTY * turned) + alike) / 2.0, in_view=in_view)


def _blocks(rows: int, columns: int) -> Floats:
    along, across = (min(max(round(side / BLOCK_STEPS), 2), 4) for side in (rows, columns))
    of_row = np.arange(rows) * along // rows
    of_column = np.arange(columns) * across // columns
    block = (of_row[:, None] * across + of_column[None, :]).ravel()
    return np.asarray(np.equal(block[:, None], np.arange(along * across)), dtype=np.float32)


def _block_correlation(template: Template, grey: Floats, inside: Floats | None) -> tuple[Floats, Floats, Floats]:
    """Weighted means over blocks of the positive and of the negative correlation, and the share in view, (k,)."""
    blocks, moments = template.blocks, template.moments
    count = blocks.shape[1]
    masked = grey if inside is None else grey * inside
    reference = moments.sum(axis=0)[None] if inside is None else inside @ moments
    weight = np.maximum(reference[:, :count], 1e-9)
    mean_f = reference[:, count : 2 * count] / weight
    variance_f = np.maximum(reference[:, 2 * count :] / weight - mean_f * mean_f, 0.0)
    product = masked @ moments[:, : 2 * count]
    mean_i = product[:, :count] / weight
    variance_i = np.maximum((masked * grey) @ blocks / weight - mean_i * mean_i, 0.0)
    covariance = product[:, count:] / weight - mean_f * mean_i
    noise_f, noise_i = template.noise
    signal_f = np.maximum(variance_f - noise_f, LEAST_SIGNAL * variance_f) + FLAT
    signal_i = np.maximum(variance_i - noise_i, LEAST_SIGNAL * variance_i) + FLAT
    correlation = np.clip(covariance / np.sqrt(signal_f * signal_i), -1.0, 1.0)
    trust = reference[:, :count] * variance_f / (variance_f + 4.0 * noise_f)
    total = np.maximum(trust.sum(axis=1), 1e-9)
    upright = (trust * np.maximum(correlation, 0.0)).sum(axis=1) / total
    turned = (trust * np.maximum(-correlation, 0.0)).sum(axis=1) / total
    return upright, turned, np.broadcast_to(reference[:, :count].sum(axis=1), (len(grey),))


def _direction_agreement(template: Template, grey: Floats, inside: Floats | None) -> Floats:
    """Mean of cos 2(difference of gradient angles) over samples where both have a gradient, (k,)."""
    rows, columns = template.patch.shape
    across, down = _gradients(grey.reshape(-1, rows, columns))
    square_x, square_y = across * across, down * down
    power = square_x + square_y
    weight = template.edge_weight / (power + 8.0 * template.noise[1])
    if inside is not None:
        weight = weight * inside.reshape(-1, rows, columns)[:, 1:-1, 1:-1]
    cosine, sine = template.direction
    agreement = (square_x - square_y) * cosine + (2.0 * across * down) * sine
    total = np.einsum("kij,kij->k", weight, power)
    return np.asarray(np.einsum("kij,kij->k", weight, agreement) / np.maximum(total, 1e-9))


def _gradients(grid: Floats) -> tuple[Floats, Floats]:
    """Central differences of (k, rows, columns) in the interior, over two steps."""
    return grid[:, 1:-1, 2:] - grid[:, 1:-1, :-2], grid[:, 2:, 1:-1] - grid[:, :-2, 1:-1]
