"""The table, its summary and the plots out of a run's answers."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tests.bench import plots
from tests.bench.conditions import PAPER_VARIANCES
from tests.bench.real import REAL
from tests.bench.rows import HELD_OUT, ROWS, SUMMARY, TUNING, Figures, Record, Row

PEERS = ("sift", "orb", "template", "ecc")
OTHERS = ("harris", *PEERS)
RENDERED = (*TUNING, *HELD_OUT)
UNTUNED = (*HELD_OUT, *REAL)
README, PAGE, DATA = Path("README.md"), Path("docs/accuracy.md"), Path("docs/accuracy.json")
CLEAN = Row(name="clean", conditions=("clean",))


def table(records: Sequence[Record]) -> str:
    """Every row, all matchers side by side, as Markdown."""
    head = ["experiment", "paper", "target", "`sweep`, tuned on", "`sweep`, held out", "missed by"]
    lines = [[*head, *(f"`{name}`" if name == "harris" else name for name in OTHERS)]]
    lines += [
        [*_own_cells(row, records), *(_other_cell(row, records, name) for name in OTHERS)]
        for row in ROWS
        if row.select(records, "sweep", (*TUNING, *UNTUNED))
    ]
    return markdown(lines)


def summary(records: Sequence[Record]) -> str:
    """The rows that README shows."""
    lines = [
        ["experiment", "paper", "target", "`sweep`, tuned on", "`sweep`, held out", "missed by", "`harris`", "SIFT"]
    ]
    lines += [
        [*_own_cells(row, records), *(_other_cell(row, records, name) for name in ("harris", "sift"))]
        for row in SUMMARY
    ]
    return markdown(lines)


def _own_cells(row: Row, records: Sequence[Record]) -> list[str]:
    tuned, held = (Figures.of(row.select(records, "sweep", scenes)) for scenes in (TUNING, UNTUNED))
    target = ", ".join(str(target) for target in row.targets) or "–"
    cells = [_cell(row, figures, found=True) for figures in (tuned, held)]
    return [row.name, row.paper, target, *cells, missed(row, tuned, held)]


def _other_cell(row: Row, records: Sequence[Record], matcher: str) -> str:
    return _cell(row, Figures.of(row.select(records, matcher, (*TUNING, *UNTUNED))), found=False)


def missed(row: Row, tuned: Figures, held: Figures) -> str:
    """By how much the row's targets are missed, and where."""
    if not row.targets or tuned.count + held.count == 0:
        return "–"
    parts = []
    for target in row.targets:
        for name, figures in (("tuned on", tuned), ("held out", held)):
            by = target.missed_by(getattr(figures, target.figure)) if figures.count else 0.0
            if by > 0.0:
                amount = f"{by:.3f}°" if target.figure == "median" else f"{100 * by:.1f} points {target.figure}"
                parts.append(f"{amount} ({name})")
    return "; ".join(parts) or "met"


def _cell(row: Row, figures: Figures, *, found: bool) -> str:
    """Median, share within 1°, share found, share confidently wrong, number: as far as the row is about them."""
    if figures.count == 0:
        return "–"
    if row.certain:
        return f"{figures.certain:.1%} right of {figures.count}"
    parts = []
    if row.conditions or not row.targets:
        parts += [_degrees(figures.median), _share(figures.within)] if math.isfinite(figures.within) else []
        parts += [f"found {_share(figures.found)}"] if found and math.isfinite(figures.found) else []
    parts.append(f"wrong {figures.wrong:.1%}" if figures.wrong else "wrong 0")
    return " · ".join([*parts, f"n {figures.count}"] if found else parts)


def _degrees(value: float) -> str:
    return "no answer" if math.isinf(value) else f"{value:.3f}°"


def _share(value: float) -> str:
    return f"{100 * value:.0f} %"


def markdown(lines: Sequence[Sequence[str]]) -> str:
    """A table; the first line is its head."""
    rows = ["| " + " | ".join(line) + " |" for line in lines]
    return "\n".join([rows[0], "|" + "---|" * len(lines[0]), *rows[1:]])


def write(records: Sequence[Record]) -> None:
    """Table and plots into docs/, the summary into README.md, the rows' figures as JSON."""
    PAGE.parent.mkdir(exist_ok=True)
    replace(PAGE, "accuracy", f"{table(records)}\n\n{conditions_of_run(records)}")
    replace(README, "accuracy", summary(records))
    DATA.write_text(json.dumps(figures_of(records), indent=1) + "\n")
    for name, chart in charts(records).items():
        (PAGE.parent / f"accuracy-{name}.svg").write_text(chart)


def replace(path: Path, name: str, text: str) -> None:
    """Put text between a file's markers of a name."""
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    head, rest = path.read_text().split(begin)
    path.write_text(f"{head}{begin}\n{text}\n{end}{rest.split(end)[1]}")


def conditions_of_run(records: Sequence[Record]) -> str:
    """One sentence on what was run."""
    regions = {scene: len({r["region"] for r in records if r["scene"] == scene}) for scene in (*RENDERED, *REAL)}
    edges = {(r["scene"], r["region"]) for r in records if r["edge"] and r["condition"] == "clean"}
    others = [r for r in records if r["matcher"] in PEERS and r["scene"] in RENDERED]
    of_peers = {(r["scene"], r["region"]) for r in others}
    counts = ", ".join(f"{scene} {count}" for scene, count in regions.items() if count)
    answers = sum(r["matcher"] == "sweep" for r in records)
    conditions = len({r["condition"] for r in others})
    return (
        f"{answers} answers of `sweep`. Regions: {counts}. `harris` and the peers got {len(of_peers)} of the rendered "
        f"ones in {conditions} conditions. In {len(edges)} regions an occluding edge runs through the centre's pixel. "
        f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}."
    )


