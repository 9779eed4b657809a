"""Time of one match and how it grows with the region, the band, the range, the fisheye, the view, the number of views.

    python -m tests.bench.timing [--write]

One core, JPEG decoding apart. Of every region the least of some runs counts, since a busy machine only ever adds; shown
is the median over the regions. Each row is run by turns with the base, which gives its ratio; the milliseconds are this
ratio times the least time of the base. Base: 40-px boxes, fisheye and one view 640x480, 60°, band ±1°, 0.8 to 100 m.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2

from ptzd.geometry.rig import Rig
from ptzd.geometry.zoom import ZoomTable
from ptzd.jpeg.pixels import decode_grey
from ptzd.matching.job import match
from ptzd.model import Matcher
from tests.bench import own, report
from tests.bench.cases import Case, Condition, make_case
from tests.bench.stage import stage

SCENE = "room"
REGIONS = (0, 3, 9, 12, 18)
RUNS = 7
TARGET_MS = 10.0
BASE = Condition(name="base", side_px=40, aimed_deg=4.0)


def base_cases(condition: Condition = BASE) -> list[Case]:
    """The same regions under a condition; those for which it has no room are left out."""
    s = stage(SCENE)
    return [case for index in REGIONS if (case := make_case(s, index, condition)) is not None]


def side_by_side_ms(*variants: tuple[Sequence[Case], int], matcher: Matcher = Matcher.SWEEP) -> list[float]:
    """Milliseconds of processor time of each variant (regions, and how many views of each), run by turns."""
    asked = [[(own.inputs(case, 0), views) for case in cases] for cases, views in variants]
    least = [[float("inf")] * len(row) for row in asked]
    for _ in range(RUNS):
        for row, best in zip(asked, least, strict=True):
            for k, (inputs, views) in enumerate(row):
                start = time.process_time_ns()
                for _ in range(views):
                    match(inputs, matcher)
                best[k] = min(best[k], (time.process_time_ns() - start) / 1e6)
    return [statistics.median(best) for best in least]


def larger_view(case: Case, factor: int) -> Case:
    """The same view with more pixels."""
    (reading, picture), rig = case.views[0], case.rig
    size = (picture.shape[1] * factor, picture.shape[0] * factor)
    entries = tuple(
        replace(e, fx=e.fx * factor, fy=e.fy * factor, cx=(e.cx + 0.5) * factor - 0.5, cy=(e.cy + 0.5) * factor - 0.5)
        for e in rig.zoom.entries
    )
    larger: Rig = replace(rig, zoom=ZoomTable(size_px=size, entries=entries))
    return replace(case, rig=larger, views=[(reading, cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC))])


def decoding_ms(case: Case) -> float:
    jpeg = cv2.imencode(".jpg", case.views[0][1])[1].tobytes()
    start = time.process_time_ns()
    for _ in range(20):
        decode_grey(jpeg)
    return (time.process_time_ns() - start) / 1e6 / 20


def lines() -> list[list[str]]:
    """What is changed, the milliseconds of `sweep`, and their ratio to the base."""
    cases = base_cases()
    grown: list[tuple[str, Callable[[], tuple[Sequence[Case], int]]]] = [
        *((f"region {side} px", _of(side_px=side)) for side in (8, 16, 24, 64, 100)),
        *(
            (f"region {side} px, fisheye 1280×960", _of(side_px=side, fisheye_px=(1280, 960)))
            for side in (40, 200, 400)
        ),
        *((f"band ±{band}°", _of(band_deg=band)) for band in (0.3, 0.5, 2.0, 3.0)),
        ("range known to 10 %", _of(narrow=0.1)),
        ("range 0.3 m to infinity", _of(range_m=(0.3, 1e6))),
        *((f"view {640 * k}×{480 * k}", lambda k=k: ([larger_view(case, k) for case in cases], 1)) for k in (2, 3)),
        *((f"{count} views", lambda count=count: (cases, count)) for count in (2, 4)),
    ]
    bases, ratios = [side_by_side_ms((cases, 1))[0]], {"base": 1.0}
    for name, made in grown:
        chosen, views = made()
        if chosen:
            base, spent = side_by_side_ms((cases, 1), (chosen, views))
            bases.append(base)
            ratios[name] = spent / base
    rows = [[name, f"{ratio * min(bases):.1f}", f"{ratio:.2f}"] for name, ratio in ratios.items()]
    return [["changed", "ms", "× base"], *rows]


def _of(**changes: object) -> Callable[[], tuple[Sequence[Case], int]]:
    return lambda: (base_cases(replace(BASE, **changes)), 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="into docs/accuracy.md")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    cases = base_cases()
    harris, decoding = side_by_side_ms((cases, 1), matcher=Matcher.HARRIS)[0], decoding_ms(cases[0])
    beside = f"`harris`: {harris:.1f} ms. Decoding the view's JPEG: {decoding:.1f} ms."
    text = f"{report.markdown(lines())}\n\nTarget of the base: {TARGET_MS:g} ms. {beside}"
    print(text)
    if args.write:
        report.replace(report.PAGE, "times", text)


if __name__ == "__main__":
    main()
