"""What a match costs per sample: ``python -m tests.bench.budget`` prints samples a second over many sizes of search."""

from __future__ import annotations

import time

import numpy as np

from ptzd.matching import place
from ptzd.matching.budget import PLACING_SAMPLES
from ptzd.matching.job import match
from ptzd.model import Box, Matcher
from tests.matching.conftest import World, make_rig, multi_scale_texture, wall

BANDS_DEG = (0.5, 2.0, 8.0, 20.0)
SIDES_PX = (10, 24, 60)


def main() -> None:
    """Print a row per matcher, side of the box and band."""
    world = World(rig=make_rig(), planes=(wall(multi_scale_texture(0)),))
    work: list[int] = []
    refuse = place.refuse_beyond_budget

    def noted(hypotheses: int, samples: int, budget_s: float) -> None:
        work.append(hypotheses * (samples + PLACING_SAMPLES))
        refuse(hypotheses, samples, budget_s)

    place.refuse_beyond_budget = noted
    print("matcher  box px  band deg  samples    s        samples/s")
    for matcher in Matcher:
        for side in SIDES_PX:
            box = Box(x=300, y=220, w=side, h=side)
            for band in BANDS_DEG:
                inputs = world.inputs(box, world.aimed(box), noise=2.0, band_deg=band, budget_s=np.inf)
                start = time.perf_counter()
                match(inputs, matcher)
                spent = time.perf_counter() - start
                row = f"{matcher:8} {side:6d} {band:9.1f} {work[-1]:10d} {spent:8.3f} {work[-1] / spent:12.3g}"
                print(row)


if __name__ == "__main__":
    main()