def figures_of(records: Sequence[Record]) -> dict[str, object]:
    """Every row's figures by matcher; for `sweep` also apart for the scenes it was tuned on and the others."""
    sets = {"all": (*TUNING, *UNTUNED), "tuned on": TUNING, "held out": UNTUNED}
    return {
        row.name: {
            f"{matcher}, {name}" if matcher == "sweep" else matcher: _plain(Figures.of(chosen))
            for matcher in ("sweep", *OTHERS)
            for name, scenes in sets.items()
            if (matcher == "sweep" or name == "all") and (chosen := row.select(records, matcher, scenes))
        }
        for row in ROWS
    }


def _plain(figures: Figures) -> dict[str, float | None]:
    values = {name: getattr(figures, name) for name in Figures.__dataclass_fields__}
    return {name: round(value, 4) if math.isfinite(value) else None for name, value in values.items()}


def charts(records: Sequence[Record]) -> dict[str, str]:
    """The plots by their names."""
    return {
        "noise": plots.chart(
            "Median error under Gaussian noise on both pictures",
            plots.Axis(title="variance of the noise, grey levels²", ticks=(0, 10, 20, 30, 40)),
            plots.Axis(title="error, degrees (top: no answer)", ticks=(0.01, 0.1, 1, 10, 100), logarithmic=True),
            [*(_over_noise(records, name) for name in ("sweep", *OTHERS)), _paper()],
        ),
        "occlusion": plots.chart(
            "Regions within 1° under occlusion",
            plots.Axis(
                title="share of the region that is hidden in the views",
                ticks=(0, 0.1, 0.2, 0.3, 0.4, 0.5),
                label=_share,
            ),
            plots.Axis(title="within 1°", ticks=(0, 0.25, 0.5, 0.75, 1), label=_share),
            [_over_occlusion(records, name) for name in ("sweep", *OTHERS)],
        ),
        "errors": plots.chart(
            "All regions, clean pictures: how many are within an error",
            plots.Axis(title="error, degrees", ticks=(0.003, 0.01, 0.1, 1, 10, 100), logarithmic=True),
            plots.Axis(title="share of the regions", ticks=(0, 0.25, 0.5, 0.75, 1), label=_share),
            [_cumulative(records, name) for name in ("sweep", *OTHERS)],
        ),
        "probability": plots.chart(
            "What sweep says of itself, and how often that is so",
            plots.Axis(title="probability told", ticks=(0, 0.25, 0.5, 0.75, 1), label=_share),
            plots.Axis(title="share within 1°", ticks=(0, 0.25, 0.5, 0.75, 1), label=_share),
            [
                _reliability(records, "tuned on", TUNING),
                _reliability(records, "held out", UNTUNED),
                plots.Series(name="honest", points=((0, 0), (1, 1)), dashed=True),
            ],
        ),
    }


def _over_noise(records: Sequence[Record], matcher: str) -> plots.Series:
    rows = [(0.0, CLEAN), *((v, Row(name="", conditions=(f"noise var {v}",))) for v in PAPER_VARIANCES)]
    figures = [(x, Figures.of(row.select(records, matcher, RENDERED))) for x, row in rows]
    return plots.Series(name=matcher, points=[(x, f.median) for x, f in figures if f.count])


def _paper() -> plots.Series:
    points = [(0.0, 6.89), *((variance, float(error)) for variance, error in PAPER_VARIANCES.items())]
    return plots.Series(name="the paper", points=points, dashed=True)


def _over_occlusion(records: Sequence[Record], matcher: str) -> plots.Series:
    rows = [(0.0, CLEAN), *((p / 100, Row(name="", conditions=(f"occlusion {p} %",))) for p in (10, 20, 30, 40, 50))]
    figures = [(x, Figures.of(row.select(records, matcher, RENDERED))) for x, row in rows]
    return plots.Series(name=matcher, points=[(x, f.within) for x, f in figures if f.count])


def _cumulative(records: Sequence[Record], matcher: str) -> plots.Series:
    present = [r for r in CLEAN.select(records, matcher, RENDERED) if r["present"]]
    errors = sorted(float(r["error_deg"]) for r in present if r["error_deg"] is not None)
    return plots.Series(name=matcher, points=[(e, (i + 1) / len(present)) for i, e in enumerate(errors)])


def _reliability(records: Sequence[Record], name: str, scenes: Sequence[str]) -> plots.Series:
    told = [r for r in records if r["matcher"] == "sweep" and r["scene"] in scenes and "score" in r]
    points = []
    for low in np.arange(0.0, 1.0, 0.1):
        inside = [r for r in told if low <= float(r["probability"]) < low + 0.1 + 1e-9 * (low > 0.85)]
        if len(inside) >= 10:
            middle = float(np.mean([float(r["probability"]) for r in inside]))
            points.append((middle, Figures.of(inside).certain))
    return plots.Series(name=name, points=points)
