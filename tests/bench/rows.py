"""The rows of the accuracy table: which answers belong to each, what the paper reports, what is aimed at."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.bench.conditions import FISHEYES_PX, LARGE_SIDES_PX, PAPER_VARIANCES, SIDES_PX
from tests.bench.real import REAL

Record = dict[str, object]
TUNING = ("room", "yard")
HELD_OUT = ("warehouse",)
SEEN = "picture only"
CERTAIN = 0.9


@dataclass(frozen=True, kw_only=True)
class Target:
    """A bound on one figure of `Figures`."""

    figure: str
    bound: float
    least: bool = False
    """Whether the bound is a lower one."""

    def missed_by(self, value: float) -> float:
        """How far a value is on the wrong side; 0 when it is met or there is nothing to judge."""
        if not np.isfinite(value) and self.figure != "median":
            return 0.0
        return max(0.0, self.bound - value if self.least else value - self.bound)

    def __str__(self) -> str:
        sign = "≥" if self.least else "≤"
        names = {"median": "", "within": " within 1°", "found": " found", "wrong": " wrong", "certain": " right"}
        value = f"{self.bound:g}°" if self.figure == "median" else f"{self.bound:.0%}"
        return f"{sign} {value}{names[self.figure]}"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table."""

    name: str
    conditions: tuple[str, ...] = ()
    """Empty: all of them."""
    kinds: tuple[str, ...] = ()
    scenes: tuple[str, ...] = (*TUNING, *HELD_OUT)
    paper: str = "–"
    targets: tuple[Target, ...] = ()
    certain: bool = False
    """Only answers with a probability of at least `CERTAIN`."""

    def select(self, records: Iterable[Record], matcher: str, scenes: Sequence[str]) -> list[Record]:
        """Answers of a matcher on some scenes that belong to the row."""
        return [
            r
            for r in records
            if r["matcher"] == matcher
            and r["scene"] in scenes
            and r["scene"] in self.scenes
            and (not self.conditions or r["condition"] in self.conditions)
            and (not self.kinds or r["kind"] in self.kinds)
            and (not self.certain or float(r.get("probability", 0.0)) >= CERTAIN)
        ]


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What a row comes to. NaN where nothing could be judged."""

    count: int
    median: float
    """Of the error, degrees; no answer counts as infinite."""
    within: float
    """Share within 1° of those that can be seen."""
    found: float
    """Share answered `found` of those that can be seen."""
    wrong: float
    """Share of all that was answered `found` and is more than 3° off, or not there at all."""
    certain: float
    """Share within 1° of all answers, present or not."""

    @classmethod
    def of(cls, rows: Sequence[Record]) -> Figures:
        """Sum up answers."""
        present = [r for r in rows if r["present"]]
        errors = np.array([np.inf if r["error_deg"] is None else r["error_deg"] for r in present], dtype=float)
        right = sum(r["error_deg"] is not None and float(r["error_deg"]) <= 1.0 for r in rows)
        nothing = float("nan")
        return cls(
            count=len(rows),
            median=float(np.median(errors)) if present else nothing,
            within=float((errors <= 1.0).mean()) if present else nothing,
            found=float(np.mean([bool(r["found"]) for r in present])) if present else nothing,
            wrong=float(np.mean([bool(r["wrong"]) for r in rows])) if rows else nothing,
            certain=right / len(rows) if rows else nothing,
        )


def _median(bound: float) -> tuple[Target, ...]:
    return (Target(figure="median", bound=bound),)


SURE = (Target(figure="wrong", bound=0.01),)
LIGHT = (*_median(0.15), Target(figure="found", bound=0.95, least=True))
HIDDEN = (Target(figure="within", bound=0.95, least=True),)
NOISES = tuple(f"noise var {v}" for v in PAPER_VARIANCES)
HFOVS = tuple(f"hfov {h}" for h in (40, 50, 65, 80))

ROWS: tuple[Row, ...] = (
    Row(name="planar", conditions=("clean",), kinds=("planar",), paper="0.58°", targets=_median(0.05)),
    Row(name="slightly planar", conditions=("clean",), kinds=("slightly_planar",), paper="0.60°", targets=_median(0.1)),
    Row(name="non-planar", conditions=("clean",), kinds=("non_planar",), paper="7.34°", targets=_median(0.5)),
    Row(name="mostly another surface's", conditions=("clean",), kinds=("occluded",)),
    Row(name="small, 14–20 px", conditions=("clean",), kinds=("small",)),
    Row(name="weak texture", conditions=("clean",), kinds=("weak_texture",)),
    Row(name="repetitive", conditions=("clean",), kinds=("repetitive",)),
    Row(name="noise variance 0: all regions", conditions=("clean",), paper="6.89°", targets=_median(0.1)),
    *(
        Row(name=f"noise variance {v}", conditions=(f"noise var {v}",), paper=f"{paper}°", targets=_median(0.1))
        for v, paper in PAPER_VARIANCES.items()
    ),
    Row(name="noise σ 25 (variance 625)", conditions=("noise sigma 25",)),
    Row(name="noise σ 35.7: the paper's figure as σ", conditions=("noise sigma 35.7",), paper="6.07°"),
    *(
        Row(name=f"HFOV {h}°", conditions=(f"hfov {h}",), paper="2.5–4°", targets=_median(0.1))
        for h in (40, 50, 65, 80)
    ),
    Row(name="zoom ×5", conditions=("zoom x5",), paper=SEEN, targets=_median(0.1)),
    Row(name="light: gain 0.8, gamma 1.4, ramp ±30 %", conditions=("light mild",), paper=SEEN, targets=LIGHT),
    Row(name="light: gain 0.6, gamma 2.2, ramp ±60 %", conditions=("light strong",), paper=SEEN, targets=LIGHT),
    Row(name="overexposed: gain 1.8, gamma 0.6", conditions=("light bright",), paper=SEEN, targets=LIGHT),
    Row(name="contrast reversed", conditions=("contrast reversed",), targets=LIGHT),
    *(
        Row(name=f"occlusion {p} %", conditions=(f"occlusion {p} %",), paper=SEEN, targets=HIDDEN if p <= 30 else ())
        for p in (10, 20, 30, 40, 50)
    ),
    *(
        Row(name=f"extrinsics wrong by {a}°", conditions=(f"extrinsics {a}",), targets=_median(0.2))
        for a in ("0.2", "0.7", "1.0", "2.0")
    ),
    Row(name="absent from the views", conditions=("absent",), targets=SURE),
    Row(name="absent, while a lock is verified", conditions=("verify absent",), targets=SURE),
    Row(name="texture-free: blank and noise", conditions=("blank",), targets=SURE),
    Row(name="texture-free surfaces of the scenes", conditions=("clean",), kinds=("texture_free",), targets=SURE),
    Row(name="repeated: a perfect copy on the arc", conditions=("doubled",), targets=SURE),
    Row(name="real: motorcycle", scenes=(REAL[0],)),
    Row(name="real: 360° pair, hall", scenes=(REAL[1],)),
    Row(name="real: 360° pair, room", scenes=(REAL[2],)),
    *(Row(name=f"box {p}×{p}, fisheye 640×480", conditions=(f"box {p}",)) for p in SIDES_PX),
    *(Row(name=f"box {p}×{p}, fisheye 1280×960", conditions=(f"box {p}",)) for p in LARGE_SIDES_PX),
    *(Row(name=f"fisheye {w}×{h}", conditions=(f"fisheye {w}x{h}",)) for w, h in FISHEYES_PX),
    Row(name="range 0.3 m to infinity", conditions=("range 0.3 m to infinity",)),
    Row(name="range known to 10 %", conditions=("range known to 10 %",)),
    Row(name="half outside the view", conditions=("region at the view's border",)),
    Row(name="verifying a lock", conditions=("verify",)),
    Row(name="verifying a lock, zoomed", conditions=("verify zoomed",)),
    Row(name="all rows: confident but wrong", scenes=(*TUNING, *HELD_OUT, *REAL), targets=SURE),
    Row(
        name="all answers told with p ≥ 0.9",
        scenes=(*TUNING, *HELD_OUT, *REAL),
        certain=True,
        targets=(Target(figure="certain", bound=0.97, least=True),),
    ),
)

SUMMARY: tuple[Row, ...] = (
    *ROWS[:3],
    Row(name="noise variance 5.1–35.7", conditions=NOISES, paper="3.96–7.01°", targets=_median(0.1)),
    Row(name="HFOV 40–80°", conditions=HFOVS, paper="2.5–4°", targets=_median(0.1)),
    Row(name="zoom ×5", conditions=("zoom x5",), paper=SEEN, targets=_median(0.1)),
    Row(name="light: gain, gamma, shading", conditions=("light mild", "light strong"), paper=SEEN, targets=LIGHT),
    Row(name="light: overexposed", conditions=("light bright",), paper=SEEN, targets=LIGHT),
    Row(name="contrast reversed", conditions=("contrast reversed",), targets=LIGHT),
    Row(
        name="occlusion 10–30 %",
        conditions=("occlusion 10 %", "occlusion 20 %", "occlusion 30 %"),
        paper=SEEN,
        targets=HIDDEN,
    ),
    Row(
        name="extrinsics wrong by 0.2–2°",
        conditions=tuple(f"extrinsics {a}" for a in ("0.2", "0.7", "1.0", "2.0")),
        targets=_median(0.2),
    ),
    Row(name="absent or texture-free", conditions=("absent", "verify absent", "blank"), targets=SURE),
    Row(name="repeated on the arc", conditions=("doubled",), targets=SURE),
    Row(name="real pixels (three pairs)", scenes=REAL),
    *ROWS[-2:],
)
