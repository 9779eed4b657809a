"""Accuracy of every matcher on every row of the paper's experiments and beyond.

python -m tests.bench.accuracy [--scene room] [--only GROUP] [--matchers sweep,harris] [--json OUT.json]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

from ptzd.control.decision import Thresholds, Verdict, decide
from ptzd.geometry.sphere import angle_between, bearing
from ptzd.matching.job import MatchInputs, match
from ptzd.model import Matcher
from tests.bench.cases import Case, cases
from tests.bench.conditions import CONDITIONS


def run_own(matcher: Matcher, case: Case) -> dict[str, object]:
    """Match all views of a case and decide."""
    results = []
    start = time.process_time_ns()
    for index, (reading, view) in enumerate(case.views):
        inputs = MatchInputs(
            fisheye_grey=case.fisheye,
            view_grey=view,
            rig=case.rig,
            box=case.box,
            reading=reading,
            inverse_range=case.inverse_range,
            band_rad=np.radians(case.condition.band_deg),
            seed=case.seed,
        )
        results.append((index, match(inputs, matcher)))
    spent = (time.process_time_ns() - start) / 1e6 / len(case.views)
    decision = decide(results, Thresholds())
    best = decision.best
    answer: dict[str, object] = {
        "found": decision.outcome is Verdict.FOUND,
        "outcome": str(decision.outcome),
        "probability": decision.probability,
        "ms": spent,
        "direction": None if best is None else bearing(best.pan_rad, best.tilt_rad),
    }
    if best is not None:
        answer |= {
            "score": best.score,
            "rival": decision.rivals[0].candidate.score if decision.rivals else 0.0,
            "sigma_deg": float(np.degrees(best.sigma_rad)),
            "sharpness": best.sharpness,
            "in_view": best.in_view,
            "texture": results[0][1].texture,
            "step_deg": 0.0,
        }
    return answer


def runners(names: list[str]) -> dict[str, Callable[[Case], dict[str, object]]]:
    from tests.bench import peers

    table: dict[str, Callable[[Case], dict[str, object]]] = {
        str(matcher): (lambda case, matcher=matcher: run_own(matcher, case)) for matcher in Matcher
    }
    table |= peers.PEERS
    return {name: table[name] for name in names}


def record(case: Case, name: str, answer: dict[str, object]) -> dict[str, object]:
    direction = answer.pop("direction")
    error = None
    if direction is not None and case.truth is not None:
        error = float(np.degrees(angle_between(direction, case.truth)))
    return {
        "scene": case.scene,
        "region": case.region.name,
        "kind": case.region.kind,
        "condition": case.condition.name,
        "group": case.condition.group,
        "present": case.truth is not None,
        "matcher": name,
        "error_deg": error,
    } | answer


def run(scenes: list[str], groups: list[str], names: list[str]) -> list[dict[str, object]]:
    table = runners(names)
    records = []
    for condition in CONDITIONS:
        if groups and condition.group not in groups and condition.name not in groups:
            continue
        for scene in scenes:
            for case in cases(scene, condition):
                records += [record(case, name, runner(case)) for name, runner in table.items()]
        summary(records, names, condition.name, condition.paper)
    return records


def summary(records: list[dict[str, object]], names: list[str], condition: str, paper: str) -> None:
    """One line per condition and matcher."""
    for name in names:
        rows = [r for r in records if r["condition"] == condition and r["matcher"] == name]
        if rows:
            print(f"{condition:20s} {paper:>6s} {name:9s} {line(rows)}", flush=True)


def line(rows: list[dict[str, object]]) -> str:
    present = [r for r in rows if r["present"]]
    errors = np.array([r["error_deg"] if r["error_deg"] is not None else np.inf for r in present], dtype=float)
    wrong = sum(bool(r["found"]) and (not r["present"] or not (r["error_deg"] or 0.0) <= 3.0) for r in rows)
    found = sum(bool(r["found"]) for r in present)
    ms = np.median([r["ms"] for r in rows])
    median = np.median(errors) if len(errors) else np.nan
    within = (errors <= 1.0).mean() if len(errors) else np.nan
    share = found / len(present) if present else np.nan
    return (
        f"n {len(rows):3d}  median {median:7.3f}°  ≤1° {within:5.2f}  found {share:5.2f}"
        f"  wrong {wrong / len(rows):5.3f}  {ms:6.1f} ms"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scene", default="room", help="names or folders, joined by commas")
    parser.add_argument("--only", default="", help="groups or conditions, joined by commas")
    parser.add_argument("--matchers", default="sweep,harris,sift,orb,template,ecc")
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    cv2.setNumThreads(1)
    names = args.matchers.split(",")
    records = run(args.scene.split(","), [g for g in args.only.split(",") if g], names)
    for name in names:
        print(f"{'all':20s} {'':6s} {name:9s} {line([r for r in records if r['matcher'] == name])}")
    if args.json:
        args.json.write_text(json.dumps(records, indent=0))
    return 0


if __name__ == "__main__":
    sys.exit(main())
