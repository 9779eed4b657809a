"""The conditions under which every region is tried."""

from __future__ import annotations

from tests.bench import spoil
from tests.bench.cases import Condition

PAPER_VARIANCES = {5.1: "7.01", 10.2: "3.96", 15.3: "5.13", 20.4: "5.66", 25.5: "5.04", 30.6: "4.62", 35.7: "6.07"}
"""Table 2 of the paper: variance of the noise and error in degrees; 6.89° without noise."""
SIDES_PX = (8, 12, 16, 24, 40, 64, 100)
LARGE_SIDES_PX = (200, 400)
FISHEYES_PX = ((1280, 960), (2048, 1536), (3072, 3072))
EXTRA = 2
"""Rows beyond the paper's get every second region."""
INF_M = 1e6

CONDITIONS: tuple[Condition, ...] = (
    Condition(name="clean", others=True),
    *(Condition(name=f"noise var {v}", noise=v**0.5, others=v in {10.2, 35.7}) for v in PAPER_VARIANCES),
    Condition(name="noise sigma 25", noise=25.0, others=True),
    Condition(name="noise sigma 35.7", noise=35.7),
    *(Condition(name=f"hfov {h}", hfov_deg=float(h), others=h in {40, 80}) for h in (40, 50, 65, 80)),
    Condition(name="zoom x5", hfov_deg=13.2, aimed_deg=1.0, others=True),
    Condition(name="light mild", light=spoil.mild_light),
    Condition(name="light strong", light=spoil.strong_light, others=True),
    Condition(name="light bright", light=spoil.bright_light, others=True),
    Condition(name="contrast reversed", light=spoil.reversed_contrast, others=True),
    *(Condition(name=f"occlusion {p} %", occlusion=p / 100, others=p in {30, 50}) for p in (10, 20, 30, 40, 50)),
    Condition(name="extrinsics 0.2", extrinsics_deg=0.2),
    Condition(name="extrinsics 0.7", extrinsics_deg=0.7, others=True),
    Condition(name="extrinsics 1.0", extrinsics_deg=1.0, band_deg=1.3),
    Condition(name="extrinsics 2.0", extrinsics_deg=2.0, band_deg=2.5),
    Condition(name="absent", absent=True, others=True),
    Condition(name="blank", blank=True, noise=2.0),
    Condition(name="doubled", doubled=True, hfov_deg=80.0, aimed_deg=2.0, others=True),
    Condition(name="verify", every=EXTRA, hfov_deg=40.0, aimed_deg=0.3, narrow=0.1, band_deg=0.4),
    Condition(name="verify zoomed", every=EXTRA, hfov_deg=13.2, aimed_deg=0.3, narrow=0.1, band_deg=0.4),
    Condition(name="verify absent", absent=True, hfov_deg=40.0, aimed_deg=0.3, narrow=0.1, band_deg=0.4),
    *(Condition(name=f"box {side}", every=EXTRA, side_px=side) for side in SIDES_PX),
    *(Condition(name=f"box {side}", every=EXTRA, side_px=side, fisheye_px=(1280, 960)) for side in LARGE_SIDES_PX),
    *(Condition(name=f"fisheye {w}x{h}", every=EXTRA, fisheye_px=(w, h)) for w, h in FISHEYES_PX),
    Condition(name="range 0.3 m to infinity", every=EXTRA, range_m=(0.3, INF_M)),
    Condition(name="range known to 10 %", every=EXTRA, narrow=0.1),
    Condition(name="region at the view's border", every=EXTRA, border=True),
)
QUICK = ("clean", "noise var 20.4", "zoom x5", "light strong", "occlusion 30 %", "extrinsics 0.7", "absent", "doubled")
"""For a developer's look."""
OTHERS_EVERY = 4
"""`harris` and the peers get every fourth region, in the conditions marked for them: they take ten times as long."""
